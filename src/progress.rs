//! What long work tells whoever watches it, and how it is stopped. The library only counts; the
//! command line draws.

use crate::error::{Error, Result};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Shared by the worker and the watcher.
#[derive(Debug, Default)]
pub struct Progress {
    stage: Mutex<Stage>,
    done: AtomicU64,
    rays: AtomicU64,
    cancel: AtomicBool,
}

/// A named part of the work, in steps.
#[derive(Debug, Clone, Default)]
pub struct Stage {
    /// Scene worked on.
    pub scene: String,
    /// What is being done.
    pub name: &'static str,
    /// Steps of the stage; zero when not known.
    pub total: u64,
    /// Stages finished so far, with the time each took.
    pub finished: Vec<(String, &'static str, Duration)>,
    since: Option<Instant>,
}

impl Progress {
    /// Starts a stage; ends the one before.
    pub fn stage(&self, scene: &str, name: &'static str, total: u64) {
        let mut stage = self.lock();
        close(&mut stage);
        stage.scene = scene.into();
        stage.name = name;
        stage.total = total;
        stage.since = Some(Instant::now());
        self.done.store(0, Ordering::Relaxed);
    }

    /// Ends the last stage.
    pub fn finish(&self) {
        close(&mut self.lock());
    }

    /// Counts finished steps.
    pub fn step(&self, steps: u64) {
        self.done.fetch_add(steps, Ordering::Relaxed);
    }

    /// Sets the finished share of a stage that knows only that; fails when cancelled.
    pub fn share(&self, share: f32) -> bool {
        let total = self.lock().total;
        self.done
            .store((f64::from(share) * total as f64) as u64, Ordering::Relaxed);
        !self.cancelled()
    }

    /// Counts traced rays.
    pub fn rays(&self, rays: u64) {
        self.rays.fetch_add(rays, Ordering::Relaxed);
    }

    /// The stage now, its finished steps, and all rays so far.
    pub fn now(&self) -> (Stage, u64, u64) {
        let stage = self.lock().clone();
        (
            stage,
            self.done.load(Ordering::Relaxed),
            self.rays.load(Ordering::Relaxed),
        )
    }

    /// Asks the work to stop at the next block.
    pub fn cancel(&self) {
        self.cancel.store(true, Ordering::Relaxed);
    }

    /// Whether the work should stop.
    pub fn cancelled(&self) -> bool {
        self.cancel.load(Ordering::Relaxed)
    }

    /// [`Error::Interrupted`] once cancelled.
    ///
    /// # Errors
    /// When cancelled.
    pub fn check(&self) -> Result<()> {
        if self.cancelled() {
            Err(Error::Interrupted)
        } else {
            Ok(())
        }
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, Stage> {
        self.stage
            .lock()
            .unwrap_or_else(std::sync::PoisonError::into_inner)
    }
}

fn close(stage: &mut Stage) {
    if let Some(since) = stage.since.take() {
        let (scene, name) = (stage.scene.clone(), stage.name);
        stage.finished.push((scene, name, since.elapsed()));
    }
}
