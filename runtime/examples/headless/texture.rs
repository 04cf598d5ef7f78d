//! Base colour textures, all in one buffer of texels.

use glam::{Mat2, Vec2};
use gltf::texture::{Info, WrappingMode};

/// Largest sum of all textures' texels.
const MAX_TEXELS: usize = 1 << 27;

/// Textures as `forward.wgsl` reads them.
#[derive(Debug, Default)]
pub struct Textures {
    /// For each texture where its texels begin, width, height, and wrapping along u and v in two
    /// bits each: 0 repeats, 1 mirrors, 2 clamps.
    pub headers: Vec<[u32; 4]>,
    /// sRGB texels, red in the lowest byte.
    pub texels: Vec<[u8; 4]>,
}

impl Textures {
    /// Decodes the textures of a document whose images lie in its binary chunk.
    ///
    /// # Errors
    /// A message with the texture and what is wrong.
    pub fn read(document: &gltf::Document, blob: &[u8]) -> Result<Self, String> {
        let mut textures = Self::default();
        for texture in document.textures() {
            let fail = |problem: &str| format!("texture {}: {problem}", texture.index());
            let source = texture.source().map(|image| image.source());
            let Some(gltf::image::Source::View { view, .. }) = source else {
                return Err(fail("its image does not lie in the file"));
            };
            let bytes = blob
                .get(view.offset()..)
                .and_then(|b| b.get(..view.length()))
                .ok_or_else(|| fail("leaves the binary chunk"))?;
            let decoded = image::load_from_memory(bytes).map_err(|e| fail(&e.to_string()))?;
            let decoded = decoded.to_rgba8();
            let count = decoded.width() as usize * decoded.height() as usize;
            if textures.texels.len() + count > MAX_TEXELS {
                return Err(fail("the textures are too large together"));
            }
            let wrap = |mode| match mode {
                WrappingMode::Repeat => 0,
                WrappingMode::MirroredRepeat => 1,
                WrappingMode::ClampToEdge => 2,
            };
            let sampler = texture.sampler();
            textures.headers.push([
                textures.texels.len() as u32,
                decoded.width(),
                decoded.height(),
                wrap(sampler.wrap_s()) | wrap(sampler.wrap_t()) << 2,
            ]);
            textures.texels.extend(decoded.pixels().map(|p| p.0));
        }
        Ok(textures)
    }

    /// The coordinates that a material's texture is read at, one a vertex.
    ///
    /// # Errors
    /// A message if the primitive has none.
    pub fn coordinates<'a, 's, F: Clone + Fn(gltf::Buffer<'a>) -> Option<&'s [u8]>>(
        info: &Info<'_>,
        reader: &gltf::mesh::Reader<'a, 's, F>,
    ) -> Result<Vec<[f32; 2]>, String> {
        let transform = info.texture_transform();
        let set = transform.as_ref().and_then(|t| t.tex_coord());
        let set = set.unwrap_or(info.tex_coord());
        let uvs = reader.read_tex_coords(set);
        let uvs = uvs
            .ok_or_else(|| format!("has no TEXCOORD_{set}"))?
            .into_f32();
        let Some(transform) = transform else {
            return Ok(uvs.collect());
        };
        // Rotation is counter-clockwise in texture space, whose v points down.
        let turn = Mat2::from_angle(-transform.rotation());
        let (scale, offset) = (
            Vec2::from(transform.scale()),
            Vec2::from(transform.offset()),
        );
        let place = |uv| (turn * (scale * Vec2::from(uv)) + offset).to_array();
        Ok(uvs.map(place).collect())
    }
}
