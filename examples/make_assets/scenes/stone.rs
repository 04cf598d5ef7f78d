//! Procedural stone: small sRGB textures from integer hashes.

use glam::{DVec2, DVec3};
use lightkiln::scene::material::{Texture, Wrap};
use lightkiln::trace::sampler::mix;

/// Width and height, texels.
const SIDE: u32 = 128;

/// Noise in `[0, 1)` at the points of a lattice that repeats every `period`.
fn lattice(x: i64, y: i64, period: i64, seed: u32) -> f64 {
    let (x, y) = (x.rem_euclid(period) as u32, y.rem_euclid(period) as u32);
    f64::from(mix(mix(x, seed), y)) / 4_294_967_296.0
}

/// Smooth value noise over the unit square, `cells` lattice cells a side; repeats.
fn noise(p: DVec2, cells: i64, seed: u32) -> f64 {
    let p = p * cells as f64;
    let base = p.floor();
    let f = p - base;
    let f = f * f * (3.0 - 2.0 * f);
    let (x, y) = (base.x as i64, base.y as i64);
    let row = |y| {
        let (a, b) = (lattice(x, y, cells, seed), lattice(x + 1, y, cells, seed));
        a + (b - a) * f.x
    };
    row(y) + (row(y + 1) - row(y)) * f.y
}

/// Five octaves of noise, about `[0, 1]`.
fn cloud(p: DVec2, cells: i64, seed: u32) -> f64 {
    (0..5)
        .map(|k| noise(p, cells << k, seed + k) / f64::from(2 << k))
        .sum()
}

fn texture(name: &str, colour: impl Fn(DVec2) -> DVec3) -> Texture {
    let texel = |i: u32| {
        let p = DVec2::new(f64::from(i % SIDE) + 0.5, f64::from(i / SIDE) + 0.5);
        let [r, g, b] = colour(p / f64::from(SIDE))
            .clamp(DVec3::ZERO, DVec3::ONE)
            .to_array()
            .map(|c| (c * 255.0 + 0.5) as u8);
        [r, g, b, u8::MAX]
    };
    Texture {
        name: name.into(),
        width: SIDE,
        height: SIDE,
        texels: (0..SIDE * SIDE).map(texel).collect(),
        srgb: true,
        wrap: [Wrap::Repeat; 2],
    }
}

/// Distance to the nearest multiple of `step`.
fn joint(x: f64, step: f64) -> f64 {
    let x = x.rem_euclid(step);
    x.min(step - x)
}

/// Marble of colour `base` with darker veins.
fn marble(p: DVec2, base: DVec3, vein: DVec3, seed: u32) -> DVec3 {
    let drift = cloud(p, 3, seed);
    let ridge = (cloud(p, 2, seed + 40) - 0.48).abs() * 9.0;
    let depth = (1.0 - ridge).max(0.0);
    let veins = depth * depth * 0.75;
    base * (0.9 + 0.2 * drift) * (1.0 - veins) + vein * veins
}

/// Courses of ashlar: four courses of two blocks, every second one shifted by half a block.
pub fn ashlar() -> Texture {
    texture("ashlar", |p| {
        let course = (p.y * 4.0).floor();
        let shifted = p.x * 2.0 + 0.5 * (course % 2.0);
        let block = lattice(shifted.floor() as i64, course as i64, 2, 5 + course as u32);
        let joint = joint(shifted, 1.0).min(joint(p.y * 4.0, 1.0) * 0.5);
        let mortar = (1.0 - joint / 0.025).clamp(0.0, 1.0);
        let stone = DVec3::new(0.83, 0.765, 0.655) * (0.88 + 0.12 * block);
        let stone = stone * (0.88 + 0.2 * cloud(p, 6, 21));
        stone.lerp(DVec3::new(0.6, 0.54, 0.45), 0.8 * mortar)
    })
}

/// Floor slabs, two by two, light and dark marble in turn.
pub fn slabs() -> Texture {
    texture("slabs", |p| {
        let (x, y) = ((p.x * 2.0).floor() as u32, (p.y * 2.0).floor() as u32);
        let (base, vein) = if (x + y).is_multiple_of(2) {
            (DVec3::new(0.84, 0.79, 0.71), DVec3::new(0.62, 0.54, 0.45))
        } else {
            (DVec3::new(0.6, 0.45, 0.37), DVec3::new(0.74, 0.63, 0.53))
        };
        let joint = joint(p.x, 0.5).min(joint(p.y, 0.5));
        let grout = (1.0 - joint / 0.008).clamp(0.0, 1.0);
        marble(p, base, vein, 60 + 7 * (2 * x + y)).lerp(DVec3::splat(0.42), 0.7 * grout)
    })
}

/// Veined marble for columns.
pub fn veined() -> Texture {
    let (base, vein) = (DVec3::new(0.87, 0.82, 0.76), DVec3::new(0.58, 0.47, 0.4));
    texture("marble", |p| marble(p, base, vein, 11))
}
