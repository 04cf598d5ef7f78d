//! Where baked values live: reference points on the scene's surfaces, and the entry cells of light.

pub mod atlas;
pub mod cells;

use glam::{Vec2, Vec3};

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
