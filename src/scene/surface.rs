//! Points on triangles: where rays start so that they neither hit their own surface nor slip
//! behind a neighbour.

use super::Scene;
use glam::{DVec3, Vec3};

/// Distance by which points are lifted off their surface, in units of the largest coordinate of the
/// scene: 32 roundings (u = 2^-24). The position itself is good to gamma(7) (pbrt 3rd ed., 3.9.5);
/// what decides is the plane of a coplanar neighbour, whose distance along a ray the triangle test
/// finds with an error that grows with the neighbour's size, not with the point's coordinates. The
/// worst-case bound of that test (pbrt 3.9.6) is 168 u; 32 u is ten times what is ever observed
/// (`tests/tracing.rs` looks for one self-hit in a million grazing rays).
const LIFT: f32 = 32.0 * 0.5 * f32::EPSILON;

/// Points nearer to an edge than this many lifts are moved inward: a lifted point then lies on the
/// inner side of any surface that meets its triangle there at more than 30 degrees.
const INSET_LIFTS: f32 = 2.0;

/// Flag: the back side reflects.
const DOUBLE_SIDED: u32 = 1;
/// Flag: the albedo varies.
const TEXTURED: u32 = 2;

/// What a hit needs to be continued: one cache line a triangle.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C, align(64))]
pub struct Facet {
    corners: [Vec3; 3],
    /// Unit geometric normal of the front.
    pub normal: Vec3,
    albedo: Vec3,
    flags: u32,
}

/// A point on a surface, seen from one side and lifted off it to that side.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfacePoint {
    /// Lifted position, metres, local.
    pub position: Vec3,
    /// Unit geometric normal of the side seen.
    pub normal: Vec3,
    /// Triangle.
    pub triangle: u32,
    /// Whether the front was seen.
    pub front: bool,
    /// Diffuse albedo of that side, linear RGB; zero on the back of a single-sided surface.
    pub albedo: Vec3,
}

impl Facet {
    /// The record of one triangle; its normal comes from f64.
    pub fn of(scene: &Scene, triangle: u32) -> Self {
        let corners = scene.corners(triangle);
        let [a, b, c] = corners.map(Vec3::as_dvec3);
        let material = scene.material_of(triangle);
        let mut flags = 0;
        if material.double_sided {
            flags |= DOUBLE_SIDED;
        }
        if material.has_albedo_texture() {
            flags |= TEXTURED;
        }
        Self {
            corners,
            normal: (b - a).cross(c - a).normalize_or(DVec3::Y).as_vec3(),
            albedo: material.constant_albedo(),
            flags,
        }
    }

    /// Corner positions, metres, local.
    pub fn corners(&self) -> [Vec3; 3] {
        self.corners
    }

    /// Whether the back side reflects.
    pub fn double_sided(&self) -> bool {
        self.flags & DOUBLE_SIDED != 0
    }

    /// Area, m².
    pub fn area(&self) -> f64 {
        let [a, b, c] = self.corners.map(Vec3::as_dvec3);
        (b - a).cross(c - a).length() * 0.5
    }
}

/// The shading records of a scene's triangles, and how far its points are lifted.
#[derive(Debug, Clone)]
pub struct Surfaces {
    facets: Vec<Facet>,
    lift: f32,
}

impl Surfaces {
    /// Records of all triangles of `scene`.
    pub fn of(scene: &Scene) -> Self {
        let largest = scene
            .positions
            .iter()
            .fold(0.0_f32, |m, p| m.max(p.abs().max_element()));
        let facets = (0..scene.triangles.len() as u32)
            .map(|t| Facet::of(scene, t))
            .collect();
        Self {
            facets,
            lift: largest * LIFT,
        }
    }

    /// Record of a triangle.
    #[inline]
    pub fn facet(&self, triangle: u32) -> &Facet {
        &self.facets[triangle as usize]
    }

    /// Distance by which points are lifted off their surface, metres.
    pub fn lift(&self) -> f32 {
        self.lift
    }

    /// Position at barycentric `(u, v)` of a triangle, kept off its edges and lifted to the side of
    /// `front`, metres, local.
    #[inline]
    pub fn lifted(&self, triangle: u32, u: f32, v: f32, front: bool) -> Vec3 {
        let facet = self.facet(triangle);
        let [a, b, c] = facet.corners;
        let mut weights = [1.0 - u - v, u, v];
        if weights[0].min(u).min(v) < 1.0 / 64.0 {
            weights = self.inset(facet, weights);
        }
        let lift = if front { self.lift } else { -self.lift };
        a * weights[0] + b * weights[1] + c * weights[2] + facet.normal * lift
    }

    /// Barycentric weights no nearer to an edge than [`INSET_LIFTS`], or a third of the height for
    /// a triangle smaller than that.
    #[cold]
    fn inset(&self, facet: &Facet, weights: [f32; 3]) -> [f32; 3] {
        let [a, b, c] = facet.corners;
        let double_area = (b - a).cross(c - a).length();
        let edges = [(c - b).length(), (a - c).length(), (b - a).length()];
        let mut kept = [0.0; 3];
        for i in 0..3 {
            let least = self.lift * INSET_LIFTS * edges[i] / double_area;
            kept[i] = weights[i].max(if least < 1.0 / 3.0 { least } else { 1.0 / 3.0 });
        }
        let sum: f32 = kept.iter().sum();
        kept.map(|w| w / sum)
    }

    /// The surface where a ray along `direction` hit `triangle` at barycentric `(u, v)`.
    #[inline]
    pub fn hit(
        &self,
        scene: &Scene,
        direction: Vec3,
        triangle: u32,
        u: f32,
        v: f32,
    ) -> SurfacePoint {
        let front = self.facet(triangle).normal.dot(direction) < 0.0;
        self.point(scene, triangle, u, v, front)
    }

    /// The point at barycentric `(u, v)` of one side.
    #[inline]
    pub fn point(&self, scene: &Scene, triangle: u32, u: f32, v: f32, front: bool) -> SurfacePoint {
        let facet = self.facet(triangle);
        let albedo = if !front && !facet.double_sided() {
            Vec3::ZERO
        } else if facet.flags & TEXTURED != 0 {
            scene.albedo_at(triangle, u, v)
        } else {
            facet.albedo
        };
        SurfacePoint {
            position: self.lifted(triangle, u, v, front),
            normal: if front { facet.normal } else { -facet.normal },
            triangle,
            front,
            albedo,
        }
    }
}
