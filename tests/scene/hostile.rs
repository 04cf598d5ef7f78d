use super::{finding, folder, square_gltf, square_json, write};
use lightkiln::error::Error;
use lightkiln::scene::load_file;
use serde_json::{Value, json};

fn refusal(extra: Value) -> Error {
    let folder = folder();
    load_file(&square_gltf(&folder, extra)).expect_err("must be refused")
}

fn glb(root: &Value, bin: &[u8]) -> Vec<u8> {
    let mut json = root.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut bin = bin.to_vec();
    bin.resize(bin.len().next_multiple_of(4), 0);
    let total = 12 + 8 + json.len() + 8 + bin.len();
    let mut bytes = b"glTF".to_vec();
    for part in [2u32, total as u32, json.len() as u32] {
        bytes.extend(part.to_le_bytes());
    }
    bytes.extend(b"JSON");
    bytes.extend(json);
    bytes.extend((bin.len() as u32).to_le_bytes());
    bytes.extend(b"BIN\0");
    bytes.extend(bin);
    bytes
}

#[test]
fn unsupported_required_extensions_are_named() {
    let error = refusal(json!({ "extensionsRequired": ["KHR_draco_mesh_compression"] }));
    assert!(
        error.to_string().contains("KHR_draco_mesh_compression"),
        "{error}"
    );
    assert!(error.remedy().is_some());
}

#[test]
fn a_glb_cut_anywhere_is_an_error() {
    let folder = folder();
    let (mut root, bin) = square_json(&super::SQUARE, json!({}));
    root["buffers"] = json!([{ "byteLength": bin.len() }]);
    let whole = glb(&root, &bin);
    assert_eq!(
        load_file(&write(&folder, "whole.glb", &whole))
            .expect("whole")
            .triangles
            .len(),
        2
    );
    for length in 0..whole.len() {
        let file = write(&folder, "cut.glb", &whole[..length]);
        assert!(load_file(&file).is_err(), "cut to {length} bytes");
    }
    // A header that claims less than itself.
    for claimed in [0u32, 11, 12, 19, u32::MAX] {
        let mut bytes = whole.clone();
        bytes[8..12].copy_from_slice(&claimed.to_le_bytes());
        assert!(
            load_file(&write(&folder, "claim.glb", bytes)).is_err(),
            "claims {claimed}"
        );
    }
}

#[test]
fn node_graphs_must_be_forests() {
    let cycle = refusal(json!({ "nodes": [
        { "name": "a", "children": [1] }, { "name": "b", "mesh": 0, "children": [0] } ] }));
    assert!(cycle.to_string().contains("node `a`"), "{cycle}");
    let twice = refusal(json!({ "nodes": [
        { "children": [2] }, { "children": [2] }, { "name": "shared", "mesh": 0 } ],
        "scenes": [{ "nodes": [0, 1] }] }));
    assert!(twice.to_string().contains("node `shared`"), "{twice}");
    let chain: Vec<Value> = (0..2000).map(|i| json!({ "children": [i + 1] })).collect();
    let chain = [chain, vec![json!({ "mesh": 0 })]].concat();
    assert!(
        refusal(json!({ "nodes": chain }))
            .to_string()
            .contains("ancestors")
    );
}

#[test]
fn accessors_are_held_against_the_file() {
    for (key, value) in [
        ("count", json!(4_000_000_000u64)),
        ("count", json!(u64::MAX)),
        ("byteOffset", json!(u64::MAX)),
        ("type", json!("VEC4")),
        ("bufferView", json!(99)),
    ] {
        let (mut root, bin) = square_json(&super::SQUARE, json!({}));
        root["accessors"][0][key] = value.clone();
        let folder = folder();
        write(&folder, "square.bin", bin);
        let file = write(&folder, "scene.gltf", root.to_string());
        let error = load_file(&file).expect_err("must be refused");
        assert!(
            error.to_string().contains("ccessor"),
            "{key} = {value}: {error}"
        );
    }
    // Zeros of a sparse accessor cost nothing in the file, and must not in memory.
    let (mut root, bin) = square_json(&super::SQUARE, json!({}));
    root["accessors"][0] = json!({ "componentType": 5126, "count": 4_000_000_000u64,
        "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 1], "sparse": { "count": 1,
        "indices": { "bufferView": 2, "componentType": 5123 }, "values": { "bufferView": 0 } } });
    let folder = folder();
    write(&folder, "square.bin", bin);
    let file = write(&folder, "scene.gltf", root.to_string());
    assert!(
        load_file(&file)
            .expect_err("refused")
            .to_string()
            .contains("accessor 0")
    );
}

#[test]
fn bad_triangles_are_dropped_and_listed() {
    let mut positions = super::SQUARE;
    positions[3] = [f32::NAN, 0.0, 0.0];
    let (mut root, mut bin) = square_json(&positions, json!({}));
    // Then: one that repeats a vertex, one that names a vertex of another mesh, one without area.
    positions[3] = [0.0, 0.0, 0.5];
    let start = bin.len();
    bin.extend(positions.iter().flatten().flat_map(|f| f.to_le_bytes()));
    bin.extend(
        [0u16, 1, 1, 0, 1, 9, 0, 1, 3]
            .iter()
            .flat_map(|i| i.to_le_bytes()),
    );
    root["buffers"][0]["byteLength"] = json!(bin.len());
    let views = root["bufferViews"].as_array_mut().expect("views");
    views.push(json!({ "buffer": 0, "byteOffset": start, "byteLength": 48 }));
    views.push(json!({ "buffer": 0, "byteOffset": start + 48, "byteLength": 18 }));
    let accessors = root["accessors"].as_array_mut().expect("accessors");
    accessors.push(json!({ "bufferView": 3, "componentType": 5126, "count": 4, "type": "VEC3" }));
    accessors.push(json!({ "bufferView": 4, "componentType": 5123, "count": 9, "type": "SCALAR" }));
    root["meshes"]
        .as_array_mut()
        .expect("meshes")
        .push(json!({ "name": "bad",
        "primitives": [{ "attributes": { "POSITION": 3 }, "indices": 4, "material": 0 }] }));
    root["nodes"]
        .as_array_mut()
        .expect("nodes")
        .push(json!({ "name": "worse", "mesh": 1 }));
    root["scenes"] = json!([{ "nodes": [0, 1] }]);
    let folder = folder();
    write(&folder, "square.bin", bin);
    let file = write(&folder, "scene.gltf", root.to_string());
    let scene = load_file(&file).expect("loads");
    super::check_consistent(&scene);
    assert_eq!(scene.triangles.len(), 1);
    let of = |text| {
        (
            finding(&scene, text).element.as_str(),
            finding(&scene, text).count,
        )
    };
    let worse = "node `worse`, mesh `bad`";
    assert_eq!(of("not finite"), ("node `floor`, mesh `square`", 1));
    assert_eq!(of("use a vertex twice"), (worse, 1));
    assert_eq!(of("do not exist"), (worse, 1));
    assert_eq!(of("without area"), (worse, 1));
}

#[test]
fn a_scene_without_surfaces_is_an_error() {
    let folder = folder();
    let file = write(&folder, "empty.obj", "v 0 0 0\n");
    let error = load_file(&file).expect_err("nothing to bake");
    assert!(error.to_string().contains("empty.obj"), "{error}");
}

#[test]
fn huge_images_are_refused_before_decoding() {
    let folder = folder();
    // The size field of a PNG, without the rest.
    let mut image = super::png(1, 1, |_, _| [0; 4]);
    image[16..24].copy_from_slice(&[0, 1, 0, 0, 0, 1, 0, 0]);
    let crc = crc32(&image[12..29]);
    image[29..33].copy_from_slice(&crc.to_be_bytes());
    write(&folder, "huge.png", image);
    let (root, bin) = square_json(
        &super::SQUARE,
        json!({
        "images": [{ "uri": "huge.png" }], "textures": [{ "source": 0 }],
        "materials": [{ "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } } }] }),
    );
    write(&folder, "square.bin", bin);
    let scene = load_file(&write(&folder, "scene.gltf", root.to_string())).expect("loads");
    assert!(scene.textures.is_empty());
    finding(&scene, "65536 x 65536");
}

fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(u32::MAX, |crc, &b| {
        (0..8).fold(crc ^ u32::from(b), |c, _| {
            (c >> 1) ^ (0xEDB8_8320 * (c & 1))
        })
    })
}
