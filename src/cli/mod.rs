//! The command line: the only code that prints.

mod bake;
mod evaluate;
mod inspect;
mod plan;
mod verify;
mod watch;

use clap::{Parser, Subcommand};
use lightkiln::error::{Error, Result};
use lightkiln::manifest::Manifest;
use lightkiln::progress::Progress;
use lightkiln::scene::Finding;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;

/// Exit code of an interrupted command.
const INTERRUPTED: i32 = 130;

/// Bakes light transport of glTF and OBJ scenes for real-time lighting.
#[derive(Parser)]
#[command(name = "lightkiln", version)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

/// Exit codes: 0 done, 1 failed, 2 wrong usage or manifest, 4 error above the limit asked for,
/// 130 interrupted.
#[derive(Subcommand)]
enum Command {
    /// Tells what a bake would do, at what cost; traces nothing.
    Plan {
        #[command(flatten)]
        scenes: Scenes,
        /// Machine-readable output.
        #[arg(long, value_enum, default_value_t)]
        format: plan::Format,
    },
    /// Bakes the manifest's scenes.
    Bake {
        #[command(flatten)]
        scenes: Scenes,
    },
    /// Tells what an output folder or an asset file holds.
    Inspect {
        /// Output folder, `index.json` or `prm.safetensors`.
        path: PathBuf,
    },
    /// Lights an asset on the CPU as the runtime does; writes CSV, one line a reference point.
    Evaluate {
        /// Folder of a baked scene (with `prm.safetensors` and `scene.lit.glb`).
        asset: PathBuf,
        /// Lighting file.
        #[arg(long)]
        lighting: PathBuf,
        /// File to write; standard output if absent.
        #[arg(long)]
        out: Option<PathBuf>,
    },
    /// Compares baked assets with the unbiased reference; writes `verify.json` and `verify.html`.
    Verify {
        #[command(flatten)]
        scenes: Scenes,
        /// Exit with 4 if the median pose's relative RMS error exceeds this.
        #[arg(long)]
        max_error: Option<f64>,
        /// Lamp poses.
        #[arg(long, default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..))]
        poses: u32,
        /// Reference points a pose.
        #[arg(long, default_value_t = 256, value_parser = clap::value_parser!(u32).range(1..))]
        points: u32,
        /// Reference paths a point.
        #[arg(long, default_value_t = 2048, value_parser = clap::value_parser!(u32).range(1..))]
        paths: u32,
    },
}

/// Which scenes of which manifest.
#[derive(clap::Args)]
struct Scenes {
    /// The manifest.
    #[arg(long, default_value = "pipeline.toml")]
    manifest: PathBuf,
    /// Only the scene of this name (may be repeated).
    #[arg(long, value_name = "NAME")]
    only: Vec<String>,
}

impl Scenes {
    /// Reads the manifest and checks the names given.
    fn read(&self) -> Result<Manifest> {
        let manifest = Manifest::read(&self.manifest)?;
        for name in &self.only {
            if !manifest.scenes.iter().any(|s| &s.name == name) {
                let names: Vec<&str> = manifest.scenes.iter().map(|s| s.name.as_str()).collect();
                return Err(Error::manifest(
                    &self.manifest,
                    "--only",
                    format!("has no scene `{name}`"),
                    format!("its scenes are: {}", names.join(", ")),
                ));
            }
        }
        Ok(manifest)
    }

    fn wants(&self, name: &str) -> bool {
        self.only.is_empty() || self.only.iter().any(|n| n == name)
    }
}

/// Runs the command given by the process's arguments.
pub fn run() -> ExitCode {
    let arguments = Arguments::parse();
    let progress = Arc::new(Progress::default());
    let on_signal = Arc::clone(&progress);
    // Without a handler Ctrl-C still leaves whole files: they are renamed into place when complete.
    let _ = ctrlc::set_handler(move || {
        if on_signal.cancelled() {
            // The second time: do not wait for the stage to end.
            std::process::exit(INTERRUPTED);
        }
        on_signal.cancel();
    });
    match dispatch(&arguments.command, &progress) {
        Ok(code) => ExitCode::from(code),
        Err(error) => {
            eprintln!("error: {error}");
            if let Some(remedy) = error.remedy() {
                eprintln!("  help: {remedy}");
            }
            ExitCode::from(match error {
                Error::Manifest { .. } => 2,
                Error::Interrupted => INTERRUPTED as u8,
                _ => 1,
            })
        }
    }
}

fn dispatch(command: &Command, progress: &Arc<Progress>) -> Result<u8> {
    match command {
        Command::Plan { scenes, format } => plan::run(scenes, *format, progress),
        Command::Bake { scenes } => bake::run(scenes, progress),
        Command::Inspect { path } => inspect::run(path),
        Command::Evaluate {
            asset,
            lighting,
            out,
        } => evaluate::run(asset, lighting, out.as_deref(), progress),
        Command::Verify {
            scenes,
            max_error,
            poses,
            points,
            paths,
        } => {
            let effort = lightkiln::verify::statistics::Effort {
                poses: *poses,
                points: *points,
                paths: *paths,
            };
            verify::run(scenes, *max_error, &effort, progress)
        }
    }
}

/// A byte count for people.
fn bytes(n: u64) -> String {
    let n = n as f64;
    if n >= 1e9 {
        format!("{:.2} GB", n / 1e9)
    } else if n >= 1e6 {
        format!("{:.1} MB", n / 1e6)
    } else {
        format!("{:.1} kB", n / 1e3)
    }
}

/// A count for people.
fn count(n: u64) -> String {
    let n = n as f64;
    if n >= 1e9 {
        format!("{:.2} G", n / 1e9)
    } else if n >= 1e6 {
        format!("{:.1} M", n / 1e6)
    } else if n >= 1e4 {
        format!("{:.1} k", n / 1e3)
    } else {
        format!("{n}")
    }
}

/// One line for all findings that say the same of different elements; `index.json` has them all.
fn grouped<'a>(findings: impl IntoIterator<Item = &'a Finding>) -> Vec<String> {
    let mut groups: Vec<(&str, &str, usize, u64)> = Vec::new();
    for finding in findings {
        match groups.iter_mut().find(|g| g.1 == finding.what) {
            Some(group) => {
                group.2 += 1;
                group.3 += finding.count;
            }
            None => groups.push((&finding.element, &finding.what, 0, finding.count)),
        }
    }
    let line = |(element, what, others, count): (&str, &str, usize, u64)| {
        let others = if others > 0 {
            format!(" and {others} more")
        } else {
            String::new()
        };
        format!("  {element}{others}: {what} ({count})")
    };
    groups.into_iter().map(line).collect()
}

/// Writes a file whole or not at all.
fn write(path: &Path, data: &[u8]) -> Result<()> {
    lightkiln_format::container::atomic_write(path, data)?;
    Ok(())
}

/// An encoder's complaint as an error about `path`.
fn encoding(path: &Path) -> impl Fn(String) -> Error + '_ {
    move |problem| Error::input(path, "picture", problem, "report this as a bug")
}
