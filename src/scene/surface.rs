//! Points on triangles: where rays start so that they neither hit their own surface nor slip
//! behind a neighbour.

use super::Scene;
use glam::{DVec3, Vec3};

/// gamma(7) of pbrt (3rd ed., 3.9.5): bound of the relative rounding error of a barycentric sum.
const GAMMA_7: f32 = 7.0 * 0.5 * f32::EPSILON / (1.0 - 7.0 * 0.5 * f32::EPSILON);

/// Points closer to an edge than this many rounding bounds are moved inward, so that they lie on
/// the inner side of any surface that meets the triangle there at an angle above asin(1/16).
const EDGE_BOUNDS: f32 = 16.0;

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

    /// Position at barycentric `(u, v)`, kept off the edges and lifted to the side of `front`, each
    /// by the bound of its own rounding error.
    #[inline]
    pub fn lifted(&self, u: f32, v: f32, front: bool) -> Vec3 {
        let [a, b, c] = self.corners;
        let (mut b0, mut b1, mut b2) = (1.0 - u - v, u, v);
        if b0.min(b1).min(b2) < 1.0 / 64.0 {
            [b0, b1, b2] = self.inset([b0, b1, b2]);
        }
        let (pa, pb, pc) = (a * b0, b * b1, c * b2);
        let bound = (pa.abs() + pb.abs() + pc.abs()) * GAMMA_7;
        let side = if front { self.normal } else { -self.normal };
        let lift = side * bound.dot(side.abs());
        let p = pa + pb + pc + lift;
        // At least one representable step, so that the sum cannot round back onto the plane.
        let step = |x: f32, d: f32| {
            if d > 0.0 {
                x.next_up()
            } else if d < 0.0 {
                x.next_down()
            } else {
                x
            }
        };
        Vec3::new(step(p.x, lift.x), step(p.y, lift.y), step(p.z, lift.z))
    }

    /// Barycentric weights no nearer to an edge than [`EDGE_BOUNDS`] rounding bounds, or a third of
    /// the height for a triangle smaller than that.
    #[cold]
    fn inset(&self, weights: [f32; 3]) -> [f32; 3] {
        let [a, b, c] = self.corners;
        let reach = a.abs().max(b.abs()).max(c.abs()).max_element() * GAMMA_7 * EDGE_BOUNDS;
        let double_area = (b - a).cross(c - a).length();
        let edges = [(c - b).length(), (a - c).length(), (b - a).length()];
        let mut kept = [0.0; 3];
        for i in 0..3 {
            let least = (reach * edges[i] / double_area).min(1.0 / 3.0);
            kept[i] = weights[i].max(if least.is_finite() { least } else { 1.0 / 3.0 });
        }
        let sum: f32 = kept.iter().sum();
        kept.map(|w| w / sum)
    }

    /// The surface where a ray along `direction` hit `triangle` at barycentric `(u, v)`.
    #[inline]
    pub fn at(&self, scene: &Scene, direction: Vec3, triangle: u32, u: f32, v: f32) -> SurfacePoint {
        let front = self.normal.dot(direction) < 0.0;
        self.point(scene, triangle, u, v, front)
    }

    /// The point at barycentric `(u, v)` of one side.
    #[inline]
    pub fn point(&self, scene: &Scene, triangle: u32, u: f32, v: f32, front: bool) -> SurfacePoint {
        let albedo = if !front && !self.double_sided() {
            Vec3::ZERO
        } else if self.flags & TEXTURED != 0 {
            scene.albedo_at(triangle, u, v)
        } else {
            self.albedo
        };
        SurfacePoint {
            position: self.lifted(u, v, front),
            normal: if front { self.normal } else { -self.normal },
            triangle,
            front,
            albedo,
        }
    }
}
