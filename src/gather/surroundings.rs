//! What rays tell about surface points while entry cells are built.

use crate::domain::cells::Surroundings;
use crate::scene::surface::SurfacePoint;
use crate::trace::{Hit, NO_TRIANGLE, Ray, Tracer, sampler};
use glam::Vec3;
use rayon::prelude::*;

/// A point more than this share of whose first hits are back faces lies inside a wall (dossier 5.5).
pub const BACK_FACE_LIMIT: f32 = 0.3;

/// Rays that decide whether an entry sample lies inside a wall. At a true share of a half (a sample
/// on the border of a solid) either answer is right; of 16 rays from inside a solid, all hit backs.
const RAYS: u32 = 16;

impl Surroundings for Tracer<'_> {
    fn see_each_other(&self, pairs: &[(Vec3, Vec3)]) -> Vec<bool> {
        let segment = |&(a, b): &(Vec3, Vec3)| Ray::segment(a, b, NO_TRIANGLE);
        let rays: Vec<Ray> = pairs.iter().map(segment).collect();
        let mut blocked = vec![false; rays.len()];
        self.occluded(&rays, &mut blocked);
        blocked.into_iter().map(|b| !b).collect()
    }

    fn in_the_open(&self, points: &[SurfacePoint]) -> Vec<bool> {
        let judge = |(index, point): (usize, &SurfacePoint)| {
            let mut hits = [Hit::MISS; RAYS as usize];
            let rays: [Ray; RAYS as usize] = std::array::from_fn(|i| {
                let [u, v, ..] = sampler::sobol(i as u32, 0, sampler::mix(0x6f70, index as u32));
                let direction = sampler::cosine(point.normal, u, v);
                Ray::new(point.position, direction, point.triangle)
            });
            self.closest(&rays, &mut hits);
            let behind = rays
                .iter()
                .zip(&hits)
                .filter(|(r, h)| behind(self, r, h))
                .count();
            behind as f32 <= BACK_FACE_LIMIT * RAYS as f32
        };
        points.par_iter().enumerate().map(judge).collect()
    }
}

/// Whether a ray hit the back of an opaque single-sided surface.
fn behind(tracer: &Tracer, ray: &Ray, hit: &Hit) -> bool {
    hit.is_hit() && {
        let facet = tracer.facet(hit.triangle);
        !facet.double_sided() && facet.normal.dot(ray.direction) >= 0.0
    }
}
