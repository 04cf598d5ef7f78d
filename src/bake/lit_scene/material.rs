//! Materials, textures and samplers.

use super::{Document, number, numbers, refuse};
use crate::error::Result;
use crate::scene::Scene;
use crate::scene::material::{Material, Texture, TextureRef, Wrap};
use glam::{Vec2, Vec3};
use image::{ExtendedColorType, ImageEncoder};
use serde_json::{Map, Value, json};

const TRANSFORM: &str = "KHR_texture_transform";
const STRENGTH: &str = "KHR_materials_emissive_strength";
const TRANSMISSION: &str = "KHR_materials_transmission";

/// Whether the material reads the first texture coordinates.
pub(super) fn textured(material: &Material) -> bool {
    material.base_color_texture.is_some()
        || material.metallic_texture.is_some()
        || material.emissive_texture.is_some()
}

/// Appends all textures to the document and returns the materials.
pub(super) fn write(scene: &Scene, document: &mut Document) -> Result<Vec<Value>> {
    for texture in &scene.textures {
        texture_entry(scene, texture, document)?;
    }
    scene
        .materials
        .iter()
        .map(|m| material(scene, m, document))
        .collect()
}

fn texture_entry(scene: &Scene, texture: &Texture, document: &mut Document) -> Result<()> {
    let view = document.view(&png(scene, texture)?, None);
    let image = json!({ "name": texture.name, "bufferView": view, "mimeType": "image/png" });
    document.images.push(image);
    let [s, t] = texture.wrap.map(|wrap| match wrap {
        Wrap::Repeat => 10497,
        Wrap::Mirror => 33648,
        Wrap::Clamp => 33071,
    });
    let sampler = json!({ "wrapS": s, "wrapT": t });
    let known = document.samplers.iter().position(|k| *k == sampler);
    let sampler = known.unwrap_or_else(|| {
        document.samplers.push(sampler);
        document.samplers.len() - 1
    });
    document
        .textures
        .push(json!({ "sampler": sampler, "source": document.images.len() - 1 }));
    Ok(())
}

fn png(scene: &Scene, texture: &Texture) -> Result<Vec<u8>> {
    let opaque = texture.texels.iter().all(|t| t[3] == u8::MAX);
    let (bytes, colour): (Vec<u8>, _) = if opaque {
        let rgb = texture.texels.iter().flat_map(|&[r, g, b, _]| [r, g, b]);
        (rgb.collect(), ExtendedColorType::Rgb8)
    } else {
        (
            texture.texels.as_flattened().to_vec(),
            ExtendedColorType::Rgba8,
        )
    };
    let mut file = Vec::new();
    image::codecs::png::PngEncoder::new(&mut file)
        .write_image(&bytes, texture.width, texture.height, colour)
        .map_err(|e| {
            let problem = format!("cannot be written as PNG: {e}");
            refuse(
                scene,
                &format!("texture `{}`", texture.name),
                &problem,
                "convert it to PNG",
            )
        })?;
    Ok(file)
}

fn material(scene: &Scene, material: &Material, document: &mut Document) -> Result<Value> {
    let mut reference = |texture: Option<TextureRef>| -> Result<Option<Value>> {
        texture
            .map(|t| texture_info(scene, material, t, document))
            .transpose()
    };
    let mut pbr = Map::new();
    let [r, g, b] = material.base_color.clamp(Vec3::ZERO, Vec3::ONE).to_array();
    pbr.insert(
        "baseColorFactor".into(),
        numbers([r, g, b, material.alpha.clamp(0.0, 1.0)]),
    );
    if let Some(info) = reference(material.base_color_texture)? {
        pbr.insert("baseColorTexture".into(), info);
    }
    pbr.insert(
        "metallicFactor".into(),
        number(material.metallic.clamp(0.0, 1.0)),
    );
    if let Some(info) = reference(material.metallic_texture)? {
        pbr.insert("metallicRoughnessTexture".into(), info);
    }
    let mut written = json!({ "name": material.name, "pbrMetallicRoughness": pbr });
    if let Some(info) = reference(material.emissive_texture)? {
        written["emissiveTexture"] = info;
    }
    let mut extensions = Map::new();
    if material.emits() {
        let strength = material.emissive.max_element().max(1.0);
        let factor = (material.emissive / strength).clamp(Vec3::ZERO, Vec3::ONE);
        written["emissiveFactor"] = numbers(factor.to_array());
        if strength > 1.0 {
            extensions.insert(
                STRENGTH.into(),
                json!({ "emissiveStrength": number(strength) }),
            );
            document.extensions.insert(STRENGTH);
        }
    }
    if let Some(cutoff) = material.alpha_cutoff {
        written["alphaMode"] = json!("MASK");
        written["alphaCutoff"] = number(cutoff.max(0.0));
    }
    if material.double_sided {
        written["doubleSided"] = json!(true);
    }
    if material.transmission > 0.0 {
        let factor = number(material.transmission.min(1.0));
        extensions.insert(TRANSMISSION.into(), json!({ "transmissionFactor": factor }));
        document.extensions.insert(TRANSMISSION);
    }
    if !extensions.is_empty() {
        written["extensions"] = Value::Object(extensions);
    }
    Ok(written)
}

fn texture_info(
    scene: &Scene,
    material: &Material,
    reference: TextureRef,
    document: &mut Document,
) -> Result<Value> {
    let mut info = json!({ "index": reference.texture });
    if reference != TextureRef::new(reference.texture) {
        let [scale, offset, rotation] = decompose(reference.transform).ok_or_else(|| {
            refuse(
                scene,
                &format!("material `{}`", material.name),
                "has a sheared texture transform, which KHR_texture_transform cannot hold",
                "bake the transform into the texture coordinates",
            )
        })?;
        let mut transform = json!({
            "offset": numbers(offset.to_array()), "scale": numbers(scale.to_array()),
        });
        if rotation.x != 0.0 {
            transform["rotation"] = number(rotation.x);
        }
        info["extensions"] = json!({ TRANSFORM: transform });
        document.extensions.insert(TRANSFORM);
    }
    Ok(info)
}

/// Scale, offset and rotation (in `x`) of rows `(c sx, s sy)` and `(-s sx, c sy)`; nothing if the
/// columns are not perpendicular to within their rounding.
fn decompose([row0, row1, offset]: [Vec2; 3]) -> Option<[Vec2; 3]> {
    let (first, second) = (Vec2::new(row0.x, row1.x), Vec2::new(row0.y, row1.y));
    let (sx, sy) = (first.length(), second.length());
    // Sine, cosine, and their products with the scales are each rounded once.
    if first.dot(second).abs() > 8.0 * f32::EPSILON * sx * sy {
        return None;
    }
    let mirrored = first.perp_dot(second) < 0.0;
    let rotation = if sx > 0.0 {
        (-first.y).atan2(first.x)
    } else {
        second.x.atan2(second.y)
    };
    Some([
        Vec2::new(sx, if mirrored { -sy } else { sy }),
        offset,
        Vec2::new(rotation, 0.0),
    ])
}
