//! Rays that must not get lost or caught, shared by the tests and `scripts/accept`.

use crate::shapes::Builder;
use glam::DVec3;
use lightkiln::scene::Scene;
use lightkiln::trace::sampler::{cosine, mix, sobol, triangle};
use lightkiln::trace::{Build, Hit, Ray, Tracer};

/// Room sizes (m) and offsets (in room sizes) of the robustness tests.
pub const SCALES: [f64; 4] = [1e-3, 1.0, 37.0, 1e4];
pub const OFFSETS: [f64; 3] = [0.0, 1.0, 1e4];

/// A closed room: coarse walls, a finely tessellated sphere and a box standing in it.
pub fn closed_room(scale: f64, offset: f64) -> Scene {
    let at = DVec3::new(0.7, -0.4, 1.0) * scale * offset;
    Builder::default()
        .grey(0.5)
        .room(at, at + DVec3::new(1.0, 0.7, 1.3) * scale, 3)
        .sphere(
            at + DVec3::new(0.3, 0.3, 0.4) * scale,
            0.2 * scale,
            3,
            false,
        )
        .build()
}

/// Walks `paths` diffuse paths of up to `bounces` hits from the first triangles; returns escapes.
pub fn escapes(scene: &Scene, paths: u32, bounces: u32) -> (u64, u64) {
    let tracer = Tracer::new(scene, Build::Good);
    let triangles = scene.triangles.len() as u32;
    let mut rays: Vec<Ray> = (0..paths)
        .map(|i| {
            let t = mix(i, 7) % triangles;
            let [a, b, c, d] = sobol(i % 65536, 0, i / 65536);
            let (u, v) = triangle(a, b);
            let facet = tracer.facet(t);
            Ray::new(
                tracer.surfaces().lifted(t, u, v, true),
                cosine(facet.normal, c, d),
                t,
            )
        })
        .collect();
    let mut hits = vec![Hit::MISS; rays.len()];
    let (mut lost, mut traced) = (0, 0);
    for bounce in 1..=bounces {
        tracer.closest(&rays, &mut hits);
        traced += rays.len() as u64;
        let mut index = 0;
        let mut kept = Vec::with_capacity(rays.len());
        for (ray, hit) in rays.iter().zip(&hits) {
            index += 1;
            if !hit.is_hit() {
                lost += 1;
                continue;
            }
            let point = tracer.surface(ray, hit);
            let [u, v, ..] = sobol(index % 65536, bounce, mix(bounce, index / 65536));
            kept.push(Ray::new(
                point.position,
                cosine(point.normal, u, v),
                point.triangle,
            ));
        }
        hits.truncate(kept.len());
        rays = kept;
    }
    (lost, traced)
}

/// A sphere of 5,120 triangles, seen from outside.
pub fn ball(scale: f64, offset: f64) -> Scene {
    let at = DVec3::new(0.7, -0.4, 1.0) * scale * offset;
    Builder::default()
        .grey(0.5)
        .sphere(at, scale, 4, false)
        .build()
}

/// Of `count` cosine-distributed rays that leave a convex mesh, those that meet it again.
pub fn self_hits(scene: &Scene, count: u32) -> u64 {
    let tracer = Tracer::new(scene, Build::Good);
    let triangles = scene.triangles.len() as u32;
    let rays: Vec<Ray> = (0..count)
        .map(|i| {
            let [a, b, c, d] = sobol(i % 65536, 0, 3 + i / 65536);
            let (u, v) = triangle(a, b);
            let t = mix(i, 11) % triangles;
            let direction = cosine(tracer.facet(t).normal, c, d);
            Ray::new(tracer.surfaces().lifted(t, u, v, true), direction, t)
        })
        .collect();
    let mut hits = vec![Hit::MISS; rays.len()];
    tracer.closest(&rays, &mut hits);
    hits.iter().filter(|h| h.is_hit()).count() as u64
}
