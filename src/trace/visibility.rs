//! Visibility of many points from one: what the runtime asks of its depth cube, asked of rays.

use super::{NO_TRIANGLE, Ray, Tracer};
use glam::Vec3;

/// 1 where nothing blocks the segment from `lamp` to a lifted point, else 0. Local metres.
pub fn from_point(tracer: &Tracer, lamp: Vec3, points: &[Vec3]) -> Vec<f32> {
    let rays: Vec<Ray> = points
        .iter()
        .map(|&p| Ray::segment(p, lamp, NO_TRIANGLE))
        .collect();
    answer(tracer, &rays)
}

/// 1 where nothing blocks the ray from a lifted point towards `direction`, else 0.
pub fn from_infinity(tracer: &Tracer, direction: Vec3, points: &[Vec3]) -> Vec<f32> {
    let rays: Vec<Ray> = points
        .iter()
        .map(|&p| Ray::new(p, direction, NO_TRIANGLE))
        .collect();
    answer(tracer, &rays)
}

fn answer(tracer: &Tracer, rays: &[Ray]) -> Vec<f32> {
    let mut blocked = vec![false; rays.len()];
    tracer.occluded(rays, &mut blocked);
    blocked
        .into_iter()
        .map(|b| if b { 0.0 } else { 1.0 })
        .collect()
}
