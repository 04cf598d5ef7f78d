//! The example renders a small room: what can be seen is as it must be.

use crate::{gpu, room};
use forward::Options;
use std::path::Path;

#[path = "../examples/headless/forward.rs"]
mod forward;

fn options(dir: &Path, more: &[&str]) -> Options {
    let arguments = [dir.to_str().unwrap()]
        .into_iter()
        .chain(more.iter().copied());
    Options::parse(arguments.map(String::from)).unwrap()
}

/// Mean of one channel, 0 to 255, over a part of a picture given in shares of its size.
fn mean(path: &Path, part: [f32; 4], channel: usize) -> f64 {
    let picture = image::open(path).unwrap().to_rgb8();
    let (w, h) = (picture.width() as f32, picture.height() as f32);
    let inside = |x: u32, y: u32| {
        let (x, y) = (x as f32 / w, y as f32 / h);
        x >= part[0] && x < part[2] && y >= part[1] && y < part[3]
    };
    let values = picture
        .enumerate_pixels()
        .filter(|(x, y, _)| inside(*x, *y));
    let values: Vec<_> = values.map(|(_, _, p)| f64::from(p.0[channel])).collect();
    values.iter().sum::<f64>() / values.len() as f64
}

#[test]
fn the_example_lights_a_room() {
    if gpu::open().is_none() {
        return;
    }
    // Kept, so that the pictures can be looked at.
    let dir = Path::new(env!("CARGO_TARGET_TMPDIR")).join("headless");
    std::fs::create_dir_all(&dir).unwrap();
    let prm = room::prm();
    let written = prm.write(&dir.join("prm.safetensors")).unwrap();
    room::write_glb(&dir.join("scene.lit.glb"));
    println!(
        "{} points, {} cells, {} rows, {} bytes",
        prm.point_texel.len(),
        prm.cells(),
        prm.row_cell.len(),
        written.bytes
    );

    println!(
        "{}",
        forward::run(&options(&dir, &["--size", "720x480"])).unwrap()
    );
    let (direct, lit) = (dir.join("direct.png"), dir.join("lit.png"));
    let whole = [0.0, 0.0, 1.0, 1.0];
    for channel in 0..3 {
        let (a, b) = (mean(&direct, whole, channel), mean(&lit, whole, channel));
        assert!(
            b > a + 5.0,
            "channel {channel}: lit {b} is not brighter than direct {a}"
        );
    }
    let sheet = image::open(dir.join("sheet.png")).unwrap();
    assert_eq!((sheet.width(), sheet.height()), (3 * 720 + 16, 480));

    // A lamp low behind the block: the near floor gets no direct light, but indirect.
    let text = |p: [f64; 3]| {
        let p = room::world(p);
        format!("{},{},{}", p.x, p.y, p.z)
    };
    let (lamp, camera, target) = (
        text([0.66, 0.15, 0.8]),
        text([0.66, 0.5, 0.1]),
        text([0.66, 0.0, 0.4]),
    );
    let out = dir.join("shadow");
    let more = [
        "--lamp",
        &lamp,
        "--camera",
        &camera,
        "--target",
        &target,
        "--fov",
        "30",
        "--size",
        "120x120",
        "--exposure",
        "1",
        "--out",
        out.to_str().unwrap(),
    ];
    println!("{}", forward::run(&options(&dir, &more)).unwrap());
    let middle = [0.45, 0.45, 0.55, 0.55];
    assert_eq!(
        mean(&out.join("direct.png"), middle, 1),
        0.0,
        "light leaks through the block"
    );
    assert!(
        mean(&out.join("lit.png"), middle, 1) > 2.0,
        "no indirect light in the shadow"
    );
}

#[test]
fn wrong_arguments_and_files_are_messages() {
    for (arguments, word) in [
        (vec![], "folder"),
        (vec!["d", "--lamp"], "--lamp"),
        (vec!["d", "--lamp", "1,2"], "1,2"),
        (vec!["d", "--lamp", "1,2,x"], "1,2,x"),
        (vec!["d", "--size", "0x5"], "0x5"),
        (vec!["d", "--fov", "-3"], "-3"),
        (vec!["d", "--speed", "3"], "--speed"),
    ] {
        let error = Options::parse(arguments.into_iter().map(String::from)).unwrap_err();
        assert!(error.contains(word), "{error}");
    }
    let error = forward::run(&options(Path::new("missing"), &[])).unwrap_err();
    assert!(error.contains("prm.safetensors"), "{error}");
}
