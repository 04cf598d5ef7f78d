//! `lightkiln evaluate`

use super::write;
use glam::Vec3;
use lightkiln::bake::atlas_image::read_points;
use lightkiln::error::{Error, Result};
use lightkiln::progress::Progress;
use lightkiln::scene;
use lightkiln::trace::{Build, Tracer, visibility};
use lightkiln_format::lighting::{Light, Lighting, LightingError};
use lightkiln_format::prm::Prm;
use std::fmt::Write;
use std::path::{Path, PathBuf};

pub fn run(asset: &Path, lighting: &Path, out: Option<&Path>, progress: &Progress) -> Result<u8> {
    let file = asset.join("prm.safetensors");
    let prm = Prm::read(&file)?;
    let lights = Lighting::read(lighting)
        .map_err(|e| refused(lighting, &e))?
        .lights;
    let scene = scene::load_file(&asset.join("scene.lit.glb"))?;
    let tracer = Tracer::new(&scene, Build::Fast);
    // Entry points are relative to the asset's origin, rays to the loaded scene's.
    let shift = (glam::DVec3::from_array(prm.origin) - scene.origin).as_vec3();
    let entries: Vec<Vec3> = prm
        .entry_position
        .iter()
        .map(|&p| Vec3::from(p) + shift)
        .collect();
    let mut visible = Vec::with_capacity(lights.len() * entries.len());
    for light in &lights {
        progress.check()?;
        visible.extend(match *light {
            Light::Directional { direction, .. } => {
                visibility::from_infinity(&tracer, -direction.normalize(), &entries)
            }
            Light::Point { position, .. }
            | Light::Spot { position, .. }
            | Light::Rectangle { position, .. } => {
                visibility::from_point(&tracer, scene.to_local(position), &entries)
            }
        });
    }
    let cells = prm.cell_irradiance(&lights, &visible).map_err(|e| {
        Error::input(
            lighting,
            "light",
            e.to_string(),
            "see the lighting file's documentation",
        )
    })?;
    progress.check()?;
    let values = prm
        .evaluate(&cells)
        .map_err(|e| Error::input(&file, "responses", e.to_string(), "bake the asset again"))?;
    let pages: Vec<PathBuf> = (0..prm.pages.len())
        .map(|p| asset.join(format!("atlas.{p}.exr")))
        .collect();
    let points = read_points(&pages, &prm)?;
    let mut csv = String::from(
        "page,x,y,position_x,position_y,position_z,normal_x,normal_y,normal_z,\
         irradiance_r,irradiance_g,irradiance_b\n",
    );
    for ((texel, [p, n]), e) in prm.point_texel.iter().zip(&points).zip(&values) {
        let [page, x, y, _] = texel;
        let _ = writeln!(
            csv,
            "{page},{x},{y},{},{},{},{},{},{},{},{},{}",
            p.x, p.y, p.z, n.x, n.y, n.z, e[0], e[1], e[2]
        );
    }
    progress.check()?;
    match out {
        Some(path) => write(path, csv.as_bytes())?,
        None => print!("{csv}"),
    }
    Ok(0)
}

fn refused(path: &Path, error: &LightingError) -> Error {
    Error::manifest(
        path,
        "lighting",
        error.to_string(),
        "see `[[light]]` in the README for the keys of each kind of light",
    )
}
