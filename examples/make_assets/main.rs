//! Writes the project's own scenes: `cargo run --release --example make_assets`.
//!
//! Everything is built here, from code alone; `tests/assets.rs` holds the committed files against
//! what this makes.

mod scenes;

use std::path::Path;
use std::process::ExitCode;

fn main() -> ExitCode {
    let assets = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets");
    for scene in scenes::all() {
        let file = assets.join(&scene.name).join(format!("{}.glb", scene.name));
        match write(&scene, &file) {
            Ok(bytes) => println!(
                "{}: {} triangles, {bytes} bytes",
                file.display(),
                scene.triangles.len()
            ),
            Err(problem) => {
                eprintln!("error: {}: {problem}", file.display());
                return ExitCode::FAILURE;
            }
        }
    }
    ExitCode::SUCCESS
}

fn write(scene: &lightkiln::scene::Scene, file: &Path) -> Result<usize, String> {
    let bytes = lightkiln::bake::lit_scene::write_glb(scene, None).map_err(|e| e.to_string())?;
    std::fs::create_dir_all(file.parent().unwrap_or(file)).map_err(|e| e.to_string())?;
    std::fs::write(file, &bytes).map_err(|e| e.to_string())?;
    Ok(bytes.len())
}
