//! Lightkiln precomputes light transport of static scenes for real-time lighting.
//!
//! Data moves to the right only:
//! `manifest + scene -> domain -> plan -> gather -> bake -> assets -> runtime`. The modules are
//! these words; [`bake()`] is the whole way in one function.

pub mod bake;
pub mod domain;
pub mod error;
pub mod gather;
pub mod manifest;
pub mod plan;
pub mod progress;
pub mod scene;
pub mod trace;
pub mod verify;

use domain::Domain;
use error::Result;
use manifest::{Manifest, SceneSpec};
use plan::Job;
use progress::Progress;
use scene::Scene;
use std::path::Path;
use trace::{Build, Tracer};

/// A scene ready to be planned and baked.
pub struct Prepared {
    /// The scene.
    pub scene: Scene,
    /// Its reference points.
    pub domain: Domain,
    /// Its jobs.
    pub jobs: Vec<Job>,
}

/// Loads one scene of a manifest, lays out its domain and plans its jobs. Traces nothing.
///
/// # Errors
/// Whatever is wrong with the scene or the manifest's words about it.
pub fn prepare(manifest_file: &Path, spec: &SceneSpec, progress: &Progress) -> Result<Prepared> {
    progress.stage(&spec.name, "loading", 0);
    let scene = scene::load(manifest_file, spec)?;
    let domain = Domain::atlas(&scene, &plan::atlas_options(spec), progress)?;
    let jobs = plan::jobs(spec, &scene, &domain);
    Ok(Prepared {
        scene,
        domain,
        jobs,
    })
}

/// Bakes the scenes of a manifest for which `wanted` says yes, one after the other; `done` hears of
/// each when its files are safely in place.
///
/// # Errors
/// The first scene that fails stops the bake; assets finished before it stay, and stay listed in
/// `index.json`.
pub fn bake(
    manifest_file: &Path,
    manifest: &Manifest,
    wanted: impl Fn(&str) -> bool,
    progress: &Progress,
    mut done: impl FnMut(&Prepared, &Tracer, &bake::prm::Baked, &Path) -> Result<()>,
) -> Result<()> {
    let output = manifest.output_dir(manifest_file);
    for spec in manifest.scenes.iter().filter(|s| wanted(&s.name)) {
        progress.check()?;
        let prepared = prepare(manifest_file, spec, progress)?;
        let Prepared {
            scene,
            domain,
            jobs,
        } = &prepared;
        progress.stage(&spec.name, "building the hierarchy", 0);
        let tracer = Tracer::new(scene, Build::Good);
        for job in jobs {
            let baked = bake::prm::bake(&tracer, domain, &job.parameters, progress)?;
            progress.stage(&spec.name, "writing", 0);
            let dir = bake::publish(&output, scene, domain, job, &baked)?;
            progress.finish();
            done(&prepared, &tracer, &baked, &dir)?;
        }
    }
    Ok(())
}
