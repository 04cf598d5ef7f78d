//! Where baked values live: reference points on the scene's surfaces, and the entry cells of light.

pub mod atlas;
pub mod cells;

use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::scene::Scene;
use atlas::AtlasOptions;
use glam::{Vec2, Vec3};

/// The lightmap domain of a scene: reference points and where their texels are.
#[derive(Debug, Clone, Default)]
pub struct Domain {
    /// Lightmap coordinates of the triangles.
    pub uvs: LightmapUvs,
    /// Reference points, neighbours next to each other.
    pub points: Vec<ReferencePoint>,
    /// BLAKE3 over every point: what the domain is.
    pub digest: [u8; 32],
    /// Seed of everything sampled over the domain, from its digest.
    pub seed: u32,
}

impl Domain {
    /// Lays out the atlas of `scene` and places its reference points.
    ///
    /// # Errors
    /// [`Error::Interrupted`], [`Error::Input`] where the atlas would be too large, or when nothing
    /// in the scene receives a lightmap.
    pub fn atlas(scene: &Scene, options: &AtlasOptions, progress: &Progress) -> Result<Self> {
        progress.stage(&scene.name, "unwrapping", 1000);
        let uvs = atlas::unwrap(scene, options, &|share| progress.share(share))?;
        progress.stage(&scene.name, "placing reference points", 0);
        let points = atlas::reference_points(scene, &uvs);
        if points.is_empty() {
            return Err(Error::input(
                scene.name.as_ref(),
                "instances",
                "no triangle with the role `static`: nothing receives a lightmap",
                "give at least one mesh the role `static` in [[scene.role]]",
            ));
        }
        let mut hasher = blake3::Hasher::new();
        for p in &points {
            hasher.update(bytemuck::bytes_of(&p.position));
            hasher.update(bytemuck::bytes_of(&p.normal));
            hasher.update(&p.page.to_le_bytes());
            hasher.update(bytemuck::bytes_of(&p.texel));
        }
        let digest = *hasher.finalize().as_bytes();
        let seed = u32::from_le_bytes([digest[0], digest[1], digest[2], digest[3]]);
        Ok(Self {
            uvs,
            points,
            digest,
            seed,
        })
    }
}

/// A point that receives light: one covered lightmap texel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReferencePoint {
    /// Position on the surface, metres, local, already lifted off the surface by the rounding bound.
    pub position: Vec3,
    /// Unit shading normal: irradiance is measured about it.
    pub normal: Vec3,
    /// Unit geometric normal of the front side: no light comes from below it.
    pub geometric_normal: Vec3,
    /// Triangle the point lies on.
    pub triangle: u32,
    /// Surface area the point stands for, m².
    pub area: f32,
    /// Lightmap page.
    pub page: u16,
    /// Texel column and row in the page.
    pub texel: [u16; 2],
    /// Chart the texel belongs to (numbered over all pages).
    pub chart: u32,
}

/// Lightmap coordinates of the scene's triangles.
#[derive(Debug, Clone, Default)]
pub struct LightmapUvs {
    /// Width and height of each page, texels.
    pub pages: Vec<[u32; 2]>,
    /// Page of each triangle; `NO_PAGE` where the triangle receives no lightmap.
    pub page_of: Vec<u16>,
    /// Coordinates of each triangle's corners within its page, in texels.
    pub corners: Vec<[Vec2; 3]>,
    /// Chart of each triangle; `NO_CHART` where the triangle receives no lightmap.
    pub chart_of: Vec<u32>,
}

/// Page number of triangles without lightmap.
pub const NO_PAGE: u16 = u16::MAX;

/// Chart number of triangles without lightmap.
pub const NO_CHART: u32 = u32::MAX;
