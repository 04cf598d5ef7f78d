use super::{folder, write};
use glam::{Vec2, Vec3};
use lightkiln::scene::environment::Environment;
use std::f64::consts::PI;

/// Writes an `.hdr` of the given texels and loads it.
fn environment(width: u32, height: u32, texel: impl Fn(u32, u32) -> [f32; 3]) -> Environment {
    let texels: Vec<image::Rgb<f32>> = (0..width * height)
        .map(|i| image::Rgb(texel(i % width, i / width)))
        .collect();
    let mut bytes = Vec::new();
    image::codecs::hdr::HdrEncoder::new(&mut bytes)
        .encode(&texels, width as usize, height as usize)
        .expect("encode");
    let folder = folder();
    Environment::load(&write(&folder, "sky.hdr", bytes)).expect("loads")
}

/// A sun, a band, a dark half.
fn sky() -> Environment {
    environment(16, 8, |x, y| match (x, y) {
        (3, 1) => [4096.0, 2048.0, 1024.0],
        (_, 3) => [1.0, 2.0, 4.0],
        (8.., 4..) => [0.0; 3],
        _ => [0.25; 3],
    })
}

/// Direction and solid angle of cell `(i, j)` of a fine grid, equal in phi and theta.
fn cells(n: usize) -> impl Iterator<Item = (Vec3, f64)> {
    (0..2 * n * n).map(move |k| {
        let (i, j) = (k % (2 * n), k / (2 * n));
        let phi = ((i as f64 + 0.5) / (2 * n) as f64 - 0.5) * 2.0 * PI;
        let theta = (j as f64 + 0.5) / n as f64 * PI;
        let height = (PI * j as f64 / n as f64).cos() - (PI * (j + 1) as f64 / n as f64).cos();
        let (sin, cos) = theta.sin_cos();
        let d = glam::DVec3::new(sin * phi.cos(), cos, sin * phi.sin()).as_vec3();
        (d, height * PI / n as f64)
    })
}

#[test]
fn directions_follow_the_convention() {
    let e = environment(8, 4, |x, y| [x as f32 + 1.0, y as f32 + 1.0, 0.0]);
    assert_eq!(e.lookup(Vec3::Y).y, 1.0);
    assert_eq!(e.lookup(Vec3::NEG_Y).y, 4.0);
    // The centre looks along +X; towards +Z the column grows.
    assert_eq!(
        e.lookup(Vec3::new(1.0, 0.1, 0.01)),
        Vec3::new(5.0, 2.0, 0.0)
    );
    assert_eq!(e.lookup(Vec3::new(0.01, 0.1, 1.0)).x, 6.0 + 0.0);
    assert_eq!(e.lookup(Vec3::new(0.01, 0.1, -1.0)).x, 3.0);
}

#[test]
fn the_density_integrates_to_one() {
    for e in [
        sky(),
        Environment::constant(Vec3::ONE),
        Environment::constant(Vec3::ZERO),
    ] {
        let integral: f64 = cells(256).map(|(d, w)| f64::from(e.pdf(d)) * w).sum();
        assert!((integral - 1.0).abs() < 1e-6, "{integral}");
    }
    let uniform = Environment::constant(Vec3::ONE).pdf(Vec3::X);
    assert!((f64::from(uniform) - 0.25 / PI).abs() < 1e-8);
}

#[test]
fn samples_follow_the_density_and_give_the_irradiance() {
    let e = sky();
    const N: u32 = 1 << 16;
    // A Hammersley set: no randomness, so bounds are those of a lattice, far below 1/sqrt(N).
    let points = (0..N).map(|i| {
        let radical = f64::from(i.reverse_bits()) / 4_294_967_296.0;
        Vec2::new(((f64::from(i) + 0.5) / f64::from(N)) as f32, radical as f32)
    });
    let mut counts = vec![0u32; 128];
    let mut flux = 0.0;
    for u in points {
        let (direction, radiance, pdf) = e.sample(u);
        assert!(direction.is_normalized() && pdf > 0.0);
        assert_eq!(
            (radiance, pdf),
            (e.lookup(direction), e.pdf(direction)),
            "{u}"
        );
        flux += f64::from(radiance.y / pdf) / f64::from(N);
        let theta = f64::from(direction.y).clamp(-1.0, 1.0).acos();
        let phi = f64::from(direction.z).atan2(f64::from(direction.x));
        let (x, y) = ((phi / (2.0 * PI) + 0.5) * 16.0, theta / PI * 8.0);
        counts[(y as usize).min(7) * 16 + (x as usize).min(15)] += 1;
    }
    let mut expected = vec![0.0; 128];
    let mut exact = 0.0;
    for (k, (d, w)) in cells(256).enumerate() {
        let (i, j) = (k % 512, k / 512);
        expected[j / 32 * 16 + i / 32] += f64::from(e.pdf(d)) * w;
        exact += f64::from(e.lookup(d).y) * w;
    }
    for (count, expected) in counts.iter().zip(expected) {
        let share = f64::from(*count) / f64::from(N);
        assert!((share - expected).abs() < 1e-3, "{share} {expected}");
    }
    assert!((flux / exact - 1.0).abs() < 2e-3, "{flux} {exact}");
}

#[test]
fn exr_is_read_and_bad_texels_become_black() {
    let folder = folder();
    let path = folder.path().join("sky.exr");
    exr::prelude::write_rgb_file(&path, 4, 2, |x, y| match (x, y) {
        (0, 0) => (f32::NAN, 1.0, 1.0),
        (1, 0) => (-1.0, 1.0, 1.0),
        (2, 0) => (f32::INFINITY, 1.0, 1.0),
        _ => (x as f32, y as f32, 0.5),
    })
    .expect("write");
    let e = Environment::load(&path).expect("loads");
    assert_eq!((e.width, e.height, e.repaired), (4, 2, 3));
    assert_eq!(e.radiance[0], Vec3::ZERO);
    assert_eq!(e.radiance[7], Vec3::new(3.0, 1.0, 0.5));
    let bytes = std::fs::read(&path).expect("read");
    for length in (0..bytes.len()).step_by(7) {
        let cut = write(&folder, "cut.exr", &bytes[..length]);
        assert!(Environment::load(&cut).is_err(), "cut to {length}");
    }
    let error = Environment::load(&write(&folder, "sky.bmp", "x")).expect_err("no format");
    assert!(error.to_string().contains("sky.bmp"));
}
