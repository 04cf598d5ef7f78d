//! Manifest + scene + domain -> what will be baked, with which parameters, at what cost. Pure:
//! traces nothing.

use crate::domain::Domain;
use crate::domain::atlas::AtlasOptions;
use crate::manifest::{BakeSpec, DEFAULT_PAGE_SIZE, MAX_CELLS, Preset, SceneSpec, Technique};
use crate::scene::Scene;
use lightkiln_format::prm::{LANES, ROW};
use serde::Serialize;

/// Texels a metre where the manifest says nothing (dossier 5.5: indirect light is smooth).
pub const DEFAULT_TEXELS_PER_METRE: f64 = 8.0;

/// Rays of the operator, each of a cell's 256 samples times 16.
const OPERATOR_RAYS_PER_CELL: u64 = 256 * 16;

/// Resolved parameters of a bake.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Parameters {
    /// Paths a reference point.
    pub samples: u32,
    /// Hits walked one by one; the operator between cells carries on.
    pub bounces: u32,
    /// Entry cells aimed at.
    pub cells: u32,
    /// Entry points a cell.
    pub entries_per_cell: u32,
}

/// One asset to bake.
#[derive(Debug, Clone, Serialize)]
pub struct Job {
    /// Scene.
    pub scene: String,
    /// Technique.
    pub technique: &'static str,
    /// Digest of everything the asset depends on.
    pub key: String,
    /// Resolved parameters.
    pub parameters: Parameters,
    /// Atlas density, texels a metre.
    pub texels_per_metre: f32,
    /// Triangles traced.
    pub triangles: u64,
    /// Surface that receives light, m².
    pub surface: f64,
    /// Reference points.
    pub points: u64,
    /// Lightmap pages, width and height in texels.
    pub pages: Vec<[u32; 2]>,
    /// Rays, at most: every path reaches its last walked hit.
    pub rays: u64,
    /// Bytes of the asset, at most: every block sees every cell.
    pub bytes: u64,
    /// What will not be done, and why that is allowed.
    pub skips: Vec<String>,
}

/// Atlas options of a scene.
pub fn atlas_options(spec: &SceneSpec) -> AtlasOptions {
    let domain = spec.domain.as_ref();
    AtlasOptions {
        texels_per_metre: domain
            .and_then(|d| d.texels_per_metre)
            .unwrap_or(DEFAULT_TEXELS_PER_METRE) as f32,
        page_size: domain
            .and_then(|d| d.page_size)
            .unwrap_or(DEFAULT_PAGE_SIZE),
        ..AtlasOptions::default()
    }
}

/// Most bytes that a preset's number of cells may make of an asset if every block sees every cell.
/// Above it the preset takes fewer cells; `cells` in the manifest takes what it says.
pub const DENSE_BYTES: u64 = 1 << 30;

/// What a preset stands for.
struct Defaults {
    samples: u32,
    /// Entry cells a square metre of surface, and the least and most of them.
    density: f64,
    cells: [u32; 2],
}

/// Parameters of a bake: the preset's, then what the manifest overrides. `surface`: m² that light
/// can meet; `points`: reference points.
///
/// The error that cells leave falls with their size, not their number: a preset asks for so many a
/// square metre, within bounds, and within [`DENSE_BYTES`].
pub fn parameters(spec: &BakeSpec, surface: f64, points: u64) -> Parameters {
    let defaults = match spec.preset.unwrap_or_default() {
        Preset::Draft => Defaults {
            samples: 128,
            density: 1.0,
            cells: [128, 256],
        },
        Preset::Normal => Defaults {
            samples: 2048,
            density: 5.0,
            cells: [512, 2560],
        },
        Preset::High => Defaults {
            samples: 4096,
            density: 16.0,
            cells: [1024, MAX_CELLS],
        },
    };
    let entries_per_cell = spec.entries_per_cell.unwrap_or(16);
    let affordable = DENSE_BYTES / (6 * points.max(1));
    let [least, most] = defaults.cells.map(f64::from);
    let preset = (defaults.density * surface)
        .clamp(least, most)
        .min(affordable.max(1) as f64);
    let from_density = spec.entry_density.map(|density| {
        let cells = (density * surface / f64::from(entries_per_cell)).ceil();
        cells.clamp(1.0, f64::from(MAX_CELLS)) as u32
    });
    Parameters {
        samples: spec.samples.unwrap_or(defaults.samples),
        bounces: spec.bounces.unwrap_or(3),
        cells: spec.cells.or(from_density).unwrap_or(preset as u32),
        entries_per_cell,
    }
}

/// The jobs of one scene.
pub fn jobs(spec: &SceneSpec, scene: &Scene, domain: &Domain) -> Vec<Job> {
    let blocking = (0..scene.triangles.len() as u32).filter(|&t| scene.role_of(t).blocks_light());
    let (mut surface, mut triangles) = (0.0, 0);
    for t in blocking {
        triangles += 1;
        surface += 0.5 * f64::from(scene.double_area_normal(t).length());
    }
    let digest = digest(scene);
    spec.bakes
        .iter()
        .map(|bake| {
            let Technique::Prm = bake.technique;
            let parameters = parameters(bake, surface, domain.points.len() as u64);
            let points = domain.points.len() as u64;
            let walked = points * u64::from(parameters.samples) * u64::from(parameters.bounces);
            let blocks = points.div_ceil(LANES as u64);
            let rows = blocks * u64::from(parameters.cells);
            let entries = u64::from(parameters.cells) * u64::from(parameters.entries_per_cell);
            Job {
                scene: spec.name.clone(),
                technique: "prm",
                key: key(&digest, domain, &parameters),
                parameters,
                texels_per_metre: atlas_options(spec).texels_per_metre,
                triangles,
                surface,
                points,
                pages: domain.uvs.pages.clone(),
                rays: walked + u64::from(parameters.cells) * OPERATOR_RAYS_PER_CELL,
                bytes: rows * (2 * ROW as u64 + 2) + entries * 24 + points * 8,
                skips: skips(scene),
            }
        })
        .collect()
}

/// What the scene holds and the bake leaves out.
fn skips(scene: &Scene) -> Vec<String> {
    use crate::scene::Role;
    let mut skips = Vec::new();
    for (role, why) in [
        (
            Role::Dynamic,
            "moves at run time: not part of the static transport",
        ),
        (Role::Portal, "light passes: not traced"),
        (Role::Ignore, "excluded by the manifest"),
        (
            Role::Occluder,
            "blocks and reflects light, receives no lightmap",
        ),
    ] {
        let count: usize = scene
            .instances
            .iter()
            .filter(|i| i.role == role)
            .map(|i| i.triangles.len())
            .sum();
        if count > 0 {
            skips.push(format!("{count} triangles with role {role:?}: {why}"));
        }
    }
    let black = scene
        .materials
        .iter()
        .filter(|m| !m.has_albedo_texture() && m.constant_albedo().max_element() <= 0.0)
        .count();
    if black > 0 {
        skips.push(format!(
            "{black} black materials: walks end on them, exactly"
        ));
    }
    skips
}

/// Digest of all geometry, materials and textures that transport depends on.
fn digest(scene: &Scene) -> [u8; 32] {
    let mut hasher = blake3::Hasher::new();
    hasher.update(bytemuck::bytes_of(&scene.origin.to_array()));
    hasher.update(bytemuck::cast_slice(&scene.positions));
    hasher.update(bytemuck::cast_slice(&scene.normals));
    hasher.update(bytemuck::cast_slice(&scene.uvs));
    for triangle in &scene.triangles {
        hasher.update(bytemuck::bytes_of(&triangle.vertices));
        hasher.update(&triangle.material.to_le_bytes());
    }
    for instance in &scene.instances {
        hasher.update(format!("{instance:?}").as_bytes());
    }
    for material in &scene.materials {
        hasher.update(format!("{material:?}").as_bytes());
    }
    for texture in &scene.textures {
        hasher.update(&texture.width.to_le_bytes());
        hasher.update(&[u8::from(texture.srgb)]);
        hasher.update(format!("{:?}", texture.wrap).as_bytes());
        hasher.update(bytemuck::cast_slice(&texture.texels));
    }
    *hasher.finalize().as_bytes()
}

fn key(scene: &[u8; 32], domain: &Domain, parameters: &Parameters) -> String {
    let mut hasher = blake3::Hasher::new();
    hasher.update(concat!("lightkiln ", env!("CARGO_PKG_VERSION"), " prm ").as_bytes());
    hasher.update(&lightkiln_format::prm::VERSION.to_le_bytes());
    hasher.update(scene);
    hasher.update(&domain.digest);
    hasher.update(format!("{parameters:?}").as_bytes());
    hasher.finalize().to_hex().to_string()
}
