//! Measures what `scripts/accept` asks of the library: `accept GROUP [ARGUMENTS]` prints one JSON
//! object a figure, `{asked, measured, met, notes}`.
//!
//! - `leaks`, `self-hits`: [`tracing`]
//! - `sphere`, `room`, `form-factors`: [`analytic`]
//! - `replay MANIFEST SCENE [RAYS]`: [`replay`]

mod analytic;
mod files;
mod replay;
mod tracing;

#[path = "../../tests/closed_forms.rs"]
mod closed_forms;
#[path = "../../tests/shapes.rs"]
mod shapes;
#[path = "../../tests/walks.rs"]
mod walks;

use std::process::ExitCode;

/// One line of the acceptance table.
pub struct Figure {
    /// What has to hold.
    pub asked: String,
    /// What was found.
    pub measured: String,
    /// Whether it holds.
    pub met: bool,
    /// What a reader needs to judge the figure.
    pub notes: String,
}

impl Figure {
    fn print(&self) {
        println!(
            "{}",
            serde_json::json!({
                "asked": self.asked,
                "measured": self.measured,
                "met": self.met,
                "notes": self.notes,
            })
        );
    }
}

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let figures = match words[..] {
        ["leaks"] => Ok(vec![tracing::leaks()]),
        ["self-hits"] => Ok(vec![tracing::self_hits()]),
        ["sphere"] => analytic::sphere(),
        ["room"] => analytic::room(),
        ["form-factors"] => Ok(analytic::form_factors()),
        ["replay", manifest, scene] => replay::replay(manifest, scene, 20_000_000),
        ["replay", manifest, scene, rays] => match rays.parse() {
            Ok(rays) => replay::replay(manifest, scene, rays),
            Err(_) => return usage(),
        },
        _ => return usage(),
    };
    match figures {
        Ok(figures) => {
            figures.iter().for_each(Figure::print);
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn usage() -> ExitCode {
    eprintln!(
        "usage: accept leaks|self-hits|sphere|room|form-factors|replay MANIFEST SCENE [RAYS]"
    );
    ExitCode::from(2)
}
