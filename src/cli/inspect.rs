//! `lightkiln inspect`

use super::bytes;
use lightkiln::error::{Error, Result};
use lightkiln_format::index::Index;
use lightkiln_format::prm::Prm;
use std::path::Path;

pub fn run(path: &Path) -> Result<u8> {
    let index = path.join("index.json");
    if index.is_file() {
        folder(&index)
    } else if path.join("prm.safetensors").is_file() {
        map(&path.join("prm.safetensors"))
    } else if path.extension().is_some_and(|e| e == "json") {
        folder(path)
    } else if path.is_file() {
        map(path)
    } else {
        Err(Error::input(
            path,
            "asset",
            "holds neither index.json nor prm.safetensors",
            "give an output folder, the folder of a baked scene, or one of these files",
        ))
    }
}

fn folder(path: &Path) -> Result<u8> {
    let index = Index::read(path)?;
    println!(
        "{}: written by lightkiln {}",
        path.display(),
        index.tool_version
    );
    for asset in &index.assets {
        println!(
            "\n{} · {} ({} version {}) · plan {}",
            asset.name,
            asset.technique,
            asset.kind,
            asset.format_version,
            &asset.plan_key[..12.min(asset.plan_key.len())]
        );
        println!("  parameters {}", asset.parameters);
        println!("  statistics {}", asset.statistics);
        for file in &asset.files {
            println!(
                "  {:<36} {:>10}  blake3 {}",
                file.path,
                bytes(file.bytes),
                &file.blake3[..16]
            );
        }
        for note in &asset.skips {
            println!("  skipped: {} ({})", note.reason, note.count);
        }
        for note in &asset.repairs {
            println!("  {}: {} ({})", note.element, note.reason, note.count);
        }
        let measured = path.with_file_name(&asset.name).join("verify.json");
        if let Ok(text) = std::fs::read_to_string(&measured)
            && let Ok(value) = serde_json::from_str::<serde_json::Value>(&text)
        {
            println!(
                "  measured: median pose {}, worst {}{}",
                value["median"],
                value["worst"],
                if value["plan_key"] == asset.plan_key {
                    ""
                } else {
                    " (of an older bake)"
                }
            );
        }
    }
    Ok(0)
}

fn map(path: &Path) -> Result<u8> {
    let prm = Prm::read(path)?;
    let dense = prm.blocks() * prm.cells();
    println!("{}: precomputed radiance map", path.display());
    println!("  origin       {:?} m", prm.origin);
    println!("  pages        {:?} texels", prm.pages);
    println!(
        "  points       {} in {} blocks",
        prm.point_texel.len(),
        prm.blocks()
    );
    println!(
        "  cells        {} with {} entry points",
        prm.cells(),
        prm.entry_position.len()
    );
    println!(
        "  rows         {} ({:.1} % of {dense}), {}",
        prm.row_cell.len(),
        100.0 * prm.row_cell.len() as f64 / dense.max(1) as f64,
        bytes(prm.row_response.len() as u64 * 2)
    );
    println!("  filled       {} texels", prm.fill.len());
    let unit = vec![[1.0; 3]; prm.cells()];
    if let Ok(totals) = prm.evaluate(&unit) {
        let n = totals.len() as f64;
        for (k, name) in ["red", "green", "blue"].iter().enumerate() {
            let mean = totals.iter().map(|t| f64::from(t[k])).sum::<f64>() / n;
            let most = totals.iter().map(|t| t[k]).fold(0.0, f32::max);
            println!("  total gain   {name}: mean {mean:.4}, largest {most:.4}");
        }
    }
    Ok(0)
}
