//! The built command on a tiny room: outputs, exit codes, refusals, interruption, determinism.

use lightkiln_format::index::Index;
use lightkiln_format::prm::Prm;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use tempfile::TempDir;

/// A room of 2 m, front sides inward, one colour.
const ROOM_OBJ: &str = "\
mtllib room.mtl
usemtl wall
v -1 0 -1
v 1 0 -1
v 1 0 1
v -1 0 1
v -1 2 -1
v 1 2 -1
v 1 2 1
v -1 2 1
f 4 3 2 1
f 5 6 7 8
f 1 2 6 5
f 3 4 8 7
f 2 3 7 6
f 4 1 5 8
";

const ROOM_MTL: &str = "newmtl wall\nKd 0.6 0.5 0.4\n";

const LAMP: &str = "\
[[light]]
kind = \"point\"
position = [0.2, 1.5, -0.1]
intensity = [10.0, 9.0, 8.0]
";

/// A manifest's words about the room: a bake of a second, unless `texels` and `samples` say more.
fn room(name: &str, texels: u32, samples: u32) -> String {
    format!(
        "[[scene]]\nname = \"{name}\"\npath = \"room.obj\"\n\
         [[scene.lamp_volume]]\nbox = [[-0.8, 0.2, -0.8], [0.8, 1.8, 0.8]]\n\
         [scene.domain]\nkind = \"atlas\"\ntexels_per_metre = {texels}.0\n\
         [[scene.bake]]\ntechnique = \"prm\"\nsamples = {samples}\ncells = 24\n"
    )
}

/// A folder with the room, a lighting file and a manifest.
fn project(manifest: &str) -> TempDir {
    let dir = tempfile::tempdir().unwrap();
    fs::write(dir.path().join("room.obj"), ROOM_OBJ).unwrap();
    fs::write(dir.path().join("room.mtl"), ROOM_MTL).unwrap();
    fs::write(dir.path().join("lamp.toml"), LAMP).unwrap();
    fs::write(dir.path().join("pipeline.toml"), manifest).unwrap();
    dir
}

fn command(dir: &TempDir, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lightkiln"));
    command.args(arguments).current_dir(dir.path());
    command
}

/// Runs to the end; what was printed, and the exit code.
fn run(dir: &TempDir, arguments: &[&str]) -> (String, String, i32) {
    said(command(dir, arguments).output().unwrap())
}

fn said(output: Output) -> (String, String, i32) {
    let text = |bytes| String::from_utf8(bytes).unwrap();
    let code = output.status.code().expect("ends by itself");
    (text(output.stdout), text(output.stderr), code)
}

/// Runs to the end, expecting success; what was printed.
fn done(dir: &TempDir, arguments: &[&str]) -> String {
    let (out, err, code) = run(dir, arguments);
    assert_eq!(code, 0, "{arguments:?}: {err}");
    out
}

/// All files below a folder.
fn files(dir: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(dir).unwrap().map(|e| e.unwrap().path());
    entries
        .flat_map(|p| if p.is_dir() { files(&p) } else { vec![p] })
        .collect()
}

/// Every file that the index of `baked` lists is there, with the size and digest it says.
fn index_holds(baked: &Path) -> Index {
    let index = Index::read(&baked.join("index.json")).unwrap();
    for file in index.assets.iter().flat_map(|a| &a.files) {
        let bytes = fs::read(baked.join(&file.path)).unwrap();
        assert_eq!(bytes.len() as u64, file.bytes, "{}", file.path);
        let digest = blake3::hash(&bytes).to_hex();
        assert_eq!(digest.as_str(), file.blake3, "{}", file.path);
    }
    index
}

#[test]
fn a_plan_is_a_table_or_json_and_writes_nothing() {
    let dir = project(&room("den", 6, 16));
    let table = done(&dir, &["plan"]);
    assert!(table.lines().any(|l| l.starts_with("den ")), "{table}");
    let json = done(&dir, &["plan", "--format", "json"]);
    let jobs: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!(jobs[0]["scene"], "den");
    assert_eq!(jobs[0]["parameters"]["samples"], 16);
    assert_eq!(jobs[0]["triangles"], 12);
    assert!((jobs[0]["surface"].as_f64().unwrap() - 24.0).abs() < 1e-3);
    assert_eq!(jobs[0]["key"].as_str().unwrap().len(), 64);
    assert!(!dir.path().join("baked").exists());
}

#[test]
fn a_bake_can_be_inspected_evaluated_and_verified() {
    let dir = project(&room("den", 6, 1));
    done(&dir, &["bake"]);
    let baked = dir.path().join("baked");
    let index = index_holds(&baked);
    assert_eq!(index.assets.len(), 1);
    assert_eq!(index.assets[0].format_version, 1);
    for name in ["direct.png", "indirect.png", "lit.png"] {
        assert!(baked.join("den").join(name).is_file(), "{name}");
    }
    let timings = fs::read_to_string(baked.join("timings.json")).unwrap();
    serde_json::from_str::<serde_json::Value>(&timings).unwrap();

    for path in ["baked", "baked/index.json"] {
        assert!(done(&dir, &["inspect", path]).contains("den · prm (lightkiln-prm version 1)"));
    }
    for path in ["baked/den", "baked/den/prm.safetensors"] {
        assert!(done(&dir, &["inspect", path]).contains("total gain"));
    }

    let csv = done(&dir, &["evaluate", "baked/den", "--lighting", "lamp.toml"]);
    let prm = Prm::read(&baked.join("den/prm.safetensors")).unwrap();
    assert_eq!(csv.lines().count(), 1 + prm.point_texel.len());
    let mut brightest = 0.0_f64;
    for line in csv.lines().skip(1) {
        let numbers: Vec<f64> = line.split(',').map(|n| n.parse().unwrap()).collect();
        assert_eq!(numbers.len(), 12);
        assert!(numbers.iter().all(|n| n.is_finite()), "{line}");
        // The lamp is redder than blue and so are the walls.
        assert!(numbers[9] >= numbers[11] && numbers[11] >= 0.0, "{line}");
        brightest = brightest.max(numbers[9]);
    }
    assert!(brightest > 0.0);
    let to_file = ["evaluate", "baked/den", "--lighting", "lamp.toml", "--out"];
    done(&dir, &[to_file.as_slice(), &["out.csv"]].concat());
    assert_eq!(fs::read_to_string(dir.path().join("out.csv")).unwrap(), csv);

    // One path a point: an error far above what the reference's own noise leaves.
    let quick = ["verify", "--poses", "2", "--points", "64", "--paths", "16"];
    done(&dir, &[quick.as_slice(), &["--max-error", "1000"]].concat());
    assert!(baked.join("den/verify.json").is_file());
    assert!(baked.join("den/verify.html").is_file());
    let (out, _, code) = run(&dir, &[quick.as_slice(), &["--max-error", "0"]].concat());
    assert_eq!(code, 4, "{out}");
    assert!(done(&dir, &["inspect", "baked"]).contains("measured: median pose"));
    index_holds(&baked);
}

#[test]
fn refusals_name_what_is_wrong_and_what_to_do() {
    let good = room("den", 6, 16);
    let wrong_key = good.replace("texels_per_metre", "texels_per_meter");
    let (_, err, code) = run(&project(&wrong_key), &["plan"]);
    assert_eq!(code, 2, "{err}");
    assert!(err.contains("texels_per_meter"), "{err}");
    assert!(err.contains("did you mean `texels_per_metre`?"), "{err}");

    let no_file = good.replace("room.obj", "missing.obj");
    let (_, err, code) = run(&project(&no_file), &["bake"]);
    assert_eq!(code, 1, "{err}");
    assert!(err.contains("missing.obj"), "{err}");

    let dir = project(&good);
    let (_, err, code) = run(&dir, &["bake", "--only", "attic"]);
    assert_eq!(code, 2, "{err}");
    assert!(err.contains("attic") && err.contains("den"), "{err}");
    let (_, err, code) = run(&dir, &["verify", "--poses", "0"]);
    assert_eq!(code, 2, "{err}");
    let (_, err, code) = run(&dir, &["verify"]);
    assert_eq!(code, 1, "nothing is baked yet: {err}");
    let (_, err, code) = run(&dir, &["inspect", "nowhere"]);
    assert_eq!(code, 1, "{err}");
    let (_, err, code) = run(&dir, &["frobnicate"]);
    assert_eq!(code, 2, "{err}");
}

#[test]
fn only_bakes_what_is_named_and_keeps_the_rest() {
    let dir = project(&(room("den", 4, 8) + &room("attic", 4, 8)));
    let baked = dir.path().join("baked");
    done(&dir, &["bake", "--only", "attic"]);
    assert!(!baked.join("den").exists());
    done(&dir, &["bake", "--only", "den"]);
    let names: Vec<String> = index_holds(&baked)
        .assets
        .into_iter()
        .map(|a| a.name)
        .collect();
    assert_eq!(names, ["attic", "den"]);
}

#[test]
#[cfg(unix)]
fn an_interrupted_bake_leaves_whole_files_and_earlier_assets() {
    use std::time::{Duration, Instant};
    // Half a minute of gathering at least, in the second scene.
    let dir = project(&(room("den", 4, 8) + &room("hall", 24, 16384)));
    let baked = dir.path().join("baked");
    done(&dir, &["bake", "--only", "den"]);
    let before = fs::read(baked.join("index.json")).unwrap();
    for wait in [20, 300, 1500] {
        let child = command(&dir, &["bake", "--only", "hall"])
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        std::thread::sleep(Duration::from_millis(wait));
        let asked = Instant::now();
        let kill = format!("kill -INT {}", child.id());
        let sent = Command::new("sh").args(["-c", &kill]).status().unwrap();
        assert!(sent.success());
        let (_, err, code) = said(child.wait_with_output().unwrap());
        println!("after {wait} ms: stopped in {:?}", asked.elapsed());
        assert_eq!(code, 130, "{err}");
        assert!(err.contains("interrupted"), "{err}");
        assert_eq!(fs::read(baked.join("index.json")).unwrap(), before);
        index_holds(&baked);
        let left = files(&baked);
        let half = |p: &PathBuf| {
            p.starts_with(baked.join("hall")) || p.to_string_lossy().ends_with(".tmp")
        };
        assert!(!left.iter().any(half), "{left:?}");
    }
}

#[test]
fn the_number_of_threads_changes_no_byte() {
    let names = ["prm.safetensors", "atlas.0.exr", "scene.lit.glb"];
    let mut first: Option<Vec<Vec<u8>>> = None;
    for threads in ["1", "2", "7"] {
        let dir = project(&room("den", 6, 32));
        let output = command(&dir, &["bake"])
            .env("RAYON_NUM_THREADS", threads)
            .output();
        let (_, err, code) = said(output.unwrap());
        assert_eq!(code, 0, "{err}");
        let baked = dir.path().join("baked");
        let mut bytes = vec![fs::read(baked.join("index.json")).unwrap()];
        bytes.extend(names.map(|n| fs::read(baked.join("den").join(n)).unwrap()));
        match &first {
            None => first = Some(bytes),
            Some(first) => assert!(*first == bytes, "{threads} threads differ from 1"),
        }
    }
}
