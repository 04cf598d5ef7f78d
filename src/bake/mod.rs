//! One thin recipe a technique: sinks for the gather, then the format. And what all share: writing
//! the asset, its pictures and the index.

pub mod atlas_image;
pub mod lit_scene;
pub mod prm;

use crate::domain::Domain;
use crate::error::{Error, Result};
use crate::plan::Job;
use crate::scene::{Finding, Scene};
use lightkiln_format::container::atomic_write;
use lightkiln_format::index::{Asset, FileEntry, Index, Note};
use prm::Baked;
use serde_json::json;
use std::path::{Path, PathBuf};

/// Name of the index in the output folder.
pub const INDEX: &str = "index.json";

/// Writes an asset's files under `output/SCENE/` and enters it in `output/index.json`; every file is
/// written under a temporary name, flushed and renamed, the index last. Other assets of the folder
/// stay listed. Returns the asset's folder.
///
/// # Errors
/// [`Error::Io`] or [`Error::Input`]; what was there before is then still whole.
pub fn publish(
    output: &Path,
    scene: &Scene,
    domain: &Domain,
    job: &Job,
    baked: &Baked,
) -> Result<PathBuf> {
    let dir = output.join(&scene.name);
    std::fs::create_dir_all(&dir).map_err(|e| Error::io(&dir, "create the folder", e))?;
    let mut files = Vec::new();
    let relative = |name: &str| format!("{}/{name}", scene.name);

    let written = baked.prm.write(&dir.join("prm.safetensors"))?;
    files.push(FileEntry::new(relative("prm.safetensors"), "data", written));
    for (page, bytes) in atlas_image::encode(&dir, &baked.prm, domain)?
        .iter()
        .enumerate()
    {
        let name = format!("atlas.{page}.exr");
        let written = atomic_write(&dir.join(&name), bytes)?;
        files.push(FileEntry::new(relative(&name), "atlas", written));
    }
    let glb = lit_scene::write_glb(scene, Some(&domain.uvs))?;
    let written = atomic_write(&dir.join("scene.lit.glb"), &glb)?;
    files.push(FileEntry::new(relative("scene.lit.glb"), "scene", written));

    let path = output.join(INDEX);
    let mut index = match Index::read(&path) {
        Ok(index) => index,
        Err(_) => Index::new(env!("CARGO_PKG_VERSION")),
    };
    index.tool_version = env!("CARGO_PKG_VERSION").into();
    index
        .assets
        .retain(|a| (a.name.as_str(), a.technique.as_str()) != (&scene.name, job.technique));
    let repairs = scene
        .findings
        .iter()
        .chain(&baked.findings)
        .map(note)
        .collect();
    let skip = |text: &String| Note {
        element: scene.name.clone(),
        reason: text.clone(),
        count: 1,
    };
    index.assets.push(Asset {
        name: scene.name.clone(),
        technique: job.technique.into(),
        kind: lightkiln_format::prm::FORMAT.into(),
        format_version: lightkiln_format::prm::VERSION,
        files,
        parameters: json!({
            "texels_per_metre": job.texels_per_metre,
            "samples": job.parameters.samples,
            "bounces": job.parameters.bounces,
            "cells": job.parameters.cells,
            "entries_per_cell": job.parameters.entries_per_cell,
        }),
        plan_key: job.key.clone(),
        statistics: serde_json::to_value(&baked.statistics).map_err(|e| {
            Error::input(&path, "statistics", e.to_string(), "report this as a bug")
        })?,
        skips: job.skips.iter().map(skip).collect(),
        repairs,
    });
    index.write(&path)?;
    Ok(dir)
}

fn note(finding: &Finding) -> Note {
    Note {
        element: finding.element.clone(),
        reason: finding.what.clone(),
        count: finding.count,
    }
}
