//! The project's own scenes: the committed files are what the generator makes, closed, and lit only
//! from open space.

#[path = "../examples/make_assets/scenes/mod.rs"]
mod scenes;

use glam::Vec3;
use lightkiln::bake::lit_scene::write_glb;
use lightkiln::manifest::Manifest;
use lightkiln::scene::Scene;
use lightkiln::trace::sampler::{cosine, mix, sobol, sphere};
use lightkiln::trace::{Build, Hit, NO_TRIANGLE, Ray, Tracer};
use std::path::{Path, PathBuf};

/// Sobol points a lamp volume.
const POINTS: u32 = 4096;

/// Paths and bounces of the leak test: a million rays a scene.
const PATHS: u32 = 50_000;
const BOUNCES: u32 = 20;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).to_path_buf()
}

/// The scenes as the worked manifest loads them.
fn loaded() -> Vec<Scene> {
    let file = root().join("pipeline.toml");
    let manifest = Manifest::read(&file).expect("the worked manifest");
    let load = |spec| lightkiln::scene::load(&file, spec).expect("a scene of the worked manifest");
    manifest.scenes.iter().map(load).collect()
}

/// Whether every hit is the front of a triangle.
fn all_fronts(tracer: &Tracer, rays: &[Ray], hits: &[Hit]) -> bool {
    let front = |(ray, hit): (&Ray, &Hit)| hit.is_hit() && tracer.surface(ray, hit).front;
    rays.iter().zip(hits).all(front)
}

/// `count` rays in all directions from points all over the scene's lamp volumes.
fn from_lamps(scene: &Scene, count: u32) -> Vec<Ray> {
    let volumes = &scene.lamp_volumes;
    let ray = |i: u32| {
        let volume = volumes[i as usize % volumes.len()];
        let [u, v, w, a] = sobol(i % 65536, 0, 17);
        let [b, ..] = sobol(i % 65536, 1, 17);
        let origin = volume.min + (volume.max - volume.min) * Vec3::new(u, v, w);
        Ray::new(origin, sphere(a, b), NO_TRIANGLE)
    };
    (0..count).map(ray).collect()
}

#[test]
fn committed_files_are_what_the_generator_makes() {
    for scene in scenes::all() {
        let made = write_glb(&scene, None).expect("a scene that glTF can hold");
        let name = format!("assets/{0}/{0}.glb", scene.name);
        let committed = std::fs::read(root().join(&name)).expect(&name);
        let advice = "differs: run `cargo run --release --example make_assets`";
        assert!(made == committed, "{name} {advice}");
    }
}

#[test]
fn the_scenes_have_the_size_they_are_described_with() {
    let [room, chamber] = scenes::all();
    assert!((1_000..2_000).contains(&room.triangles.len()));
    assert!((3_000..=3_600).contains(&chamber.triangles.len()));
}

#[test]
fn albedos_are_plausible() {
    for scene in loaded() {
        assert!(scene.findings.is_empty(), "{:?}", scene.findings);
        for t in 0..scene.triangles.len() as u32 {
            for [u, v] in [[0.1, 0.1], [0.8, 0.1], [0.1, 0.8], [0.3, 0.3]] {
                let albedo = scene.albedo_at(t, u, v);
                let range = albedo.min_element() >= 0.03 && albedo.max_element() <= 0.85;
                assert!(range, "{}: triangle {t}: {albedo}", scene.name);
            }
            assert!(!scene.material_of(t).double_sided);
        }
    }
}

#[test]
fn lamp_volumes_lie_in_open_space() {
    for scene in loaded() {
        let tracer = Tracer::new(&scene, Build::Good);
        let rays = from_lamps(&scene, POINTS * scene.lamp_volumes.len() as u32);
        let mut hits = vec![Hit::MISS; rays.len()];
        tracer.closest(&rays, &mut hits);
        assert!(all_fronts(&tracer, &rays, &hits), "{}", scene.name);
    }
}

/// Diffuse walks from the lamps neither leave a scene nor ever see a surface from behind.
#[test]
fn the_scenes_are_closed_to_light() {
    for scene in loaded() {
        let tracer = Tracer::new(&scene, Build::Good);
        let mut rays = from_lamps(&scene, PATHS);
        let mut hits = vec![Hit::MISS; rays.len()];
        for bounce in 0..BOUNCES {
            tracer.closest(&rays, &mut hits);
            let behind = rays.iter().zip(&hits);
            let behind: Vec<_> = behind
                .filter(|(ray, hit)| !hit.is_hit() || !tracer.surface(ray, hit).front)
                .collect();
            let count = behind.len();
            let first = behind.first();
            assert_eq!(count, 0, "{}, bounce {bounce}: {first:?}", scene.name);
            for (i, (ray, hit)) in rays.iter_mut().zip(&hits).enumerate() {
                let point = tracer.surface(ray, hit);
                let [u, v, ..] = sobol(i as u32, 2 + bounce, mix(bounce, 29));
                let direction = cosine(point.normal, u, v);
                *ray = Ray::new(point.position, direction, point.triangle);
            }
        }
    }
}
