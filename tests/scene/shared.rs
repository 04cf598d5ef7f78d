use super::check_consistent;
use lightkiln::manifest::Manifest;
use lightkiln::scene::environment::Environment;
use lightkiln::scene::{Scene, load, load_file};
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// The folder of larger scenes, or nothing where it is absent.
fn scenes(test: &str) -> Option<PathBuf> {
    let beside = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/scenes");
    let folder = std::env::var_os("LIGHTKILN_SCENES").map_or(beside, PathBuf::from);
    if folder.is_dir() {
        return Some(folder);
    }
    println!(
        "{test}: skipped, {} is absent (set LIGHTKILN_SCENES)",
        folder.display()
    );
    None
}

/// Triangles by file, as counted by another program.
fn counts(folder: &Path) -> HashMap<String, u64> {
    let text = std::fs::read_to_string(folder.join("STATS.tsv")).expect("STATS.tsv");
    let row = |line: &str| {
        let mut cells = line.split('\t');
        Some((cells.next()?.to_owned(), cells.nth(1)?.parse().ok()?))
    };
    text.lines().filter_map(row).collect()
}

fn dropped(scene: &Scene) -> u64 {
    scene
        .findings
        .iter()
        .filter(|f| f.what.ends_with("are dropped"))
        .map(|f| f.count)
        .sum()
}

#[test]
fn every_manifest_loads_with_all_its_triangles() {
    let Some(folder) = scenes("every_manifest_loads_with_all_its_triangles") else {
        return;
    };
    let counts = counts(&folder);
    let mut loaded = 0;
    for entry in std::fs::read_dir(folder.join("manifests")).expect("manifests") {
        let file = entry.expect("entry").path();
        if file.extension().is_none_or(|e| e != "toml") {
            continue;
        }
        // Their techniques are for later versions; their scenes are for this one.
        let text = std::fs::read_to_string(&file)
            .expect("text")
            .replace("\"portal\"", "\"prm\"");
        let manifest = Manifest::parse(&text, &file).expect("manifest");
        for spec in &manifest.scenes {
            let start = std::time::Instant::now();
            let scene = load(&file, spec).unwrap_or_else(|e| panic!("{}: {e}", spec.name));
            let seconds = start.elapsed().as_secs_f32();
            check_consistent(&scene);
            let path = spec.path.to_string_lossy().replace("../", "");
            let whole = scene.triangles.len() as u64 + dropped(&scene);
            assert_eq!(whole, counts[&path], "{path}");
            let bounds = scene.bounds();
            println!(
                "{}: {} triangles, {} dropped, {} vertices, {} instances, size {}, {seconds:.2} s",
                spec.name,
                scene.triangles.len(),
                dropped(&scene),
                scene.positions.len(),
                scene.instances.len(),
                bounds.max - bounds.min,
            );
            for finding in &scene.findings {
                println!(
                    "    {}: {} ({})",
                    finding.element, finding.what, finding.count
                );
            }
            assert!(
                !scene
                    .findings
                    .iter()
                    .any(|f| f.what.starts_with("matches nothing"))
            );
            loaded += 1;
        }
    }
    assert!(loaded >= 10, "{loaded}");
}

#[test]
fn plain_files_have_all_their_triangles() {
    let Some(folder) = scenes("plain_files_have_all_their_triangles") else {
        return;
    };
    for (path, count) in counts(&folder) {
        // Instancing is not read; compressed geometry is refused.
        if ["teapots-galore", ".draco.", ".meshopt."]
            .iter()
            .any(|s| path.contains(s))
        {
            continue;
        }
        let scene = load_file(&folder.join(&path));
        // A lone water surface or glass object may have no triangle that blocks light.
        let Ok(scene) = scene else {
            panic!("{path}: {}", scene.expect_err("refused"))
        };
        check_consistent(&scene);
        assert_eq!(
            scene.triangles.len() as u64 + dropped(&scene),
            count,
            "{path}"
        );
    }
}

/// Every file of the torture collection loads or is refused; none panics.
#[test]
fn torture_files_never_panic() {
    let Some(folder) = scenes("torture_files_never_panic") else {
        return;
    };
    let mut folders = vec![folder.join("gltf-torture")];
    let (mut good, mut refused) = (0, 0);
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).expect("folder") {
            let path = entry.expect("entry").path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| e == "gltf" || e == "glb") {
                match load_file(&path) {
                    Ok(scene) => {
                        check_consistent(&scene);
                        good += 1;
                    }
                    Err(error) => {
                        println!("{error}");
                        refused += 1;
                    }
                }
            }
        }
    }
    println!("{good} loaded, {refused} refused");
    assert!(good + refused > 300);
}

#[test]
fn environments_load() {
    let Some(folder) = scenes("environments_load") else {
        return;
    };
    for entry in std::fs::read_dir(folder.join("env-maps")).expect("folder") {
        let path = entry.expect("entry").path();
        if path.extension().is_some_and(|e| e == "hdr" || e == "exr") {
            let e = Environment::load(&path).expect("loads");
            println!(
                "{}: {} x {}, {} repaired",
                path.display(),
                e.width,
                e.height,
                e.repaired
            );
            let (direction, radiance, pdf) = e.sample(glam::Vec2::new(0.3, 0.6));
            assert!(pdf > 0.0 && e.lookup(direction) == radiance);
        }
    }
}
