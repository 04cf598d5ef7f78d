//! Shows progress: a bar with rate and time left on a terminal, plain lines otherwise.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use lightkiln::progress::Progress;
use std::io::IsTerminal;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// How often the bar is redrawn.
const TICK: Duration = Duration::from_millis(100);

/// How often a long stage says a line where there is no terminal.
const LINE: Duration = Duration::from_secs(10);

/// Shows a [`Progress`] until dropped.
pub struct Watch {
    over: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Watch {
    /// Starts showing `progress` on standard error.
    pub fn start(progress: &Arc<Progress>) -> Self {
        let over = Arc::new(AtomicBool::new(false));
        let (progress, stop) = (Arc::clone(progress), Arc::clone(&over));
        let thread = std::thread::spawn(move || {
            if std::io::stderr().is_terminal() {
                bars(&progress, &stop)
            } else {
                lines(&progress, &stop)
            }
        });
        Self {
            over,
            thread: Some(thread),
        }
    }
}

impl Drop for Watch {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // A panic of the watcher has already been reported and concerns the display alone.
            let _ = thread.join();
        }
    }
}

fn bars(progress: &Progress, over: &AtomicBool) {
    let bar = ProgressBar::with_draw_target(Some(1), ProgressDrawTarget::stderr());
    let known = ProgressStyle::with_template(
        "{prefix:>12} {msg:<28} [{bar:32}] {percent:>3} % · {elapsed} · {eta} left",
    );
    let unknown = ProgressStyle::with_template("{prefix:>12} {msg:<28} {spinner} {elapsed}");
    let mut shown = ("", String::new());
    let mut since = (Instant::now(), 0);
    while !over.load(Ordering::Relaxed) {
        let (stage, done, rays) = progress.now();
        if shown != (stage.name, stage.scene.clone()) {
            shown = (stage.name, stage.scene.clone());
            since = (Instant::now(), rays);
            bar.reset();
            let style = if stage.total > 0 { &known } else { &unknown };
            if let Ok(style) = style {
                bar.set_style(style.clone());
            }
            bar.set_length(stage.total.max(1));
            bar.set_prefix(stage.scene.clone());
        }
        let traced = rays - since.1;
        let rate = traced as f64 / since.0.elapsed().as_secs_f64().max(1e-3) / 1e6;
        let message = if traced > 0 {
            format!("{} {rate:.1} Mray/s", stage.name)
        } else {
            stage.name.to_string()
        };
        bar.set_message(message);
        bar.set_position(done);
        std::thread::sleep(TICK);
    }
    bar.finish_and_clear();
}

fn lines(progress: &Progress, over: &AtomicBool) {
    let mut told = 0;
    let mut started = Instant::now();
    let mut last = Instant::now();
    while !over.load(Ordering::Relaxed) {
        let (stage, done, rays) = progress.now();
        for (scene, name, took) in &stage.finished[told.min(stage.finished.len())..] {
            eprintln!("{scene}: {name}: {:.2} s", took.as_secs_f64());
            started = Instant::now();
            last = started;
        }
        told = stage.finished.len();
        if stage.total > 0 && last.elapsed() > LINE {
            last = Instant::now();
            let share = done as f64 / stage.total as f64;
            let elapsed = started.elapsed().as_secs_f64();
            let left = if share > 0.0 {
                elapsed / share - elapsed
            } else {
                f64::NAN
            };
            eprintln!(
                "{}: {}: {:.0} %, {left:.0} s left, {:.1} M rays so far",
                stage.scene,
                stage.name,
                share * 100.0,
                rays as f64 / 1e6
            );
        }
        std::thread::sleep(TICK);
    }
    let (stage, ..) = progress.now();
    for (scene, name, took) in &stage.finished[told.min(stage.finished.len())..] {
        eprintln!("{scene}: {name}: {:.2} s", took.as_secs_f64());
    }
}
