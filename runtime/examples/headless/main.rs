//! Renders a baked scene without a window: `headless DIR`.
//!
//! `DIR` holds `scene.lit.glb` and `prm.safetensors`. Writes `direct.png`, `lit.png`,
//! `difference.png` (false colour of the indirect part) and `sheet.png` (all three).

mod forward;
mod picture;
mod scene;
mod texture;

use std::process::ExitCode;

const USAGE: &str = "\
usage: headless DIR [--out DIR] [--lamp X,Y,Z] [--intensity R,G,B] [--camera X,Y,Z]
                    [--target X,Y,Z] [--fov DEGREES] [--size WIDTHxHEIGHT] [--exposure FACTOR]
Positions are world metres, the intensity W/sr. By default lamp and camera stand in the scene's
first lamp volume, and the exposure maps the 98th percentile of luminance to white.";

fn main() -> ExitCode {
    let result = forward::Options::parse(std::env::args().skip(1));
    match result.and_then(|options| forward::run(&options)) {
        Ok(summary) => {
            println!("{summary}");
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("headless: {error}\n{USAGE}");
            ExitCode::FAILURE
        }
    }
}
