//! Closed forms with their estimates, shared by the tests and `scripts/accept`.

use crate::shapes::Builder;
use glam::{DVec3, Vec3};
use lightkiln::scene::material::Material;
use lightkiln::trace::emitters::{Emitters, Receiver};
use lightkiln::trace::path::{self, Options, Part};
use lightkiln::trace::sampler::{sobol, triangle};
use lightkiln::trace::{Build, Tracer};

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

/// A form factor between unit squares: estimate, its standard error over sixteen independent sets,
/// and the closed form.
pub struct FormFactor {
    pub name: &'static str,
    pub mean: f64,
    pub error: f64,
    pub expected: f64,
}

/// Parallel squares at distance 1, and squares at a right angle with a common edge (dossier 5.7).
pub fn form_factors() -> [FormFactor; 2] {
    let (x, y, z) = (DVec3::X, DVec3::Y, DVec3::Z);
    [
        ("parallel", [z, z + y, z + x + y, z + x], 0.199825),
        ("perpendicular", [DVec3::ZERO, z, z + x, x], 0.200044),
    ]
    .map(|(name, second, expected)| {
        let (mean, error) = form_factor(second);
        FormFactor {
            name,
            mean,
            error,
            expected,
        }
    })
}

/// Form factor from a unit square to another by direct irradiance of a unit-radiosity emitter.
fn form_factor(second: [DVec3; 4]) -> (f64, f64) {
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
    (mean, variance.sqrt())
}
