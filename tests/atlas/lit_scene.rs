//! The lit scene as GLB reads back as it was.

use super::scenes::mixed;
use super::{lay_out, options};
use glam::{DVec3, Vec2, Vec3};
use lightkiln::bake::lit_scene::write_glb;
use lightkiln::scene::material::{Material, Texture, TextureRef, Wrap};
use lightkiln::scene::{Bounds, Portal, Role, Scene};
use lightkiln_format::lighting::Light;

/// A scene that uses everything the lit file can hold.
fn furnished() -> Scene {
    let mut scene = mixed();
    scene.origin = DVec3::new(1000.0, 2.0, -3e5);
    scene.instances[0].role = Role::Dynamic;
    let texels = (0..12)
        .map(|i| [i * 20, 7, 255 - i, if i % 2 == 0 { 255 } else { 9 }])
        .collect();
    scene.textures.push(Texture {
        name: "leaf".into(),
        width: 4,
        height: 3,
        texels,
        srgb: true,
        wrap: [Wrap::Mirror, Wrap::Clamp],
    });
    let (sin, cos) = 0.3f32.sin_cos();
    let transform = [
        Vec2::new(cos * 2.0, sin * 3.0),
        Vec2::new(-sin * 2.0, cos * 3.0),
        Vec2::new(0.5, 0.1),
    ];
    scene.materials.push(Material {
        name: "leaf".into(),
        base_color: Vec3::new(0.6, 0.5, 0.1),
        base_color_texture: Some(TextureRef {
            texture: 0,
            transform,
        }),
        emissive: Vec3::new(4.0, 2.0, 0.0),
        emissive_texture: Some(TextureRef::new(0)),
        alpha_cutoff: Some(0.5),
        double_sided: true,
        transmission: 0.25,
        ..Material::default()
    });
    for t in 10..60 {
        scene.triangles[t].material = 1;
    }
    let position = DVec3::new(1003.0, 4.0, -3e5);
    let (direction, intensity) = (Vec3::new(0.6, -0.8, 0.0), Vec3::new(10.0, 5.0, 1.0));
    scene.lights = vec![
        Light::Point {
            position,
            intensity,
            radius: 0.1,
        },
        Light::Rectangle {
            position,
            half_u: Vec3::X,
            half_v: Vec3::Y,
            radiance: intensity,
        },
        Light::Spot {
            position,
            direction,
            intensity,
            inner_cone: 0.0,
            outer_cone: 0.5,
            radius: 0.0,
        },
        Light::Directional {
            direction: Vec3::Z,
            irradiance: intensity,
        },
    ];
    scene.portals.push(Portal {
        name: "window".into(),
        corners: [Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 0.0), Vec3::Y],
        inward: Vec3::Z,
    });
    scene.lamp_volumes.push(Bounds {
        min: Vec3::ZERO,
        max: Vec3::ONE,
    });
    scene
}

#[test]
fn the_lit_scene_reads_back() {
    let scene = furnished();
    let (uvs, _) = lay_out(&scene, &options(25.0));
    assert!(uvs.pages.len() > 1, "several pages");
    let bytes = write_glb(&scene, Some(&uvs)).unwrap();
    let file = gltf::Gltf::from_slice(&bytes).unwrap();
    let blob = file.blob.as_deref().unwrap();
    let root = file.default_scene().unwrap().nodes().next().unwrap();
    assert_eq!(root.transform().decomposed().0, [1000.0, 2.0, -3e5]);
    let nodes: Vec<_> = root.children().filter(|n| n.mesh().is_some()).collect();
    assert_eq!(nodes.len(), scene.instances.len());
    for (node, instance) in nodes.iter().zip(&scene.instances) {
        assert_eq!(node.name(), Some(instance.node.as_str()));
        let extras: serde_json::Value =
            serde_json::from_str(node.extras().as_ref().unwrap().get()).unwrap();
        assert_eq!(
            extras["lightkiln"]["role"],
            serde_json::json!(instance.role)
        );
        let mut triangles = 0;
        let mut bounds = Bounds::EMPTY;
        for primitive in node.mesh().unwrap().primitives() {
            let reader = primitive.reader(|_| Some(blob));
            triangles += reader.read_indices().unwrap().into_u32().count() / 3;
            for p in reader.read_positions().unwrap().map(Vec3::from) {
                bounds = Bounds {
                    min: bounds.min.min(p),
                    max: bounds.max.max(p),
                };
            }
            let lit = reader.read_tex_coords(1);
            assert_eq!(lit.is_some(), instance.role == Role::Static);
            for uv in lit.into_iter().flat_map(|l| l.into_f32()) {
                assert!(uv.iter().all(|x| (0.0..=1.0).contains(x)));
            }
        }
        assert_eq!(triangles, instance.triangles.len());
        assert_eq!(
            bounds,
            Bounds::of(instance.triangles.clone().flat_map(|t| scene.corners(t)))
        );
    }
    assert_eq!(file.lights().unwrap().count(), 3);
    let leaf = file.materials().nth(1).unwrap();
    assert_eq!(leaf.emissive_strength(), Some(4.0));
    let info = leaf.pbr_metallic_roughness().base_color_texture().unwrap();
    let transform = info.texture_transform().unwrap();
    assert!((transform.rotation() - 0.3).abs() < 1e-6);
    assert!((Vec2::from(transform.scale()) - Vec2::new(2.0, 3.0)).length() < 1e-5);
    let extras = file
        .default_scene()
        .unwrap()
        .extras()
        .as_ref()
        .unwrap()
        .get()
        .to_owned();
    let extras: serde_json::Value = serde_json::from_str(&extras).unwrap();
    assert_eq!(extras["lightkiln"]["portals"][0]["corners"][1][0], 1001.0);
    assert_eq!(
        extras["lightkiln"]["rectangle_lights"]
            .as_array()
            .unwrap()
            .len(),
        1
    );
    let plain = write_glb(&scene, None).unwrap();
    assert!(!String::from_utf8_lossy(&plain).contains("TEXCOORD_1"));
    assert!(gltf::Gltf::from_slice(&write_glb(&Scene::default(), None).unwrap()).is_ok());
}
