//! glTF materials and textures, reduced to what diffuse transport needs.

use super::accessor::Buffers;
use crate::scene::loaded::Loaded;
use crate::scene::material::{Material, TextureRef, Wrap};
use crate::scene::resource::read_uri;
use crate::scene::texture::{Decoder, texture};
use ::gltf::Document;
use ::gltf::material::AlphaMode;
use ::gltf::texture::{Info, Texture, WrappingMode};
use glam::{Vec2, Vec3, Vec4};
use std::collections::HashMap;

/// Transmission from which glass is taken for a portal unless the manifest says otherwise.
pub(super) const PORTAL_TRANSMISSION: f32 = 0.5;

/// Reads materials, each texture once for each colour space.
pub(super) struct Materials<'a> {
    document: &'a Document,
    buffers: &'a Buffers<'a>,
    decoder: Decoder,
    read: HashMap<(usize, bool), Option<u32>>,
    /// Texture coordinate set of each material.
    pub sets: Vec<u32>,
}

impl<'a> Materials<'a> {
    /// Reads nothing yet.
    pub fn new(document: &'a Document, buffers: &'a Buffers<'a>) -> Self {
        let (decoder, read) = (Decoder::default(), HashMap::new());
        Self {
            document,
            buffers,
            decoder,
            read,
            sets: Vec::new(),
        }
    }

    /// Adds a material; the file's default one has no index.
    pub fn add(&mut self, gltf: &::gltf::Material<'_>, loaded: &mut Loaded) {
        let name = match (gltf.name(), gltf.index()) {
            (Some(name), _) => name.to_owned(),
            (None, Some(index)) => format!("material {index}"),
            (None, None) => "default".to_owned(),
        };
        let pbr = gltf.pbr_metallic_roughness();
        let base_color = Vec4::from(pbr.base_color_factor());
        let transmission = gltf.transmission().map_or(0.0, |t| t.transmission_factor());

        let infos = [
            pbr.base_color_texture(),
            pbr.metallic_roughness_texture(),
            gltf.emissive_texture(),
        ];
        let sets: Vec<u32> = infos.iter().flatten().map(set_of).collect();
        let set = sets.first().copied().unwrap_or(0);
        if sets.iter().any(|&s| s != set) {
            let what = format!(
                "textures use several texture coordinate sets; all are read with set {set}"
            );
            loaded.find(format!("material `{name}`"), what, 1);
        }
        self.sets.push(set);

        let [base, metallic, emissive] = infos;
        let mut read = |info: Option<Info<'_>>, srgb| {
            info.and_then(|info| self.texture(&info, srgb, &name, loaded))
        };
        let material = Material {
            base_color: base_color.truncate(),
            alpha: base_color.w,
            base_color_texture: read(base, true),
            metallic: pbr.metallic_factor(),
            metallic_texture: read(metallic, false),
            emissive: Vec3::from(gltf.emissive_factor()) * gltf.emissive_strength().unwrap_or(1.0),
            emissive_texture: read(emissive, true),
            alpha_cutoff: match gltf.alpha_mode() {
                AlphaMode::Mask => Some(gltf.alpha_cutoff().unwrap_or(0.5)),
                AlphaMode::Opaque | AlphaMode::Blend => None,
            },
            double_sided: gltf.double_sided(),
            transmission,
            name,
        };

        let element = format!("material `{}`", material.name);
        let portal = transmission >= PORTAL_TRANSMISSION;
        if portal {
            let what = "transmits light: a portal unless the manifest gives it another role";
            loaded.find(&element, what, 1);
        } else if gltf.alpha_mode() == AlphaMode::Blend {
            loaded.find(&element, "blends by alpha: taken as opaque", 1);
        }
        if gltf.unlit() {
            loaded.find(&element, "is unlit: its base colour is taken as albedo", 1);
        }
        let role = super::role_in(gltf.extras(), &element, loaded);
        loaded
            .material_roles
            .push(role.or(portal.then_some(crate::scene::Role::Portal)));
        loaded.materials.push(material);
    }

    fn texture(
        &mut self,
        info: &Info<'_>,
        srgb: bool,
        material: &str,
        loaded: &mut Loaded,
    ) -> Option<TextureRef> {
        let gltf = info.texture();
        let index = match self.read.get(&(gltf.index(), srgb)) {
            Some(&known) => known,
            None => {
                let read = self.decode(&gltf, srgb, material, loaded);
                self.read.insert((gltf.index(), srgb), read);
                read
            }
        }?;
        Some(TextureRef {
            transform: transform_of(info),
            ..TextureRef::new(index)
        })
    }

    fn decode(
        &mut self,
        gltf: &Texture<'_>,
        srgb: bool,
        material: &str,
        loaded: &mut Loaded,
    ) -> Option<u32> {
        let (name, bytes) = match self.bytes(gltf) {
            Ok(found) => found,
            Err((name, problem)) => return missing(&name, &problem, material, loaded),
        };
        match self.decoder.decode(&bytes) {
            Ok(image) => {
                let sampler = gltf.sampler();
                let wrap = [wrap_of(sampler.wrap_s()), wrap_of(sampler.wrap_t())];
                loaded.textures.push(texture(name, &image, srgb, wrap));
                Some(loaded.textures.len() as u32 - 1)
            }
            Err(problem) => missing(&name, &problem, material, loaded),
        }
    }

    /// Name and bytes of a texture's image; on failure its name and the reason.
    fn bytes(&self, gltf: &Texture<'_>) -> Result<(String, Vec<u8>), (String, String)> {
        // The crate's own accessors panic on images without source or media type: read the JSON.
        let json = self.document.as_json();
        let webp = gltf
            .extension_value("EXT_texture_webp")
            .and_then(|e| e.get("source")?.as_u64());
        let plain = json.textures[gltf.index()].source.value();
        let index = webp.map_or(plain, |n| n as usize);
        let name = format!("texture {}", gltf.index());
        let Some(image) = json.images.get(index) else {
            return Err((name, "has no image in a format that is read".into()));
        };
        let file = image.uri.as_deref().filter(|uri| !uri.starts_with("data:"));
        let name = image
            .name
            .as_deref()
            .or(file)
            .map_or(format!("image {index}"), Into::into);
        let view = image
            .buffer_view
            .and_then(|v| self.document.views().nth(v.value()));
        let bytes = match (view, &image.uri) {
            (Some(view), _) => self.buffers.view(&view).map(<[u8]>::to_vec),
            (None, Some(uri)) => read_uri(self.buffers.file, uri),
            (None, None) => Err("has neither URI nor buffer view".into()),
        };
        bytes
            .map(|b| (name.clone(), b))
            .map_err(|problem| (name, problem))
    }
}

fn missing(name: &str, problem: &str, material: &str, loaded: &mut Loaded) -> Option<u32> {
    let what = format!("texture `{name}` is not used, the factor alone is: {problem}");
    loaded.find(format!("material `{material}`"), what, 1);
    None
}

/// Texture coordinate set; `KHR_texture_transform` may override the texture's own.
fn set_of(info: &Info<'_>) -> u32 {
    info.texture_transform()
        .and_then(|t| t.tex_coord())
        .unwrap_or_else(|| info.tex_coord())
}

/// `translation * rotation * scale` of `KHR_texture_transform`.
fn transform_of(info: &Info<'_>) -> [Vec2; 3] {
    let Some(transform) = info.texture_transform() else {
        return [Vec2::X, Vec2::Y, Vec2::ZERO];
    };
    let (sin, cos) = transform.rotation().sin_cos();
    let scale = Vec2::from(transform.scale());
    [
        Vec2::new(cos, sin) * scale,
        Vec2::new(-sin, cos) * scale,
        Vec2::from(transform.offset()),
    ]
}

fn wrap_of(mode: WrappingMode) -> Wrap {
    match mode {
        WrappingMode::Repeat => Wrap::Repeat,
        WrappingMode::MirroredRepeat => Wrap::Mirror,
        WrappingMode::ClampToEdge => Wrap::Clamp,
    }
}
