//! Closed forms: form factors, furnaces, the integrating sphere.

use crate::closed_forms::{form_factors, sidak_t7};
use crate::shapes::Builder;
use glam::{DVec3, Vec3};
use lightkiln::domain::cells::{CellOptions, Cells};
use lightkiln::scene::Scene;
use lightkiln::scene::material::Material;
use lightkiln::trace::emitters::{Emitters, Receiver};
use lightkiln::trace::path::{self, Options, Part};
use lightkiln::trace::sampler::{mix, sobol, triangle};
use lightkiln::trace::{Build, Tracer};
use lightkiln_format::lighting::Light;

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

#[test]
fn form_factors_of_unit_squares() {
    for f in form_factors() {
        let z = (f.mean - f.expected) / f.error;
        println!(
            "form factor {}: {:.6} +- {:.1e}, expected {:.6}, z {z:.2}",
            f.name, f.mean, f.error, f.expected
        );
        assert!(
            f.error <= 1e-4 && z.abs() < sidak_t7(2),
            "{}: {} +- {} against {}",
            f.name,
            f.mean,
            f.error,
            f.expected
        );
    }
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
    Cells::build(tracer.scene(), tracer.surfaces(), options, tracer)
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
