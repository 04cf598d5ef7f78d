use super::{check_consistent, finding, folder, load_square, png, square_json, write};
use glam::{DVec3, Vec2, Vec3, Vec4};
use lightkiln::scene::Role;
use lightkiln_format::lighting::Light;
use serde_json::json;

#[test]
fn hierarchy_places_and_mirrors() {
    let scene = load_square(json!({ "nodes": [
        { "name": "root", "translation": [0, 2, 0], "children": [1, 2] },
        { "name": "plain", "mesh": 0, "scale": [2, 1, 1] },
        { "name": "mirrored", "mesh": 0, "scale": [-1, 1, 1], "rotation": [1, 0, 0, 0] },
    ] }));
    check_consistent(&scene);
    assert_eq!(scene.triangles.len(), 4);
    assert_eq!(scene.instances[0].node, "plain");
    assert_eq!(scene.double_area_normal(0).length(), 2.0);
    assert!(scene.corners(0).iter().all(|p| p.y == 2.0 || p.y == 0.0));
    // Turned upside down by half a turn about x, then mirrored: the front now looks down.
    assert!(scene.double_area_normal(2).y < 0.0);
    for t in 0..4 {
        let shading = scene.normals[scene.triangles[t as usize].vertices[0] as usize];
        assert!(
            shading.dot(scene.double_area_normal(t)) > 0.0,
            "triangle {t}"
        );
    }
}

#[test]
fn authored_normals_turn_with_mirrored_and_stretched_nodes() {
    // A slope (y = x), its normal given; stretched ten times along x and mirrored along z.
    let slope = [
        [0.0f32, 0.0, 0.0],
        [0.0, 0.0, 1.0],
        [1.0, 1.0, 1.0],
        [1.0, 1.0, 0.0],
    ];
    let (mut root, mut bin) = square_json(
        &slope,
        json!({
            "nodes": [{ "mesh": 0, "scale": [10, 1, -1] }],
        }),
    );
    let start = bin.len();
    for _ in 0..4 {
        bin.extend([-1.0f32, 1.0, 0.0].iter().flat_map(|f| f.to_le_bytes()));
    }
    root["buffers"][0]["byteLength"] = json!(bin.len());
    root["bufferViews"]
        .as_array_mut()
        .expect("views")
        .push(json!({ "buffer": 0, "byteOffset": start, "byteLength": 48 }));
    root["accessors"]
        .as_array_mut()
        .expect("accessors")
        .push(json!({ "bufferView": 3, "componentType": 5126, "count": 4, "type": "VEC3" }));
    root["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = json!(3);
    let folder = folder();
    write(&folder, "square.bin", bin);
    let file = write(&folder, "scene.gltf", root.to_string());
    let scene = lightkiln::scene::load_file(&file).expect("loads");
    let geometric = scene.double_area_normal(0).normalize();
    assert!((geometric - Vec3::new(-0.1, 1.0, 0.0).normalize()).length() < 1e-6);
    assert!(
        scene
            .normals
            .iter()
            .all(|n| (*n - geometric).length() < 1e-6)
    );
}

#[test]
fn a_far_node_keeps_its_shape() {
    let scene = load_square(json!({ "nodes": [{ "mesh": 0, "translation": [1e7, 0, -1e7] }] }));
    assert_eq!(scene.origin, DVec3::new(1e7 + 0.5, 0.0, -1e7 + 0.5));
    assert_eq!(scene.double_area_normal(0), Vec3::Y);
    assert_eq!(scene.bounds().max, Vec3::new(0.5, 0.0, 0.5));
}

#[test]
fn textures_wrap_and_transform() {
    let folder = folder();
    // Left half red, right half blue; the top row of the image is at v = 0.
    let image = png(2, 1, |x, _| {
        if x == 0 {
            [255, 0, 0, 255]
        } else {
            [0, 0, 255, 255]
        }
    });
    write(&folder, "two.png", image);
    let (root, bin) = square_json(
        &super::SQUARE,
        json!({
            "images": [{ "uri": "two.png" }],
            "samplers": [{ "wrapS": 33071, "wrapT": 33648 }],
            "textures": [{ "source": 0 }, { "source": 0, "sampler": 0 }],
            "materials": [{ "pbrMetallicRoughness": { "metallicFactor": 0,
                "baseColorTexture": { "index": 0, "extensions": { "KHR_texture_transform":
                    { "offset": [0.5, 0], "scale": [2, 1] } } } },
                "emissiveFactor": [1, 1, 1], "emissiveTexture": { "index": 1 },
                "extensions": { "KHR_materials_emissive_strength": { "emissiveStrength": 3 } } }],
        }),
    );
    write(&folder, "square.bin", bin);
    let file = write(&folder, "scene.gltf", root.to_string());
    let scene = lightkiln::scene::load_file(&file).expect("loads");
    let material = &scene.materials[0];
    // u = 0.125 becomes 0.75: blue. u = 0.375 becomes 1.25, repeated 0.25: red.
    assert_eq!(
        material.albedo(&scene.textures, Vec2::new(0.125, 0.5)),
        Vec3::Z
    );
    assert_eq!(
        material.albedo(&scene.textures, Vec2::new(0.375, 0.5)),
        Vec3::X
    );
    assert_eq!(
        material.emission(&scene.textures, Vec2::new(5.0, 7.5)),
        Vec3::Z * 3.0
    );
    let clamped = &scene.textures[material.emissive_texture.expect("texture").texture as usize];
    assert_eq!(
        clamped.sample(Vec2::new(-9.0, 0.0)),
        Vec4::new(1.0, 0.0, 0.0, 1.0)
    );
    finding(&scene, "albedo above 0.98");
}

#[test]
fn the_base_colour_chooses_the_coordinate_set() {
    let folder = folder();
    write(&folder, "two.png", png(2, 2, |_, _| [9, 9, 9, 255]));
    let (mut root, bin) = square_json(
        &super::SQUARE,
        json!({
            "images": [{ "uri": "two.png" }], "textures": [{ "source": 0 }],
            "materials": [{ "pbrMetallicRoughness":
                { "baseColorTexture": { "index": 0, "texCoord": 1 } } }],
        }),
    );
    root["meshes"][0]["primitives"][0]["attributes"] = json!({ "POSITION": 0, "TEXCOORD_1": 1 });
    write(&folder, "square.bin", bin);
    let file = write(&folder, "scene.gltf", root.to_string());
    let scene = lightkiln::scene::load_file(&file).expect("loads");
    assert_eq!(scene.uvs[0], Vec2::splat(0.25));
    assert_eq!(scene.lightmap_uvs[0], Vec2::splat(0.25));
}

#[test]
fn missing_textures_leave_the_factor() {
    let scene = load_square(json!({
        "images": [{ "uri": "nowhere.png" }], "textures": [{ "source": 0 }],
        "materials": [{ "name": "lost", "pbrMetallicRoughness": { "metallicFactor": 0,
            "baseColorFactor": [0.1, 0.2, 0.3, 1], "baseColorTexture": { "index": 0 } } }],
    }));
    assert_eq!(scene.albedo_at(0, 0.3, 0.3), Vec3::new(0.1, 0.2, 0.3));
    assert_eq!(finding(&scene, "nowhere.png").element, "material `lost`");
}

#[test]
fn alpha_masks_cut_and_blending_is_opaque() {
    let folder = folder();
    let image = png(2, 2, |x, _| [255, 255, 255, if x == 0 { 0 } else { 255 }]);
    write(&folder, "mask.png", image);
    let texture = json!({ "index": 0 });
    let (root, bin) = square_json(
        &super::SQUARE,
        json!({
            "images": [{ "uri": "mask.png" }], "textures": [{ "source": 0 }],
            "materials": [
                { "alphaMode": "MASK", "alphaCutoff": 0.4, "doubleSided": true,
                  "pbrMetallicRoughness": { "baseColorTexture": texture, "metallicFactor": 0 } },
                { "name": "haze", "alphaMode": "BLEND", "pbrMetallicRoughness":
                  { "baseColorFactor": [1, 1, 1, 0.1], "metallicFactor": 0 } },
                { "name": "pane", "alphaMode": "BLEND",
                  "extensions": { "KHR_materials_transmission": { "transmissionFactor": 0.9 } } },
            ],
        }),
    );
    write(&folder, "square.bin", bin);
    let file = write(&folder, "scene.gltf", root.to_string());
    let scene = lightkiln::scene::load_file(&file).expect("loads");
    let [mask, haze, pane] = [0, 1, 2].map(|i| &scene.materials[i]);
    assert!(mask.double_sided && mask.alpha_cutoff == Some(0.4));
    assert!(!mask.covers(&scene.textures, Vec2::new(0.25, 0.5)));
    assert!(mask.covers(&scene.textures, Vec2::new(0.75, 0.5)));
    assert_eq!(haze.alpha_cutoff, None);
    assert_eq!(
        finding(&scene, "blends by alpha").element,
        "material `haze`"
    );
    assert_eq!(pane.transmission, 0.9);
    assert_eq!(
        finding(&scene, "transmits light").element,
        "material `pane`"
    );
}

#[test]
fn glass_is_a_portal_and_extras_give_roles() {
    let scene = load_square(json!({
        "materials": [
            { "name": "pane",
              "extensions": { "KHR_materials_transmission": { "transmissionFactor": 1 } } },
            { "name": "wall", "pbrMetallicRoughness": { "metallicFactor": 0 } },
        ],
        "meshes": [
            { "primitives": [{ "attributes": { "POSITION": 0 }, "material": 0 }] },
            { "primitives": [{ "attributes": { "POSITION": 0 }, "indices": 2, "material": 1 }] },
            { "primitives": [{ "attributes": { "POSITION": 0 }, "indices": 2, "material": 1 }],
              "extras": { "role": "occluder" } },
        ],
        "nodes": [
            { "name": "window", "mesh": 0 },
            { "name": "chair", "extras": { "role": "dynamic" }, "children": [2] },
            { "name": "seat", "mesh": 1 },
            { "name": "hill", "mesh": 2 },
            { "name": "odd", "mesh": 1, "extras": { "role": "door" } },
        ],
        "scenes": [{ "nodes": [0, 1, 3, 4] }],
    }));
    let roles: Vec<(&str, Role)> = scene
        .instances
        .iter()
        .map(|i| (i.node.as_str(), i.role))
        .collect();
    assert_eq!(
        roles,
        [
            ("window", Role::Portal),
            ("seat", Role::Dynamic),
            ("hill", Role::Occluder),
            ("odd", Role::Static),
        ]
    );
    assert_eq!(finding(&scene, "is no role").element, "node `odd`");
}

#[test]
fn lights_come_in_world_metres() {
    let folder = folder();
    let (root, bin) = square_json(
        &super::SQUARE,
        json!({
            "extensionsUsed": ["KHR_lights_punctual"],
            "extensions": { "KHR_lights_punctual": { "lights": [
                { "type": "point", "color": [1, 0.5, 0], "intensity": 8 },
                { "type": "spot", "intensity": 2,
                  "spot": { "innerConeAngle": 0.1, "outerConeAngle": 0.5 } },
                { "type": "directional", "intensity": 3 },
                { "type": "spot", "spot": { "innerConeAngle": 0.9, "outerConeAngle": 0.5 } },
            ] } },
            "nodes": [
                { "mesh": 0, "children": [1, 2, 3, 4], "translation": [0, 0, 10] },
                { "extensions": { "KHR_lights_punctual": { "light": 0 } }, "translation": [4, 2, 0] },
                // A quarter turn about x (not of unit length): -z becomes up (+y).
                { "extensions": { "KHR_lights_punctual": { "light": 1 } },
                  "rotation": [1, 0, 0, 1] },
                { "extensions": { "KHR_lights_punctual": { "light": 2 } } },
                { "name": "crossed", "extensions": { "KHR_lights_punctual": { "light": 3 } } },
            ],
        }),
    );
    write(&folder, "square.bin", bin);
    write(&folder, "scene.gltf", root.to_string());
    let scene = super::load_manifest(
        folder.path(),
        "[[scene]]\nname = 'a'\npath = 'scene.gltf'\nmetres_per_unit = 0.5",
    )
    .expect("loads");
    assert_eq!(scene.lights.len(), 3);
    let Light::Point {
        position,
        intensity,
        ..
    } = scene.lights[0]
    else {
        panic!("no point")
    };
    assert_eq!(position, DVec3::new(2.0, 1.0, 5.0));
    // Irradiance below: 8 / 2² in the file's units, 2 / 1² in metres.
    assert_eq!(intensity, Vec3::new(2.0, 1.0, 0.0));
    let Light::Spot { direction, .. } = scene.lights[1] else {
        panic!("no spot")
    };
    assert!((direction - Vec3::Y).length() < 1e-6);
    let Light::Directional {
        direction,
        irradiance,
    } = scene.lights[2]
    else {
        panic!("no sun")
    };
    assert_eq!((direction, irradiance), (Vec3::NEG_Z, Vec3::splat(3.0)));
    assert_eq!(
        finding(&scene, "light is left out").element,
        "node `crossed`"
    );
}

#[test]
fn strips_fans_and_quantised_positions() {
    let (mut root, mut bin) = square_json(
        &super::SQUARE,
        json!({
            "extensionsRequired": ["KHR_mesh_quantization"],
        }),
    );
    let start = bin.len();
    // Four corners in strip order, normalised bytes with a stride of four.
    for corner in [[0u8, 0, 0], [0, 0, 255], [255, 0, 0], [255, 0, 255]] {
        bin.extend([corner[0], corner[1], corner[2], 77]);
    }
    bin.extend([1u8, 3, 2, 0]);
    root["buffers"][0]["byteLength"] = json!(bin.len());
    let views = root["bufferViews"].as_array_mut().expect("views");
    views.push(json!({ "buffer": 0, "byteOffset": start, "byteLength": 16, "byteStride": 4 }));
    views.push(json!({ "buffer": 0, "byteOffset": start + 16, "byteLength": 4 }));
    let accessors = root["accessors"].as_array_mut().expect("accessors");
    accessors.push(
        json!({ "bufferView": 3, "componentType": 5121, "normalized": true,
        "count": 4, "type": "VEC3" }),
    );
    accessors.push(json!({ "bufferView": 4, "componentType": 5121, "count": 4, "type": "SCALAR" }));
    let primitive = |mode: u32, indices: Option<u32>| {
        let mut p = json!({ "attributes": { "POSITION": 3 }, "mode": mode, "material": 0 });
        if let Some(i) = indices {
            p["indices"] = json!(i);
        }
        p
    };
    root["meshes"] = json!([{ "primitives": [primitive(5, None), primitive(6, Some(4)),
        primitive(1, None)] }]);
    let folder = folder();
    write(&folder, "square.bin", bin);
    let file = write(&folder, "scene.gltf", root.to_string());
    let scene = lightkiln::scene::load_file(&file).expect("loads");
    check_consistent(&scene);
    assert_eq!((scene.triangles.len(), scene.instances.len()), (4, 1));
    for t in 0..4 {
        assert_eq!(scene.double_area_normal(t), Vec3::Y, "triangle {t}");
    }
    finding(&scene, "points and lines");
}

#[test]
fn computed_normals_are_smooth_below_45_degrees() {
    // Two squares that share an edge, folded by 30 and by 60 degrees.
    for (degrees, smooth) in [(30.0f32, true), (60.0, false)] {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let text = format!(
            "v 0 0 0\nv 0 0 1\nv 1 0 1\nv 1 0 0\nv {x} {y} 1\nv {x} {y} 0\nf 1 2 3 4\nf 4 3 5 6\n",
            x = 1.0 + cos,
            y = sin
        );
        let folder = folder();
        let file = write(&folder, "fold.obj", text);
        let scene = lightkiln::scene::load_file(&file).expect("loads");
        check_consistent(&scene);
        assert_eq!(scene.positions.len(), if smooth { 6 } else { 8 });
        let edge = scene
            .positions
            .iter()
            .position(|p| p.x == 1.0)
            .expect("edge");
        let tilt = scene.normals[edge].angle_between(Vec3::Y).to_degrees();
        assert!(
            (tilt - if smooth { 15.0 } else { 0.0 }).abs() < 8.0,
            "{tilt}"
        );
    }
}
