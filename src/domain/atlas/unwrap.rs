//! Unwrapping by `uvunwrap`: charts by region growing, least-squares conformal maps, row folding.
//!
//! Folding (`Packing::Fast`) is chosen over its packing by shape: the pages come out alike on
//! architectural scenes, it takes a fraction of a second where shapes take several, and packing is
//! the one stage that reports nothing and cannot be interrupted meanwhile.

use super::{AtlasOptions, MAX_PAGE_SIDE, Placed, refuse, surface_area};
use crate::error::{Error, Result};
use crate::scene::Scene;
use glam::{DVec2, Vec2};
use std::collections::HashMap;
use std::ops::Range;
use uvunwrap::{Density, MeshInput, Options, Packing, Progress, Stage};

/// Largest angle between a face and its chart's average normal, degrees. Below that of a cube's
/// corner (54.7), so that a chart does not run around right-angled edges, across which light jumps.
const MAX_CHART_ANGLE: f32 = 50.0;

/// One instance, with vertices that differ in texture coordinates only made one.
#[derive(Default)]
struct Mesh {
    positions: Vec<[f32; 3]>,
    indices: Vec<u32>,
    triangles: Vec<u32>,
}

impl Mesh {
    fn new(scene: &Scene, triangles: Range<u32>) -> Self {
        let mut mesh = Self::default();
        let mut known: HashMap<[u32; 6], u32> = HashMap::new();
        for t in triangles.filter(|&t| surface_area(scene, t) > 0.0) {
            mesh.triangles.push(t);
            for v in scene.triangles[t as usize].vertices {
                let (p, n) = (scene.positions[v as usize], scene.normals[v as usize]);
                // Adding zero makes -0 and 0 the same.
                let key = [p.x, p.y, p.z, n.x, n.y, n.z].map(|x| (x + 0.0).to_bits());
                let index = *known.entry(key).or_insert_with(|| {
                    mesh.positions.push(p.to_array());
                    mesh.positions.len() as u32 - 1
                });
                mesh.indices.push(index);
            }
        }
        mesh
    }
}

/// Unwraps `instances` (ranges of triangles), charts and pages numbered from zero.
pub(super) fn unwrap(
    scene: &Scene,
    instances: &[Range<u32>],
    options: &AtlasOptions,
    progress: &(dyn Fn(f32) -> bool + Sync),
) -> Result<Vec<Placed>> {
    let meshes: Vec<Mesh> = instances
        .iter()
        .map(|r| Mesh::new(scene, r.clone()))
        .collect();
    if meshes.iter().all(|m| m.triangles.is_empty()) {
        return Ok(Vec::new());
    }
    let inputs: Vec<_> = meshes
        .iter()
        .map(|m| MeshInput::new(&m.positions, &m.indices))
        .collect();
    let generate = |page_size| {
        let options = Options {
            max_chart_angle: MAX_CHART_ANGLE,
            density: Density::Fixed {
                texels_per_unit: options.texels_per_metre,
                page_size: Some(page_size),
            },
            padding: options.padding,
            packing: Packing::Fast,
            ..Options::default()
        };
        uvunwrap::generate_with_progress(&inputs, &options, |p| progress(fraction(p)))
    };
    let mut result = generate(options.page_size);
    if let Err(uvunwrap::Error::ChartTooLarge { width, height, .. }) = result {
        let side = width.max(height);
        if side <= MAX_PAGE_SIDE {
            result = generate(side.next_power_of_two());
        }
    }
    let atlas = result.map_err(|e| failure(scene, &e))?;

    let size = DVec2::new(f64::from(atlas.width), f64::from(atlas.height));
    let mut placed = Vec::with_capacity(meshes.iter().map(|m| m.triangles.len()).sum());
    for (mesh, output) in meshes.iter().zip(&atlas.meshes) {
        for (&triangle, corners) in mesh.triangles.iter().zip(output.indices.chunks_exact(3)) {
            let corners = [0, 1, 2].map(|c| &output.vertices[corners[c] as usize]);
            // Triangles too thin to have a chart take a point of a neighbour's; without one, nothing.
            let (Some(page), Some(chart)) = (corners[0].page, corners[0].chart) else {
                continue;
            };
            let corners = corners.map(|v| Vec2::from(v.uv).as_dvec2() * size);
            placed.push(Placed {
                triangle,
                page,
                chart,
                corners,
            });
        }
    }
    Ok(placed)
}

/// Fraction done, from each stage's usual share of the time.
fn fraction(progress: Progress) -> f32 {
    let (begin, share) = match progress.stage {
        Stage::Segmenting => (0.0, 0.25),
        Stage::Parameterizing => (0.25, 0.35),
        Stage::Packing => (0.6, 0.3),
        _ => (0.9, 0.1),
    };
    let done = progress.done as f32;
    // The number of packing trials is not known beforehand.
    begin + share * done / progress.total.map_or(done + 1.0, |t| t.max(1) as f32)
}

fn failure(scene: &Scene, error: &uvunwrap::Error) -> Error {
    match error {
        uvunwrap::Error::Cancelled => Error::Interrupted,
        uvunwrap::Error::ChartTooLarge { width, height, .. } => refuse(
            scene,
            "texels_per_metre",
            format!("makes a chart of {width} x {height} texels; {MAX_PAGE_SIDE} is the limit"),
            "lower texels_per_metre, check metres_per_unit, or split the surface into several nodes",
        ),
        other => refuse(
            scene,
            "texels_per_metre",
            format!("the scene cannot be unwrapped: {other}"),
            "lower texels_per_metre or padding, or give the scene its own second texture coordinates",
        ),
    }
}
