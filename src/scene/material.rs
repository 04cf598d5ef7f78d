//! Materials reduced to what diffuse transport needs, and the textures they read.

use glam::{Vec2, Vec3, Vec4};
use std::sync::LazyLock;

/// A surface: Lambertian with albedo `base_color * (1 - metallic)`, emission, coverage.
#[derive(Debug, Clone, PartialEq)]
pub struct Material {
    /// Name in the file, or `material N`.
    pub name: String,
    /// Linear base colour factor.
    pub base_color: Vec3,
    /// Alpha factor.
    pub alpha: f32,
    /// Texture times which the base colour (and alpha) is multiplied.
    pub base_color_texture: Option<TextureRef>,
    /// Metallic factor.
    pub metallic: f32,
    /// Metallic-roughness texture; its blue channel multiplies `metallic`.
    pub metallic_texture: Option<TextureRef>,
    /// Emitted radiance factor, W/(m² sr), linear RGB.
    pub emissive: Vec3,
    /// Texture times which the emission is multiplied.
    pub emissive_texture: Option<TextureRef>,
    /// Where alpha is below this the surface is not there; `None` is opaque.
    pub alpha_cutoff: Option<f32>,
    /// Whether the back side reflects too; otherwise it absorbs.
    pub double_sided: bool,
    /// Transmission factor (glass): reported, used to find portals.
    pub transmission: f32,
}

impl Default for Material {
    fn default() -> Self {
        Self {
            name: "default".into(),
            base_color: Vec3::ONE,
            alpha: 1.0,
            base_color_texture: None,
            metallic: 0.0,
            metallic_texture: None,
            emissive: Vec3::ZERO,
            emissive_texture: None,
            alpha_cutoff: None,
            double_sided: false,
            transmission: 0.0,
        }
    }
}

/// A texture as a material uses it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TextureRef {
    /// Index into `Scene::textures`.
    pub texture: u32,
    /// `uv' = scale_rotate * uv + offset` of `KHR_texture_transform`, as two rows and an offset.
    pub transform: [Vec2; 3],
}

impl TextureRef {
    /// A texture without transform.
    pub fn new(texture: u32) -> Self {
        Self {
            texture,
            transform: [Vec2::X, Vec2::Y, Vec2::ZERO],
        }
    }

    fn sample(&self, textures: &[Texture], uv: Vec2) -> Vec4 {
        let [row0, row1, offset] = self.transform;
        textures[self.texture as usize].sample(Vec2::new(row0.dot(uv), row1.dot(uv)) + offset)
    }
}

/// How coordinates outside `[0, 1]` are read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Wrap {
    /// Tiled.
    #[default]
    Repeat,
    /// Tiled, every second tile mirrored.
    Mirror,
    /// Held at the border.
    Clamp,
}

/// An 8-bit RGBA image, first row at `v = 0`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Texture {
    /// Where it came from, for messages.
    pub name: String,
    /// Width in texels, at least 1.
    pub width: u32,
    /// Height in texels, at least 1.
    pub height: u32,
    /// `width * height` RGBA texels.
    pub texels: Vec<[u8; 4]>,
    /// Whether RGB is sRGB-encoded (colour) rather than linear (data).
    pub srgb: bool,
    /// Wrapping along u and v.
    pub wrap: [Wrap; 2],
}

static SRGB_TO_LINEAR: LazyLock<[f32; 256]> = LazyLock::new(|| {
    std::array::from_fn(|i| {
        let c = i as f64 / 255.0;
        (if c <= 0.04045 {
            c / 12.92
        } else {
            ((c + 0.055) / 1.055).powf(2.4)
        }) as f32
    })
});

impl Wrap {
    fn apply(self, i: i64, n: i64) -> usize {
        let i = match self {
            Self::Repeat => i.rem_euclid(n),
            Self::Clamp => i.clamp(0, n - 1),
            Self::Mirror => {
                let j = i.rem_euclid(2 * n);
                if j < n { j } else { 2 * n - 1 - j }
            }
        };
        i as usize
    }
}

impl Texture {
    /// Bilinear sample at `uv`: linear RGB and alpha, each in `[0, 1]`. Non-finite `uv` reads texel 0.
    pub fn sample(&self, uv: Vec2) -> Vec4 {
        let (w, h) = (i64::from(self.width), i64::from(self.height));
        let p = uv * Vec2::new(w as f32, h as f32) - 0.5;
        let base = p.floor();
        let f = if p.is_finite() { p - base } else { Vec2::ZERO };
        let (x, y) = (base.x as i64, base.y as i64);
        let fetch = |dx, dy| {
            let (x, y) = (self.wrap[0].apply(x + dx, w), self.wrap[1].apply(y + dy, h));
            self.decode(self.texels[y * w as usize + x])
        };
        let top = fetch(0, 0).lerp(fetch(1, 0), f.x);
        let bottom = fetch(0, 1).lerp(fetch(1, 1), f.x);
        top.lerp(bottom, f.y)
    }

    /// A texel as linear RGB and alpha, each in `[0, 1]`.
    pub(super) fn decode(&self, [r, g, b, a]: [u8; 4]) -> Vec4 {
        let a = f32::from(a) / 255.0;
        if self.srgb {
            let lut = &*SRGB_TO_LINEAR;
            Vec4::new(lut[r as usize], lut[g as usize], lut[b as usize], a)
        } else {
            Vec4::new(
                f32::from(r) / 255.0,
                f32::from(g) / 255.0,
                f32::from(b) / 255.0,
                a,
            )
        }
    }
}

impl Material {
    /// Whether the albedo varies over the surface.
    #[inline]
    pub fn has_albedo_texture(&self) -> bool {
        self.base_color_texture.is_some() || self.metallic_texture.is_some()
    }

    /// Albedo without textures.
    #[inline]
    pub fn constant_albedo(&self) -> Vec3 {
        self.base_color * (1.0 - self.metallic)
    }

    /// Diffuse albedo at `uv` (linear RGB, dimensionless): `base_color * (1 - metallic)`.
    pub fn albedo(&self, textures: &[Texture], uv: Vec2) -> Vec3 {
        let tint = self
            .base_color_texture
            .map_or(Vec3::ONE, |t| t.sample(textures, uv).truncate());
        let metal = self
            .metallic_texture
            .map_or(1.0, |t| t.sample(textures, uv).z);
        self.base_color * tint * (1.0 - self.metallic * metal)
    }

    /// Whether the surface is there at `uv`.
    pub fn covers(&self, textures: &[Texture], uv: Vec2) -> bool {
        let Some(cutoff) = self.alpha_cutoff else {
            return true;
        };
        let texel = self
            .base_color_texture
            .map_or(1.0, |t| t.sample(textures, uv).w);
        self.alpha * texel >= cutoff
    }

    /// Whether the material emits light.
    pub fn emits(&self) -> bool {
        self.emissive.max_element() > 0.0
    }

    /// Emitted radiance at `uv`, W/(m² sr), linear RGB.
    pub fn emission(&self, textures: &[Texture], uv: Vec2) -> Vec3 {
        self.emissive
            * self
                .emissive_texture
                .map_or(Vec3::ONE, |t| t.sample(textures, uv).truncate())
    }
}
