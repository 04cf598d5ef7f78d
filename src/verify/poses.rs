//! Where lamps stand for figures and pictures: Sobol points in the lamp volumes, a quarter of them
//! close to a surface.

use crate::scene::{Bounds, Scene};
use crate::trace::{Hit, NO_TRIANGLE, Ray, Tracer, sampler};
use glam::Vec3;

/// Every so many poses one stands near a surface.
const NEAR_EVERY: u32 = 4;

/// Distance of near poses from their surface, metres (dossier: .1 to .3 m).
const NEAR: [f32; 2] = [0.1, 0.3];

/// A lamp position.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// Local metres.
    pub position: Vec3,
    /// Whether it was placed .1 to .3 m from a surface.
    pub near: bool,
}

/// `count` lamp positions; the same for the same scene. Without lamp volumes the middle half of the
/// scene's bounds is used.
pub fn poses(tracer: &Tracer, count: u32) -> Vec<Pose> {
    let volumes = lamp_volumes(tracer.scene());
    (0..count)
        .map(|i| {
            let position = inside(&volumes, i);
            let near = i % NEAR_EVERY == NEAR_EVERY - 1;
            match near.then(|| near_surface(tracer, position, i)).flatten() {
                Some(position) => Pose {
                    position,
                    near: true,
                },
                None => Pose {
                    position,
                    near: false,
                },
            }
        })
        .collect()
}

/// Where the lamp of pictures stands, local metres: the middle of the first lamp volume.
pub fn for_pictures(tracer: &Tracer) -> Vec3 {
    let volume = lamp_volumes(tracer.scene())[0];
    (volume.min + volume.max) * 0.5
}

/// The scene's lamp volumes, or a stand-in.
pub fn lamp_volumes(scene: &Scene) -> Vec<Bounds> {
    if !scene.lamp_volumes.is_empty() {
        return scene.lamp_volumes.clone();
    }
    let bounds = scene.bounds();
    let quarter = (bounds.max - bounds.min) * 0.25;
    vec![Bounds {
        min: bounds.min + quarter,
        max: bounds.max - quarter,
    }]
}

/// Point `i` of a Sobol sequence over the union of boxes, by volume.
fn inside(volumes: &[Bounds], i: u32) -> Vec3 {
    let size = |b: &Bounds| f64::from((b.max - b.min).element_product());
    let total: f64 = volumes.iter().map(size).sum();
    let [u, v, w, pick] = sampler::sobol(i, 0, 0x1a3b);
    let mut left = f64::from(pick) * total;
    let volume = volumes
        .iter()
        .find(|b| {
            left -= size(b);
            left < 0.0
        })
        .unwrap_or(&volumes[volumes.len() - 1]);
    volume.min + (volume.max - volume.min) * Vec3::new(u, v, w)
}

/// From `start` along a random direction to a surface, then back off it along its normal, where at
/// least half as much again is free; `None` if no such place is found.
fn near_surface(tracer: &Tracer, start: Vec3, i: u32) -> Option<Vec3> {
    (0..64).find_map(|attempt| {
        let [u, v, w, _] = sampler::sobol(attempt, 0, sampler::mix(0x2c4d, i));
        let ray = Ray::new(start, sampler::sphere(u, v), NO_TRIANGLE);
        let hit = first(tracer, ray)?;
        let point = tracer.surface(&ray, &hit);
        if !point.front {
            return None;
        }
        let distance = NEAR[0] + (NEAR[1] - NEAR[0]) * w;
        let up = Ray::new(point.position, point.normal, point.triangle);
        let room = first(tracer, up).map_or(f32::INFINITY, |h| h.t);
        (room > 1.5 * distance).then(|| point.position + point.normal * distance)
    })
}

fn first(tracer: &Tracer, ray: Ray) -> Option<Hit> {
    let mut hit = [Hit::MISS];
    tracer.closest(&[ray], &mut hit);
    hit[0].is_hit().then_some(hit[0])
}
