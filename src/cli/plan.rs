//! `lightkiln plan`

use super::{Scenes, bytes, count, watch::Watch};
use lightkiln::error::Result;
use lightkiln::progress::Progress;
use std::sync::Arc;

/// How the plan is printed.
#[derive(Clone, Copy, Default, clap::ValueEnum)]
pub enum Format {
    /// A table.
    #[default]
    Text,
    /// One JSON array.
    Json,
}

pub fn run(scenes: &Scenes, format: Format, progress: &Arc<Progress>) -> Result<u8> {
    let manifest = scenes.read()?;
    let mut jobs = Vec::new();
    let mut findings = Vec::new();
    {
        let _watch = Watch::start(progress);
        for spec in manifest.scenes.iter().filter(|s| scenes.wants(&s.name)) {
            let prepared = lightkiln::prepare(&scenes.manifest, spec, progress)?;
            findings.push((spec.name.clone(), super::grouped(&prepared.scene.findings)));
            jobs.extend(prepared.jobs);
        }
        progress.finish();
    }
    match format {
        Format::Json => {
            let text = serde_json::to_string_pretty(&jobs).unwrap_or_default();
            println!("{text}");
        }
        Format::Text => {
            println!(
                "{:<16} {:<5} {:>9} {:>10} {:>9} {:>6} {:>7} {:>9} {:>10}  key",
                "scene",
                "what",
                "triangles",
                "surface m2",
                "points",
                "cells",
                "samples",
                "rays <=",
                "bytes <="
            );
            for job in &jobs {
                println!(
                    "{:<16} {:<5} {:>9} {:>10.1} {:>9} {:>6} {:>7} {:>9} {:>10}  {}",
                    job.scene,
                    job.technique,
                    job.triangles,
                    job.surface,
                    job.points,
                    job.parameters.cells,
                    job.parameters.samples,
                    count(job.rays),
                    bytes(job.bytes),
                    &job.key[..12]
                );
            }
            for job in &jobs {
                for skip in &job.skips {
                    println!("{}: skipped: {skip}", job.scene);
                }
            }
            for (scene, lines) in &findings {
                for line in lines {
                    println!("{scene}: {}", line.trim_start());
                }
            }
        }
    }
    Ok(0)
}
