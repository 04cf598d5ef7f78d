//! Reads `scene.lit.glb` into what the forward pass draws.

use crate::texture::Textures;
use glam::{Mat4, Quat, Vec3};
use serde_json::Value;
use std::path::Path;

/// A vertex as drawn: 60 bytes.
#[repr(C)]
#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
pub struct Vertex {
    /// Metres, relative to the asset's origin.
    pub position: [f32; 3],
    /// Unit normal.
    pub normal: [f32; 3],
    /// Normalised lightmap coordinates in the page.
    pub lightmap: [f32; 2],
    /// Linear diffuse albedo, or its factor where there is a texture.
    pub albedo: [f32; 3],
    /// Page of the lightmap; negative without one.
    pub page: f32,
    /// Coordinates in the albedo's texture.
    pub uv: [f32; 2],
    /// Number of the albedo's texture; negative without one.
    pub texture: f32,
}

/// A lamp volume as `scene.lit.glb` holds it.
#[derive(serde::Deserialize)]
struct LampVolume {
    min: [f64; 3],
    max: [f64; 3],
}

/// Triangles with and without back-face culling.
#[derive(Debug, Default)]
pub struct Scene {
    /// All vertices.
    pub vertices: Vec<Vertex>,
    /// Triangles seen from the front only.
    pub single_sided: Vec<u32>,
    /// Triangles seen from both sides.
    pub double_sided: Vec<u32>,
    /// What albedos are multiplied by.
    pub textures: Textures,
    /// Boxes, world metres, where lamps may be.
    pub lamp_volumes: Vec<[[f64; 3]; 2]>,
}

impl Scene {
    /// Reads a binary glTF whose only root node stands at `origin` (metres).
    ///
    /// # Errors
    /// A message with the file, the element and what is wrong.
    pub fn read(path: &Path, origin: [f64; 3]) -> Result<Self, String> {
        let fail = |problem: String| format!("{}: {problem}", path.display());
        let bytes = std::fs::read(path).map_err(|e| fail(format!("cannot be read: {e}")))?;
        let file = gltf::Gltf::from_slice(&bytes).map_err(|e| fail(e.to_string()))?;
        let root_scene = file.default_scene().or_else(|| file.scenes().next());
        let root_scene = root_scene.ok_or_else(|| fail("has no scene".into()))?;
        let blob = file.blob.as_deref();
        let mut scene = Self {
            textures: Textures::read(&file, blob.unwrap_or_default()).map_err(fail)?,
            ..Self::default()
        };
        if let Some(volumes) = extras(root_scene.extras()).get("lamp_volumes") {
            let volumes: Vec<LampVolume> = serde_json::from_value(volumes.clone())
                .map_err(|e| fail(format!("scene extras: `lamp_volumes`: {e}")))?;
            scene.lamp_volumes = volumes.iter().map(|v| [v.min, v.max]).collect();
        }
        let mut roots = root_scene.nodes();
        let (Some(root), None) = (roots.next(), roots.next()) else {
            return Err(fail("the scene has not exactly one root node".into()));
        };
        let (translation, rotation, scale) = root.transform().decomposed();
        if translation != origin.map(|v| v as f32) {
            return Err(fail(format!(
                "the root stands at {translation:?}, the map at {origin:?}"
            )));
        }
        let upright = Mat4::from_scale_rotation_translation(
            scale.into(),
            Quat::from_array(rotation),
            Vec3::ZERO,
        );
        scene.add(&root, upright, blob).map_err(fail)?;
        Ok(scene)
    }

    fn add(
        &mut self,
        node: &gltf::Node<'_>,
        to_local: Mat4,
        blob: Option<&[u8]>,
    ) -> Result<(), String> {
        let about = extras(node.extras());
        let role = about
            .get("role")
            .and_then(Value::as_str)
            .unwrap_or("static");
        // Portals are openings; what is ignored is not there.
        if let (Some(mesh), false) = (node.mesh(), role == "portal" || role == "ignore") {
            for primitive in mesh.primitives() {
                let name = mesh.name().unwrap_or("without a name");
                self.add_primitive(&primitive, to_local, blob)
                    .map_err(|problem| format!("mesh `{name}`: {problem}"))?;
            }
        }
        for child in node.children() {
            let transform = Mat4::from_cols_array_2d(&child.transform().matrix());
            self.add(&child, to_local * transform, blob)?;
        }
        Ok(())
    }

    fn add_primitive(
        &mut self,
        primitive: &gltf::Primitive<'_>,
        to_local: Mat4,
        blob: Option<&[u8]>,
    ) -> Result<(), String> {
        if primitive.mode() != gltf::mesh::Mode::Triangles {
            return Ok(());
        }
        let reader = primitive.reader(|_| blob);
        let positions: Vec<_> = reader.read_positions().ok_or("has no POSITION")?.collect();
        let normals: Vec<_> = reader.read_normals().ok_or("has no NORMAL")?.collect();
        let page = extras(primitive.extras())
            .get("page")
            .and_then(Value::as_u64);
        let uv = reader
            .read_tex_coords(1)
            .map(|uv| uv.into_f32().collect::<Vec<_>>());
        let (uv, page) = match (uv, page) {
            (Some(uv), Some(page)) => (uv, page as f32),
            _ => (vec![[0.0; 2]; positions.len()], -1.0),
        };
        if normals.len() != positions.len() || uv.len() != positions.len() {
            return Err("its attributes differ in length".into());
        }
        let material = primitive.material();
        let base = material.pbr_metallic_roughness().base_color_texture();
        let texture = base.as_ref().map_or(-1.0, |t| t.texture().index() as f32);
        let uvs = match &base {
            Some(info) => Textures::coordinates(info, &reader)?,
            None => vec![[0.0; 2]; positions.len()],
        };
        if uvs.len() != positions.len() {
            return Err("its attributes differ in length".into());
        }
        let metallic = material.pbr_metallic_roughness().metallic_factor();
        let [r, g, b, _] = material.pbr_metallic_roughness().base_color_factor();
        let albedo = [r, g, b].map(|c| c * (1.0 - metallic));
        let normal_matrix = to_local.inverse().transpose();
        let base = self.vertices.len() as u32;
        let coordinates = uv.iter().zip(&uvs);
        for ((position, normal), (&lightmap, &uv)) in
            positions.iter().zip(&normals).zip(coordinates)
        {
            let normal = normal_matrix.transform_vector3(Vec3::from(*normal));
            self.vertices.push(Vertex {
                position: to_local.transform_point3(Vec3::from(*position)).into(),
                normal: normal.normalize_or_zero().into(),
                lightmap,
                albedo,
                page,
                uv,
                texture,
            });
        }
        let count = positions.len() as u32;
        let indices = reader
            .read_indices()
            .map(|i| i.into_u32().collect::<Vec<_>>());
        let mut indices = indices.unwrap_or_else(|| (0..count).collect());
        if indices.iter().any(|&i| i >= count) || !indices.len().is_multiple_of(3) {
            return Err("its indices leave its vertices, or are not triangles".into());
        }
        // A mirroring transform turns the winding round (glTF 2.0, section 3.7.4).
        if to_local.determinant() < 0.0 {
            indices
                .chunks_exact_mut(3)
                .for_each(|triangle| triangle.swap(1, 2));
        }
        let list = if material.double_sided() {
            &mut self.double_sided
        } else {
            &mut self.single_sided
        };
        list.extend(indices.iter().map(|i| base + i));
        Ok(())
    }
}

/// The `lightkiln` object of an element's extras, or null.
fn extras(extras: &gltf::json::Extras) -> Value {
    let value = extras
        .as_ref()
        .and_then(|raw| serde_json::from_str::<Value>(raw.get()).ok());
    value
        .and_then(|mut v| v.get_mut("lightkiln").map(Value::take))
        .unwrap_or_default()
}
