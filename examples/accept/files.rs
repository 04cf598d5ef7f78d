//! Scenes built in memory, written as glTF and loaded back.

use base64::Engine;
use glam::DVec3;
use lightkiln::scene::{self, Scene};

/// Where a scene's distance from the origin goes.
#[derive(Clone, Copy, PartialEq)]
pub enum Offset {
    /// Into the translation of the node; vertices stay small.
    Node,
    /// Into the vertices, rounded to `f32` there.
    Vertices,
}

/// `scene` as the loader sees it after a round through a glTF file.
pub fn through_gltf(scene: &Scene, offset: Offset) -> Scene {
    let shift = match offset {
        Offset::Node => DVec3::ZERO,
        Offset::Vertices => scene.origin,
    };
    let positions: Vec<[f32; 3]> = scene
        .triangles
        .iter()
        .flat_map(|t| t.vertices)
        .map(|v| (scene.positions[v as usize].as_dvec3() + shift).as_vec3())
        .map(|p| p.to_array())
        .collect();
    let extreme = |pick: fn(f32, f32) -> f32| {
        positions
            .iter()
            .copied()
            .reduce(|a, b| std::array::from_fn(|k| pick(a[k], b[k])))
    };
    let bytes: &[u8] = bytemuck::cast_slice(&positions);
    let data = base64::engine::general_purpose::STANDARD.encode(bytes);
    let mut node = serde_json::json!({ "mesh": 0 });
    if offset == Offset::Node {
        node["translation"] = serde_json::json!(scene.origin.to_array());
    }
    let document = serde_json::json!({
        "asset": { "version": "2.0" },
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [node],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "material": 0 }] }],
        "materials": [{ "pbrMetallicRoughness": {
            "baseColorFactor": [0.5, 0.5, 0.5, 1.0],
            "metallicFactor": 0.0,
        } }],
        "buffers": [{
            "byteLength": bytes.len(),
            "uri": format!("data:application/octet-stream;base64,{data}"),
        }],
        "bufferViews": [{ "buffer": 0, "byteLength": bytes.len() }],
        "accessors": [{
            "bufferView": 0,
            "componentType": 5126,
            "count": positions.len(),
            "type": "VEC3",
            "min": extreme(f32::min),
            "max": extreme(f32::max),
        }],
    });
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = folder.path().join("scene.gltf");
    std::fs::write(&file, document.to_string()).expect("a written file");
    scene::load_file(&file).expect("a scene that loads")
}
