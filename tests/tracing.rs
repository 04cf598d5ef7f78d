//! Tracing: nothing leaks, nothing hits itself, at any scale and distance from the origin.

use crate::shapes::Builder;
use crate::walks::{OFFSETS, SCALES, ball, closed_room, escapes, self_hits};
use glam::{DVec3, Vec3};
use lightkiln::trace::sampler::{sobol, sphere, triangle};
use lightkiln::trace::{Build, Hit, NO_TRIANGLE, Ray, Tracer};

#[test]
fn closed_rooms_do_not_leak() {
    for scale in SCALES {
        for offset in OFFSETS {
            let (lost, traced) = escapes(&closed_room(scale, offset), 20_000, 10);
            assert_eq!(
                lost, 0,
                "of {traced} rays at scale {scale}, offset {offset}"
            );
        }
    }
}

#[test]
fn a_convex_mesh_does_not_hit_itself() {
    for scale in SCALES {
        for offset in OFFSETS {
            let struck = self_hits(&ball(scale, offset), 50_000);
            assert_eq!(struck, 0, "at scale {scale}, offset {offset}");
        }
    }
}

#[test]
fn a_tessellated_plane_does_not_hit_its_neighbours() {
    // Planes through zero and elsewhere, cut into triangles of very different sizes; grazing rays.
    for height in [0.0, 1e-4, 0.3, 1.0] {
        let mut builder = Builder::default().grey(0.5);
        let mut edges = vec![-1.0];
        edges.extend((0..12).map(|i| 0.001 * 1.7_f64.powi(i) - 0.5));
        edges.push(1.0);
        for x in edges.windows(2) {
            for z in edges.windows(2) {
                builder = builder.quad([
                    DVec3::new(x[0], height, z[0]),
                    DVec3::new(x[0], height, z[1]),
                    DVec3::new(x[1], height, z[1]),
                    DVec3::new(x[1], height, z[0]),
                ]);
            }
        }
        let scene = builder.build();
        let tracer = Tracer::new(&scene, Build::Good);
        let count = scene.triangles.len() as u32;
        let rays: Vec<Ray> = (0..250_000_u32)
            .map(|i| {
                let [a, b, c, d] = sobol(i % 65536, 0, 3 + i / 65536);
                let (u, v) = triangle(a, b);
                let phi = std::f32::consts::TAU * c;
                // Elevations from 1e-6 to 1 radian, evenly in the logarithm.
                let direction = Vec3::new(phi.cos(), 10_f32.powf(-6.0 * d), phi.sin());
                let t = i % count;
                Ray::new(tracer.surfaces().lifted(t, u, v, true), direction, t)
            })
            .collect();
        let mut hits = vec![Hit::MISS; rays.len()];
        tracer.closest(&rays, &mut hits);
        let struck = hits.iter().filter(|h| h.is_hit()).count();
        assert_eq!(struck, 0, "of {} rays at height {height}", rays.len());
    }
}

#[test]
fn rays_through_edges_and_corners_are_not_lost() {
    let scene = Builder::default()
        .grey(0.5)
        .room(-DVec3::ONE, DVec3::ONE, 4)
        .build();
    let tracer = Tracer::new(&scene, Build::Good);
    // Straight at every vertex and edge midpoint of the walls, from the centre and from elsewhere.
    let starts = [
        Vec3::ZERO,
        Vec3::new(0.25, -0.5, 0.125),
        Vec3::new(0.1, 0.2, 0.3),
    ];
    let mut rays = Vec::new();
    for start in starts {
        for t in 0..scene.triangles.len() as u32 {
            let [a, b, c] = scene.corners(t);
            for target in [a, b, c, (a + b) * 0.5, (b + c) * 0.5, (c + a) * 0.5] {
                rays.push(Ray::new(start, target - start, NO_TRIANGLE));
            }
        }
    }
    let mut hits = vec![Hit::MISS; rays.len()];
    tracer.closest(&rays, &mut hits);
    assert!(hits.iter().all(Hit::is_hit));
}

#[test]
fn agrees_with_every_triangle_tested_alone() {
    let scene = closed_room(1.0, 0.0);
    let tracer = Tracer::new(&scene, Build::Good);
    let rays: Vec<Ray> = (0..2000)
        .map(|i| {
            let [a, b, c, d] = sobol(i, 0, 11);
            let origin = Vec3::new(a, b * 0.7, c * 1.3);
            Ray::new(origin, sphere(d, sobol(i, 1, 11)[0]), NO_TRIANGLE)
        })
        .collect();
    let mut hits = vec![Hit::MISS; rays.len()];
    tracer.closest(&rays, &mut hits);
    let mut blocked = vec![false; rays.len()];
    tracer.occluded(&rays, &mut blocked);
    for ((ray, hit), blocked) in rays.iter().zip(&hits).zip(blocked) {
        // Moeller-Trumbore in f64.
        let nearest = (0..scene.triangles.len() as u32)
            .filter_map(|t| {
                let [a, b, c] = scene.corners(t).map(|p| p.as_dvec3());
                let (o, d) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
                let (e, f) = (b - a, c - a);
                let p = d.cross(f);
                let s = (o - a) / e.dot(p);
                let q = (o - a).cross(e) / e.dot(p);
                let (u, v, t) = (s.dot(p), d.dot(q), f.dot(q));
                (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 0.0).then_some(t)
            })
            .fold(f64::INFINITY, f64::min);
        assert!(
            blocked && (f64::from(hit.t) - nearest).abs() < 1e-5,
            "{hit:?} vs {nearest}"
        );
    }
}

#[test]
fn alpha_masked_texels_and_segments_let_light_pass() {
    use lightkiln::scene::material::{Material, Texture, TextureRef, Wrap};
    let mask = Material {
        base_color_texture: Some(TextureRef::new(0)),
        alpha_cutoff: Some(0.5),
        ..Material::default()
    };
    let o = DVec3::ZERO;
    let mut scene = Builder::default()
        .material(mask)
        .quad([o, DVec3::X, DVec3::X + DVec3::Y, DVec3::Y])
        .build();
    for (uv, p) in scene.uvs.iter_mut().zip(&scene.positions) {
        *uv = p.truncate();
    }
    // Left half opaque, right half a hole.
    scene.textures.push(Texture {
        name: "mask".into(),
        width: 2,
        height: 1,
        texels: vec![[255, 255, 255, 255], [255, 255, 255, 0]],
        srgb: true,
        wrap: [Wrap::Clamp; 2],
    });
    let tracer = Tracer::new(&scene, Build::Good);
    let ray = |x, limit| Ray {
        limit,
        ..Ray::new(Vec3::new(x, 0.5, 1.0), -Vec3::Z, NO_TRIANGLE)
    };
    let rays = [ray(0.2, 2.0), ray(0.8, 2.0), ray(0.2, 0.5)];
    let mut blocked = [false; 3];
    tracer.occluded(&rays, &mut blocked);
    assert_eq!(blocked, [true, false, false]);
    let mut hits = [Hit::MISS; 3];
    tracer.closest(&rays, &mut hits);
    assert_eq!(hits.map(|h| h.is_hit()), [true, false, false]);
}
