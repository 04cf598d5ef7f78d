//! Closed forms: form factors, furnaces, the integrating sphere.

use crate::shapes::Builder;
use glam::{DVec3, Vec3};
use lightkiln::domain::cells::{CellOptions, Cells};
use lightkiln::scene::Scene;
use lightkiln::scene::material::Material;
use lightkiln::trace::emitters::{Emitters, Receiver};
use lightkiln::trace::path::{self, Options, Part};
use lightkiln::trace::sampler::{mix, sobol, triangle};
use lightkiln::trace::{Build, NO_TRIANGLE, Ray, Tracer};
use lightkiln_format::lighting::Light;

/// Largest |z| allowed among `n` independent standard normals at 1 % false alarms (Sidak).
/// Student's t with 7 degrees of freedom (8 scrambles) is wider: its quantile is used.
pub fn sidak_t7(n: usize) -> f64 {
    // Upper tail of t7: p(|t| > x) by the closed form for odd degrees of freedom.
    let tail = |x: f64| {
        let theta = (x / 7.0_f64.sqrt()).atan();
        let (s, c) = theta.sin_cos();
        let sum = c + 2.0 / 3.0 * c.powi(3) + 8.0 / 15.0 * c.powi(5);
        1.0 - 2.0 / std::f64::consts::PI * (theta + s * sum)
    };
    let alpha = 1.0 - 0.99_f64.powf(1.0 / n as f64);
    let (mut low, mut high) = (0.0, 1e4);
    for _ in 0..200 {
        let middle = 0.5 * (low + high);
        if tail(middle) > alpha {
            low = middle
        } else {
            high = middle
        }
    }
    low
}

fn emitter(radiance: f32) -> Material {
    Material {
        base_color: Vec3::ZERO,
        emissive: Vec3::splat(radiance),
        ..Material::default()
    }
}

/// Points spread over the triangles of a scene's material 0, front side.
fn receivers(scene: &Scene, count: u32) -> Vec<Receiver> {
    let tracer = Tracer::new(scene, Build::Fast);
    let own: Vec<u32> = (0..scene.triangles.len() as u32)
        .filter(|&t| scene.triangles[t as usize].material == 0)
        .collect();
    (0..count)
        .map(|i| {
            let [a, b, ..] = sobol(i, 0, 5);
            let (u, v) = triangle(a, b);
            let t = own[(mix(i, 1) % own.len() as u32) as usize];
            let facet = tracer.facet(t);
            Receiver {
                position: tracer.surfaces().lifted(t, u, v, true),
                normal: facet.normal,
                geometric_normal: facet.normal,
                triangle: t,
            }
        })
        .collect()
}

/// Form factor from a unit square to another by direct irradiance of a unit-radiosity emitter.
fn form_factor(second: [DVec3; 4], expected: f64) {
    let o = DVec3::ZERO;
    let scene = Builder::default()
        .grey(0.0)
        .quad([o, DVec3::X, DVec3::X + DVec3::Y, DVec3::Y])
        .material(emitter(std::f32::consts::FRAC_1_PI))
        .quad(second)
        .build();
    let tracer = Tracer::new(&scene, Build::Good);
    let emitters = Emitters::new(&scene, &[], true, None).unwrap();
    // Sixteen independent sets of 4,096 receivers: mean and standard error of the area average.
    let sets: Vec<f64> = (0..16)
        .map(|set| {
            let points: Vec<Receiver> = (0..4096)
                .map(|i| {
                    let [a, b, ..] = sobol(i / 2, 0, 100 + set);
                    let (u, v) = triangle(a, b);
                    let (t, facet) = (i % 2, tracer.facet(0));
                    Receiver {
                        position: tracer.surfaces().lifted(t, u, v, true),
                        normal: facet.normal,
                        geometric_normal: facet.normal,
                        triangle: t,
                    }
                })
                .collect();
            let options = Options {
                part: Part::Direct,
                paths: 128,
                scrambles: 2,
                max_bounces: None,
                seed: set,
            };
            let all = path::irradiance(&tracer, &emitters, &points, &options);
            all.iter().map(|e| e.mean.x).sum::<f64>() / all.len() as f64
        })
        .collect();
    let mean = sets.iter().sum::<f64>() / 16.0;
    let variance: f64 = sets.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (16.0 * 15.0);
    let error = variance.sqrt();
    let z = (mean - expected) / error;
    println!("form factor {mean:.6} +- {error:.1e}, expected {expected:.6}, z {z:.2}");
    assert!(
        error <= 1e-4 && z.abs() < sidak_t7(1),
        "{mean} +- {error} against {expected}"
    );
}

#[test]
fn form_factor_of_parallel_unit_squares() {
    let z = DVec3::Z;
    form_factor(
        [z, z + DVec3::Y, z + DVec3::X + DVec3::Y, z + DVec3::X],
        0.199825,
    );
}

#[test]
fn form_factor_of_perpendicular_unit_squares() {
    let (x, z) = (DVec3::X, DVec3::Z);
    form_factor([DVec3::ZERO, z, z + x, x], 0.200044);
}

#[test]
fn furnace_of_the_path_tracer() {
    // Closed room, albedo 1/2, emission 1 everywhere: radiance 1/(1 - 1/2), irradiance 2 pi.
    let material = Material {
        base_color: Vec3::splat(0.5),
        emissive: Vec3::ONE,
        ..Material::default()
    };
    let scene = Builder::default()
        .material(material)
        .room(-DVec3::ONE, DVec3::ONE, 2)
        .build();
    let tracer = Tracer::new(&scene, Build::Good);
    let emitters = Emitters::new(&scene, &[], true, None).unwrap();
    let points = receivers(&scene, 64);
    let options = Options {
        paths: 2048,
        ..Options::default()
    };
    let expected = 2.0 * std::f64::consts::PI;
    let found = path::irradiance(&tracer, &emitters, &points, &options);
    let worst = found
        .iter()
        .map(|e| ((e.mean.x - expected) / e.error.x).abs())
        .fold(0.0, f64::max);
    let mean = found.iter().map(|e| e.mean.x).sum::<f64>() / 64.0;
    println!("furnace: mean {mean:.5} of {expected:.5}, largest |z| {worst:.2}");
    assert!(worst < sidak_t7(64), "largest |z| {worst}");
}

/// Indirect irradiance in a sphere with a point lamp anywhere inside is uniform:
/// rho/(1-rho) Phi/(4 pi R^2), whatever the lamp's place.
#[test]
fn integrating_sphere_of_the_path_tracer() {
    let radius = 2.0;
    for albedo in [0.2_f32, 0.5, 0.8] {
        let scene = Builder::default()
            .grey(albedo)
            .sphere(DVec3::ZERO, radius, 4, true)
            .build();
        let tracer = Tracer::new(&scene, Build::Good);
        let lamp = Light::Point {
            position: DVec3::new(0.9, -0.5, 0.6),
            intensity: Vec3::ONE,
            radius: 0.0,
        };
        let emitters = Emitters::lamps(&scene, &[lamp]).unwrap();
        let points = receivers(&scene, 32);
        let options = Options {
            part: Part::Indirect,
            paths: 1024,
            ..Options::default()
        };
        let rho = f64::from(albedo);
        let expected = rho / (1.0 - rho) / (radius * radius);
        let found = path::irradiance(&tracer, &emitters, &points, &options);
        let mean = found.iter().map(|e| e.mean.x).sum::<f64>() / found.len() as f64;
        println!("albedo {albedo}: {mean:.5} of {expected:.5}");
        // Level 4 has 5,120 triangles: the polyhedron is 0.25 % smaller in radius than the sphere
        // at the face centres, so the closed form holds to half a percent.
        assert!(
            (mean / expected - 1.0).abs() < 0.005,
            "{mean} against {expected}"
        );
    }
}

/// Cells of a scene, with sight answered by its own tracer.
pub fn cells_of(tracer: &Tracer, options: &CellOptions) -> Cells {
    Cells::build(tracer.scene(), tracer.surfaces(), options, &|pairs| {
        let rays: Vec<Ray> = pairs
            .iter()
            .map(|&(a, b)| Ray::segment(a, b, NO_TRIANGLE))
            .collect();
        let mut blocked = vec![false; rays.len()];
        tracer.occluded(&rays, &mut blocked);
        blocked.into_iter().map(|b| !b).collect()
    })
}

#[test]
fn cells_cover_the_surface_and_keep_sides_apart() {
    let scene = Builder::default()
        .grey(0.5)
        .room(DVec3::ZERO, DVec3::new(4.0, 3.0, 5.0), 2)
        // A thin wall standing in the room (corners swapped: it faces out).
        .room(DVec3::new(2.01, 3.0, 4.0), DVec3::new(1.99, 0.0, 0.0), 2)
        .build();
    let tracer = Tracer::new(&scene, Build::Good);
    let cells = cells_of(
        &tracer,
        &CellOptions {
            cells: 128,
            entries_per_cell: 16,
        },
    );
    assert!((90..300).contains(&cells.len()), "{} cells", cells.len());
    for cell in 0..cells.len() {
        let own = cells.first_sample[cell] as usize..cells.first_sample[cell + 1] as usize;
        let samples = &cells.samples[own];
        for s in samples {
            assert_eq!(
                cells.find(s),
                cell as u32,
                "a sample is found in its own cell"
            );
            assert!(
                s.normal.dot(samples[0].normal) > 0.0,
                "no cell joins opposite sides"
            );
        }
        // The thin wall splits the floor: no cell reaches across it.
        let left = samples
            .iter()
            .any(|s| s.position.x < 1.98 && s.position.z < 3.9);
        let right = samples
            .iter()
            .any(|s| s.position.x > 2.02 && s.position.z < 3.9);
        let sides = samples[0].normal.x.abs() < 0.5;
        assert!(
            !(left && right && sides),
            "cell {cell} reaches through the wall"
        );
        let entries = cells.first_entry[cell + 1] - cells.first_entry[cell];
        assert!((1..=16).contains(&entries));
    }
}
