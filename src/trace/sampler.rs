//! Samples: Owen-scrambled Sobol points and the maps from the unit square to directions and areas.

use glam::{DVec3, Vec3};
use std::f32::consts::FRAC_PI_4;

/// Longest sequence of one scramble (`sobol_burley`).
pub const MAX_SAMPLES: u32 = 1 << 16;

/// Four dimensions of sample `index` of the sequence scrambled by `seed`, each in `[0, 1)`.
/// Sets beyond the crate's 64 are padded by reseeding (Burley, JCGT 9(4) 2020).
#[inline]
pub fn sobol(index: u32, set: u32, seed: u32) -> [f32; 4] {
    let sets = sobol_burley::NUM_DIMENSION_SETS_4D;
    let seed = if set < sets {
        seed
    } else {
        mix(seed, set / sets)
    };
    sobol_burley::sample_4d(index, set % sets, seed)
}

/// Hashes two words to one (the finaliser of MurmurHash3): seeds come from what is sampled.
#[inline]
pub fn mix(a: u32, b: u32) -> u32 {
    let mut h = a ^ b.wrapping_mul(0x9e37_79b9).rotate_left(15);
    h ^= h >> 16;
    h = h.wrapping_mul(0x85eb_ca6b);
    h ^= h >> 13;
    h = h.wrapping_mul(0xc2b2_ae35);
    h ^ (h >> 16)
}

/// Two unit vectors that complete unit `n` to a right-handed basis (Duff et al., JCGT 6(1) 2017).
#[inline]
pub fn basis(n: Vec3) -> (Vec3, Vec3) {
    let sign = 1.0_f32.copysign(n.z);
    let a = -1.0 / (sign + n.z);
    let b = n.x * n.y * a;
    (
        Vec3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x),
        Vec3::new(b, sign + n.y * n.y * a, -n.y),
    )
}

/// Sine and cosine for `|x| <= pi/4` by Taylor polynomials, remainders below 3e-8 (half an ulp of
/// 1): the same bits on every processor, which the platform's libm does not promise.
#[inline]
fn sin_cos_octant(x: f32) -> (f32, f32) {
    let q = x * x;
    let sin = x * (1.0 + q * (-1.0 / 6.0 + q * (1.0 / 120.0 + q * (-1.0 / 5040.0))));
    let cos = 1.0 + q * (-0.5 + q * (1.0 / 24.0 + q * (-1.0 / 720.0 + q * (1.0 / 40320.0))));
    (sin, cos)
}

/// Unit direction about unit `n` with density `cos / pi`, by the concentric map.
#[inline]
pub fn cosine(n: Vec3, u: f32, v: f32) -> Vec3 {
    let (a, b) = (2.0 * u - 1.0, 2.0 * v - 1.0);
    let swap = b.abs() > a.abs();
    let (r, other) = if swap { (b, a) } else { (a, b) };
    let (sin, cos) = sin_cos_octant(if r == 0.0 {
        0.0
    } else {
        FRAC_PI_4 * (other / r)
    });
    let (x, y) = if swap {
        (r * sin, r * cos)
    } else {
        (r * cos, r * sin)
    };
    // Not below the rounding of the difference: at the rim of the disk the direction would be
    // horizontal, and the path lost.
    let z = (1.0 - x * x - y * y).max(0.5 * f32::EPSILON).sqrt();
    let (t, s) = basis(n);
    t * x + s * y + n * z
}

/// Barycentric `(u, v)` of a uniform point in a triangle by the low-distortion map (Heitz 2019).
#[inline]
pub fn triangle(u: f32, v: f32) -> (f32, f32) {
    if v > u {
        let x = u * 0.5;
        (x, v - x)
    } else {
        let y = v * 0.5;
        (u - y, y)
    }
}

/// Unit direction uniform over the sphere.
#[inline]
pub fn sphere(u: f32, v: f32) -> Vec3 {
    let z = 1.0 - 2.0 * u;
    let r = (1.0 - z * z).max(0.0).sqrt();
    let (sin, cos) = (std::f32::consts::TAU * v).sin_cos();
    Vec3::new(r * cos, r * sin, z)
}

/// Mean and standard error of R independent randomised estimates (dossier 0.6).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Estimate {
    /// Mean, linear RGB.
    pub mean: DVec3,
    /// Standard error of the mean, linear RGB.
    pub error: DVec3,
}

impl Estimate {
    /// Combines the means of independent scrambles.
    pub fn of(means: &[DVec3]) -> Self {
        let n = means.len() as f64;
        let mean = means.iter().sum::<DVec3>() / n;
        let spread: DVec3 = means.iter().map(|m| (*m - mean) * (*m - mean)).sum();
        let error = if means.len() > 1 {
            (spread / (n * (n - 1.0))).map(f64::sqrt)
        } else {
            DVec3::INFINITY
        };
        Self { mean, error }
    }
}
