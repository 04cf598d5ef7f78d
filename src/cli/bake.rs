//! `lightkiln bake`

use super::{Scenes, bytes, count, encoding, watch::Watch, write};
use glam::Vec3;
use lightkiln::Prepared;
use lightkiln::bake::prm::Baked;
use lightkiln::error::Result;
use lightkiln::progress::Progress;
use lightkiln::trace::Tracer;
use lightkiln::verify::poses;
use lightkiln::verify::view::{self, Picture};
use std::path::Path;
use std::sync::Arc;

/// Size of the pictures, pixels.
const SIZE: (u32, u32) = (960, 600);

pub fn run(scenes: &Scenes, progress: &Arc<Progress>) -> Result<u8> {
    let manifest = scenes.read()?;
    let output = manifest.output_dir(&scenes.manifest);
    let mut summary = Vec::new();
    let started = std::time::Instant::now();
    {
        let _watch = Watch::start(progress);
        lightkiln::bake(
            &scenes.manifest,
            &manifest,
            |name| scenes.wants(name),
            progress,
            |prepared, tracer, baked, dir| {
                progress.stage(&prepared.scene.name, "drawing pictures", 0);
                pictures(prepared, tracer, baked, dir)?;
                progress.finish();
                let s = &baked.statistics;
                summary.push(format!(
                    "{}: {} points, {} cells, {} ({:.0} % of dense)",
                    prepared.scene.name,
                    s.points,
                    s.cells,
                    bytes(s.rows * 386 + s.entry_points * 24 + s.points * 8),
                    100.0 * s.rows as f64 / s.dense_rows.max(1) as f64
                ));
                for finding in prepared.scene.findings.iter().chain(&baked.findings) {
                    summary.push(format!(
                        "  {}: {} ({})",
                        finding.element, finding.what, finding.count
                    ));
                }
                Ok(())
            },
        )?;
        timings(&output, progress)?;
    }
    for line in summary {
        println!("{line}");
    }
    let (_, _, rays) = progress.now();
    println!(
        "{} rays in {:.1} s",
        count(rays),
        started.elapsed().as_secs_f64()
    );
    println!("pictures: {}/*/*.png", output.display());
    Ok(0)
}

/// `direct.png`, `lit.png` and `indirect.png` of a lamp in the middle of the first lamp volume,
/// with 2 x 2 samples a pixel.
fn pictures(prepared: &Prepared, tracer: &Tracer, baked: &Baked, dir: &Path) -> Result<()> {
    let seen = view::see(
        tracer,
        &prepared.domain,
        &view::camera(tracer),
        2 * SIZE.0,
        2 * SIZE.1,
    );
    let lamp = poses::for_pictures(tracer);
    let albedo = seen.albedo();
    let radiance = |e: Vec3, rho: Vec3| e * rho * std::f32::consts::FRAC_1_PI;
    let shaded = |irradiance: Picture| irradiance.zip(&albedo, radiance).halved();
    let direct = shaded(seen.direct(tracer, lamp)?);
    let indirect = shaded(seen.baked(tracer, &baked.prm, lamp)?);
    let lit = direct.zip(&indirect, |a, b| a + b);
    let exposure = lit.exposure();
    for (name, picture) in [("direct", &direct), ("indirect", &indirect), ("lit", &lit)] {
        let path = dir.join(format!("{name}.png"));
        write(&path, &picture.to_png(exposure).map_err(encoding(&path))?)?;
    }
    Ok(())
}

/// `timings.json`: seconds of every stage. Not part of the index: it differs from run to run.
fn timings(output: &Path, progress: &Progress) -> Result<()> {
    let (stage, _, rays) = progress.now();
    let stages: Vec<_> = stage
        .finished
        .iter()
        .map(|(scene, name, took)| {
            serde_json::json!({ "scene": scene, "stage": name, "seconds": took.as_secs_f64() })
        })
        .collect();
    let all = serde_json::json!({
        "threads": rayon::current_num_threads(),
        "rays": rays,
        "stages": stages,
    });
    let text = serde_json::to_string_pretty(&all).unwrap_or_default();
    write(&output.join("timings.json"), text.as_bytes())
}
