//! Ray tracing over a [`Scene`]: batches of rays in, batches of hits out.
//! Knows materials and lights, but no technique.

pub mod accel;
pub mod emitters;
pub mod path;
pub mod sampler;
pub mod triangle;
pub mod visibility;

use crate::scene::Scene;
use crate::scene::surface::{Facet, SurfacePoint, Surfaces};
use accel::{Accel, Stack};
use glam::Vec3;
use rayon::prelude::*;

/// "No triangle": the value of [`Hit::triangle`] on a miss and of [`Ray::skip`] in free space.
pub const NO_TRIANGLE: u32 = u32::MAX;

/// Rays a task; larger batches are split over rayon, smaller ones run where they are.
const RAYS_PER_TASK: usize = 4096;

/// A ray. Hits count at `0 < t < limit`, in units of `direction`'s length.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C)]
pub struct Ray {
    /// Start, metres, local.
    pub origin: Vec3,
    /// Largest `t` (exclusive); infinity, or 1 for a segment to `origin + direction`.
    pub limit: f32,
    /// Direction, any length but zero.
    pub direction: Vec3,
    /// Triangle the ray starts on, which it cannot hit; [`NO_TRIANGLE`] in free space.
    pub skip: u32,
}

/// The closest hit of a ray.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C)]
pub struct Hit {
    /// Distance in units of the ray direction's length; infinity on a miss.
    pub t: f32,
    /// Triangle hit, or [`NO_TRIANGLE`].
    pub triangle: u32,
    /// Barycentric weight of the second corner.
    pub u: f32,
    /// Barycentric weight of the third corner.
    pub v: f32,
}

impl Hit {
    /// No hit.
    pub const MISS: Self = Self {
        t: f32::INFINITY,
        triangle: NO_TRIANGLE,
        u: 0.0,
        v: 0.0,
    };

    /// Whether something was hit.
    #[inline]
    pub fn is_hit(&self) -> bool {
        self.triangle != NO_TRIANGLE
    }
}

impl Ray {
    /// A ray without end.
    #[inline]
    pub fn new(origin: Vec3, direction: Vec3, skip: u32) -> Self {
        Self {
            origin,
            limit: f32::INFINITY,
            direction,
            skip,
        }
    }

    /// The segment between two points, both lifted off their surfaces: what lies strictly between
    /// them blocks.
    #[inline]
    pub fn segment(from: Vec3, to: Vec3, skip: u32) -> Self {
        Self {
            origin: from,
            limit: 1.0,
            direction: to - from,
            skip,
        }
    }
}

/// How much work goes into building the hierarchy.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Build {
    /// For few rays.
    Fast,
    /// For a bake.
    #[default]
    Good,
}

/// Traces rays through the light-blocking triangles of one scene.
pub struct Tracer<'s> {
    scene: &'s Scene,
    accel: Accel,
    surfaces: Surfaces,
}

impl<'s> Tracer<'s> {
    /// Builds the hierarchy over all triangles whose role blocks light.
    pub fn new(scene: &'s Scene, build: Build) -> Self {
        let accel = Accel::build(scene, build);
        Self {
            scene,
            accel,
            surfaces: Surfaces::of(scene),
        }
    }

    /// The scene traced.
    pub fn scene(&self) -> &'s Scene {
        self.scene
    }

    /// Shading record of a triangle.
    #[inline]
    pub fn facet(&self, triangle: u32) -> &Facet {
        self.surfaces.facet(triangle)
    }

    /// Shading records of all triangles.
    pub fn surfaces(&self) -> &Surfaces {
        &self.surfaces
    }

    /// The surface a ray hit, lifted to the side it came from.
    #[inline]
    pub fn surface(&self, ray: &Ray, hit: &Hit) -> SurfacePoint {
        self.surfaces
            .hit(self.scene, ray.direction, hit.triangle, hit.u, hit.v)
    }

    /// Bytes of the hierarchy.
    pub fn accel_bytes(&self) -> usize {
        self.accel.bytes()
    }

    /// Closest hit of every ray: front and back sides alike, alpha-masked texels let rays pass.
    /// Of equally distant triangles the one with the lowest number is hit.
    ///
    /// # Panics
    /// If the slices differ in length.
    pub fn closest(&self, rays: &[Ray], hits: &mut [Hit]) {
        assert_eq!(rays.len(), hits.len(), "one hit a ray");
        let batch = |rays: &[Ray], hits: &mut [Hit]| {
            let mut stack = Stack::default();
            for (ray, hit) in rays.iter().zip(hits) {
                *hit = self.accel.closest(ray, &mut stack, |hit| self.covers(hit));
            }
        };
        if rays.len() <= RAYS_PER_TASK {
            batch(rays, hits);
        } else {
            rays.par_chunks(RAYS_PER_TASK)
                .zip(hits.par_chunks_mut(RAYS_PER_TASK))
                .for_each(|(rays, hits)| batch(rays, hits));
        }
    }

    /// Whether anything blocks each ray within its limit.
    ///
    /// # Panics
    /// If the slices differ in length.
    pub fn occluded(&self, rays: &[Ray], blocked: &mut [bool]) {
        assert_eq!(rays.len(), blocked.len(), "one answer a ray");
        let batch = |rays: &[Ray], blocked: &mut [bool]| {
            let mut stack = Stack::default();
            for (ray, blocked) in rays.iter().zip(blocked) {
                *blocked = self.accel.occluded(ray, &mut stack, |hit| self.covers(hit));
            }
        };
        if rays.len() <= RAYS_PER_TASK {
            batch(rays, blocked);
        } else {
            rays.par_chunks(RAYS_PER_TASK)
                .zip(blocked.par_chunks_mut(RAYS_PER_TASK))
                .for_each(|(rays, blocked)| batch(rays, blocked));
        }
    }

    /// Alpha mask at a hit of a masked triangle.
    fn covers(&self, hit: &Hit) -> bool {
        let uv = self.scene.uv_at(hit.triangle, hit.u, hit.v);
        self.scene
            .material_of(hit.triangle)
            .covers(&self.scene.textures, uv)
    }
}
