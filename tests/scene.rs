/// Environments: lookup and sampling.
mod environment;
/// glTF: hierarchy, textures, lights, repairs.
mod gltf;
/// Files that must be refused or repaired, never trusted.
mod hostile;
/// Manifest: messages, roles, overrides, units.
mod manifest;
/// OBJ and MTL.
mod obj;
/// The larger scenes, where they are present.
mod shared;

use lightkiln::scene::{Finding, Scene};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// A unit square in the xz plane, facing `+Y`.
const SQUARE: [[f32; 3]; 4] = [
    [0.0, 0.0, 0.0],
    [0.0, 0.0, 1.0],
    [1.0, 0.0, 1.0],
    [1.0, 0.0, 0.0],
];

fn folder() -> TempDir {
    tempfile::tempdir().expect("temporary folder")
}

fn write(folder: &TempDir, name: &str, bytes: impl AsRef<[u8]>) -> PathBuf {
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).expect("write test file");
    path
}

/// One square in a buffer with its indices; `extra` replaces and adds top-level keys.
fn square_json(positions: &[[f32; 3]; 4], extra: Value) -> (Value, Vec<u8>) {
    let mut bin: Vec<u8> = positions
        .iter()
        .flatten()
        .flat_map(|f| f.to_le_bytes())
        .collect();
    for uv in [[0.25f32, 0.25], [0.25, 0.75], [0.75, 0.75], [0.75, 0.25]] {
        bin.extend(uv.iter().flat_map(|f| f.to_le_bytes()));
    }
    bin.extend([0u16, 1, 2, 0, 2, 3].iter().flat_map(|i| i.to_le_bytes()));
    let mut root = json!({
        "asset": { "version": "2.0" },
        "buffers": [{ "byteLength": bin.len(), "uri": "square.bin" }],
        "bufferViews": [
            { "buffer": 0, "byteOffset": 0, "byteLength": 48 },
            { "buffer": 0, "byteOffset": 48, "byteLength": 32 },
            { "buffer": 0, "byteOffset": 80, "byteLength": 12 },
        ],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3",
              "min": [0, 0, 0], "max": [1, 1, 1] },
            { "bufferView": 1, "componentType": 5126, "count": 4, "type": "VEC2" },
            { "bufferView": 2, "componentType": 5123, "count": 6, "type": "SCALAR" },
        ],
        "materials": [{ "name": "paint", "pbrMetallicRoughness":
            { "baseColorFactor": [0.5, 0.5, 0.5, 1], "metallicFactor": 0 } }],
        "meshes": [{ "name": "square", "primitives": [{
            "attributes": { "POSITION": 0, "TEXCOORD_0": 1 }, "indices": 2, "material": 0 }] }],
        "nodes": [{ "name": "floor", "mesh": 0 }],
        "scenes": [{ "nodes": [0] }],
    });
    for (key, value) in extra.as_object().expect("object") {
        root[key] = value.clone();
    }
    (root, bin)
}

/// Writes [`square_json`] as `scene.gltf` and `square.bin`.
fn square_gltf(folder: &TempDir, extra: Value) -> PathBuf {
    let (root, bin) = square_json(&SQUARE, extra);
    write(folder, "square.bin", bin);
    write(folder, "scene.gltf", root.to_string())
}

fn load_square(extra: Value) -> Scene {
    let folder = folder();
    lightkiln::scene::load_file(&square_gltf(&folder, extra)).expect("scene loads")
}

/// Loads the only scene of a manifest's text; `path` must be in it.
fn load_manifest(folder: &Path, text: &str) -> lightkiln::error::Result<Scene> {
    let file = folder.join("pipeline.toml");
    let manifest = lightkiln::manifest::Manifest::parse(text, &file)?;
    lightkiln::scene::load(&file, &manifest.scenes[0])
}

fn png(width: u32, height: u32, texel: impl Fn(u32, u32) -> [u8; 4]) -> Vec<u8> {
    let image = image::RgbaImage::from_fn(width, height, |x, y| texel(x, y).into());
    let mut bytes = std::io::Cursor::new(Vec::new());
    image
        .write_to(&mut bytes, image::ImageFormat::Png)
        .expect("encode");
    bytes.into_inner()
}

fn finding<'a>(scene: &'a Scene, text: &str) -> &'a Finding {
    let found = scene.findings.iter().find(|f| f.what.contains(text));
    found.unwrap_or_else(|| panic!("no finding with `{text}` in {:#?}", scene.findings))
}

/// The scene's normals agree with its windings, and every array has one entry a vertex.
fn check_consistent(scene: &Scene) {
    let n = scene.positions.len();
    assert_eq!(
        [
            scene.normals.len(),
            scene.uvs.len(),
            scene.lightmap_uvs.len()
        ],
        [n; 3]
    );
    assert!(scene.positions.iter().all(|p| p.is_finite()));
    assert!(scene.normals.iter().all(|p| p.is_normalized()));
    let mut end = 0;
    for (i, instance) in scene.instances.iter().enumerate() {
        assert_eq!(instance.triangles.start, end);
        assert!(instance.triangles.end > end, "instance {i} is empty");
        end = instance.triangles.end;
        for t in instance.triangles.clone() {
            assert_eq!(scene.triangles[t as usize].instance as usize, i);
            assert!(scene.double_area_normal(t).try_normalize().is_some());
            assert!((scene.triangles[t as usize].material as usize) < scene.materials.len());
        }
    }
    assert_eq!(end as usize, scene.triangles.len());
}
