//! Decoding of images into [`Texture`]s, within limits that are checked before anything is decoded.

use super::material::{Texture, Wrap};
use image::{ImageReader, Limits, RgbaImage};
use std::io::Cursor;

/// Widest and highest texture read.
pub const MAX_TEXTURE_SIDE: u32 = 16384;
/// Most texels all textures of a scene may have together: 1 GiB of memory.
pub const MAX_SCENE_TEXELS: u64 = 1 << 28;

/// Decodes images and keeps account of their texels.
#[derive(Default)]
pub(super) struct Decoder {
    texels: u64,
}

impl Decoder {
    /// Decodes a PNG, JPEG, WebP or Radiance image of at most [`MAX_TEXTURE_SIDE`] a side.
    ///
    /// # Errors
    /// A message for the user.
    pub fn decode(&mut self, bytes: &[u8]) -> Result<RgbaImage, String> {
        let reader = || ImageReader::new(Cursor::new(bytes)).with_guessed_format();
        let open = || reader().map_err(|e| e.to_string());
        let (width, height) = open()?.into_dimensions().map_err(|e| e.to_string())?;
        if width == 0 || height == 0 || width.max(height) > MAX_TEXTURE_SIDE {
            return Err(format!(
                "{width} x {height} texels; 1 to {MAX_TEXTURE_SIDE} a side are read"
            ));
        }
        let texels = self.texels + u64::from(width) * u64::from(height);
        if texels > MAX_SCENE_TEXELS {
            return Err(format!(
                "the scene's textures exceed {MAX_SCENE_TEXELS} texels together"
            ));
        }
        let mut reader = open()?;
        let mut limits = Limits::default();
        limits.max_image_width = Some(MAX_TEXTURE_SIDE);
        limits.max_image_height = Some(MAX_TEXTURE_SIDE);
        limits.max_alloc = Some(16 * MAX_SCENE_TEXELS);
        reader.limits(limits);
        let image = reader.decode().map_err(|e| e.to_string())?.into_rgba8();
        self.texels = texels;
        Ok(image)
    }
}

/// A texture of an image, first row at `v = 0`.
pub(super) fn texture(name: String, image: &RgbaImage, srgb: bool, wrap: [Wrap; 2]) -> Texture {
    let texels = image.pixels().map(|p| p.0).collect();
    Texture {
        name,
        width: image.width(),
        height: image.height(),
        texels,
        srgb,
        wrap,
    }
}
