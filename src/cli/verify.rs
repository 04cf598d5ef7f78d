//! `lightkiln verify`

use super::{Scenes, encoding, watch::Watch, write};
use lightkiln::Prepared;
use lightkiln::error::{Error, Result};
use lightkiln::progress::Progress;
use lightkiln::trace::{Build, Tracer};
use lightkiln::verify::report::{self, Figure};
use lightkiln::verify::statistics::{self, Effort, Summary};
use lightkiln::verify::{poses, view};
use lightkiln_format::prm::Prm;
use std::path::Path;
use std::sync::Arc;

/// Size of the compared pictures, pixels, and reference paths a pixel, at most.
const SIZE: (u32, u32) = (320, 200);
const PICTURE_PATHS: u32 = 128;

pub fn run(
    scenes: &Scenes,
    max_error: Option<f64>,
    effort: &Effort,
    progress: &Arc<Progress>,
) -> Result<u8> {
    let manifest = scenes.read()?;
    let output = manifest.output_dir(&scenes.manifest);
    let mut summaries = Vec::new();
    {
        let _watch = Watch::start(progress);
        for spec in manifest.scenes.iter().filter(|s| scenes.wants(&s.name)) {
            let prepared = lightkiln::prepare(&scenes.manifest, spec, progress)?;
            summaries.push(one(&prepared, &output.join(&spec.name), effort, progress)?);
        }
        progress.finish();
    }
    let mut code = 0;
    for summary in &summaries {
        println!(
            "{}: relative RMS of indirect irradiance: median pose {:.2} %, worst {:.2} %, near \
             surfaces (median) {:.2} %; report: {}",
            summary.scene,
            summary.median * 100.0,
            summary.worst * 100.0,
            summary.median_near * 100.0,
            output.join(&summary.scene).join("verify.html").display()
        );
        if max_error.is_some_and(|limit| summary.median > limit) {
            code = 4;
        }
    }
    Ok(code)
}

fn one(prepared: &Prepared, dir: &Path, effort: &Effort, progress: &Progress) -> Result<Summary> {
    let Prepared {
        scene,
        domain,
        jobs,
    } = prepared;
    let file = dir.join("prm.safetensors");
    let prm = Prm::read(&file)?;
    if prm.point_texel.len() != domain.points.len() || prm.pages != domain.uvs.pages {
        return Err(Error::input(
            &file,
            "point_texel",
            "was baked for another atlas than the manifest's scene has now",
            "run `lightkiln bake` again",
        ));
    }
    let tracer = Tracer::new(scene, Build::Good);
    let poses = poses::poses(&tracer, effort.poses);
    let errors = statistics::compare(&tracer, domain, &prm, &poses, effort, progress)?;
    let key = jobs.first().map_or("", |j| j.key.as_str());
    let summary = statistics::summarise(&scene.name, key, effort, errors);

    let seen = view::see(&tracer, domain, &view::camera(&tracer), SIZE.0, SIZE.1);
    let lamp = poses[0].position;
    let paths = effort.paths.min(PICTURE_PATHS);
    let reference = seen.reference(&tracer, lamp, paths, progress)?;
    progress.stage(&scene.name, "drawing the comparison", 0);
    let baked = seen.baked(&tracer, &prm, lamp)?;
    let exposure = reference.exposure();
    let difference = baked.zip(&reference, |b, r| b - r);
    let n = reference.pixels.len() as f32;
    let mean = reference
        .pixels
        .iter()
        .map(|p| p.element_sum() / 3.0)
        .sum::<f32>()
        / n;
    let html = dir.join("verify.html");
    let figures = [
        (
            format!("reference indirect irradiance ({paths} paths a pixel)"),
            reference.to_png(exposure),
        ),
        ("baked indirect irradiance".into(), baked.to_png(exposure)),
        (
            "difference: blue too dark, red too bright, full colour at 20 % of the mean".into(),
            difference.to_signed_png(mean * 0.2),
        ),
    ]
    .into_iter()
    .map(|(caption, png)| {
        Ok(Figure {
            caption,
            png: png.map_err(encoding(&html))?,
        })
    })
    .collect::<Result<Vec<_>>>()?;
    let json = serde_json::to_string_pretty(&summary).unwrap_or_default();
    write(&dir.join("verify.json"), json.as_bytes())?;
    write(&html, report::page(&summary, &figures).as_bytes())?;
    Ok(summary)
}
