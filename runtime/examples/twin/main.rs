//! Lights a baked scene on the GPU and with its CPU twin: `twin DIR [LAMPS]`.
//!
//! `DIR` holds `prm.safetensors` and `scene.lit.glb`. For each point lamp, at equal visibility, the
//! irradiance of all reference points is compared; and the visibility of the entry points as the
//! depth cube sees it with what segments to the lamp meet. Prints one JSON object a figure for
//! `scripts/accept`: `{asked, measured, met, notes}`.

mod lamps;
mod segments;

#[path = "../../tests/gpu.rs"]
mod gpu;
#[path = "../headless/scene.rs"]
#[allow(dead_code, reason = "the twin reads geometry and draws nothing")]
mod scene;
#[path = "../headless/texture.rs"]
#[allow(dead_code, reason = "the twin reads geometry and draws nothing")]
mod texture;

use glam::Vec3;
use lightkiln_format::lighting::Light;
use lightkiln_format::prm::Prm;
use lightkiln_runtime::prm::PrmRuntime;
use lightkiln_runtime::shadow_cube::{SceneMesh, ShadowCubes};
use segments::Triangles;
use std::path::Path;
use std::process::ExitCode;

/// Lamps by default.
const LAMPS: u32 = 8;

/// Texels a side of a cube's face: those of the headless example.
const CUBE: u32 = 512;

/// Largest difference over the mean.
const LIMIT: f64 = 1e-3;

type Gpu = (wgpu::Device, wgpu::Queue);
type Failure = Box<dyn std::error::Error>;

/// What one lamp showed.
struct Found {
    /// Largest difference between GPU and CPU over the mean, in f32.
    difference: f64,
    /// The same of the lightmap, which is rounded to half precision.
    lightmap: f64,
    /// Entry points whose visibility differs between cube and segments.
    differing: usize,
    /// The same, of entry points that face the lamp: the others receive nothing.
    differing_lit: usize,
    /// Entry points that face the lamp.
    lit: usize,
    /// RMS difference of the irradiance that the differing visibility makes, over the mean.
    effect: f64,
}

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let count = arguments.get(1).map_or(Ok(LAMPS), |n| n.parse());
    let (Some(dir), Ok(count)) = (arguments.first(), count) else {
        eprintln!("usage: twin DIR [LAMPS]");
        return ExitCode::from(2);
    };
    match run(Path::new(dir), count) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("twin: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(dir: &Path, count: u32) -> Result<(), Failure> {
    let prm = Prm::read(&dir.join("prm.safetensors"))?;
    let scene = scene::Scene::read(&dir.join("scene.lit.glb"), prm.origin)?;
    let gpu = gpu::open().ok_or("needs a GPU: unset LIGHTKILN_NO_GPU")?;
    let positions: Vec<[f32; 3]> = scene.vertices.iter().map(|v| v.position).collect();
    let indices = [scene.single_sided.as_slice(), &scene.double_sided].concat();
    let mesh = SceneMesh {
        positions: &positions,
        indices: &indices,
    };
    let mut cubes = ShadowCubes::new(&gpu.0, &gpu.1, &mesh, CUBE)?;
    let triangles = Triangles::new(&positions, &indices);
    let mut runtime = PrmRuntime::new(&gpu.0, &gpu.1, &prm)?;
    let found = lamps::spread(&scene.lamp_volumes, &positions, prm.origin, count)
        .iter()
        .map(|lamp| one(&gpu, &prm, &mut runtime, &mut cubes, &triangles, lamp))
        .collect::<Result<Vec<_>, _>>()?;
    let name = dir.file_name().unwrap_or_default().to_string_lossy();
    let worst = |pick: fn(&Found) -> f64| found.iter().map(pick).fold(0.0, f64::max);
    let sum = |pick: fn(&Found) -> usize| found.iter().map(pick).sum::<usize>();
    let share = |n: usize, of: usize| 100.0 * n as f64 / of.max(1) as f64;
    let difference = worst(|f| f.difference).max(worst(|f| f.lightmap));
    let entries = prm.entry_position.len();
    println!(
        "{}",
        serde_json::json!({
            "asked": format!(
                "{name}: WGSL against the CPU twin at equal visibility, largest difference {LIMIT:.0e} of the mean"
            ),
            "measured": format!(
                "{:.1e} (lightmap beyond its half-float rounding {:.1e})",
                worst(|f| f.difference),
                worst(|f| f.lightmap)
            ),
            "met": difference <= LIMIT,
            "notes": format!(
                "{count} lamps, {entries} entry points on {}; visibility by {CUBE}-texel depth cubes \
                 differs from exact segments at {:.2} % of entry points, {:.2} % of those that face \
                 the lamp (at most {:.2} % for one lamp); that moves irradiance by at most {:.2} % of \
                 the mean (RMS)",
                gpu.0.adapter_info().name,
                share(sum(|f| f.differing), entries * found.len()),
                share(sum(|f| f.differing_lit), sum(|f| f.lit)),
                worst(|f| 100.0 * f.differing_lit as f64 / f.lit.max(1) as f64),
                100.0 * worst(|f| f.effect),
            ),
        })
    );
    Ok(())
}

/// The larger of two differences; one that is not a number is infinite.
fn larger(a: f64, b: f64) -> f64 {
    if b.is_nan() { f64::INFINITY } else { a.max(b) }
}

fn one(
    gpu: &Gpu,
    prm: &Prm,
    runtime: &mut PrmRuntime,
    cubes: &mut ShadowCubes,
    triangles: &Triangles,
    light: &Light,
) -> Result<Found, Failure> {
    let lights = std::slice::from_ref(light);
    runtime.set_lights(lights)?;
    gpu::submit(gpu, |encoder| {
        runtime.see_entries(encoder, cubes)?;
        runtime.encode(encoder)
    })?;
    let entries = prm.entry_position.len();
    let seen: Vec<f32> = gpu::read(gpu, runtime.visibility());
    let seen = &seen[..entries];
    let expected = prm.evaluate(&prm.cell_irradiance(lights, seen)?)?;
    let mean = expected
        .iter()
        .flatten()
        .map(|&v| f64::from(v))
        .sum::<f64>()
        / (3 * expected.len()) as f64;

    let points: Vec<[f32; 4]> = gpu::read(gpu, runtime.points());
    let pairs = expected.iter().zip(&points);
    let difference = pairs
        .flat_map(|(e, p)| (0..3).map(move |c| f64::from((e[c] - p[c]).abs())))
        .fold(0.0, larger);
    let mut lightmap = 0.0_f64;
    for (page, texels) in prm.lightmap(&expected)?.iter().enumerate() {
        let layer = gpu::read_layer(gpu, runtime.lightmap().texture(), page as u32);
        let stride = runtime.lightmap().texture().width() as usize;
        let width = prm.pages[page][0] as usize;
        for (i, texel) in texels.iter().enumerate() {
            let found = layer[i / width * stride + i % width];
            for c in 0..3 {
                // A device may round to half precision either way: 2^-10 of the value.
                let excess = (found[c] - texel[c]).abs() - texel[c] / 1024.0;
                lightmap = larger(lightmap, f64::from(excess));
            }
        }
    }

    let lamp: Vec3 = runtime.lamps()[0].position.into();
    let exact: Vec<f32> = prm
        .entry_position
        .iter()
        .map(|&p| f32::from(u8::from(!triangles.block(p.into(), lamp))))
        .collect();
    let faces = |i: usize| {
        let (p, n) = (prm.entry_position[i], prm.entry_normal[i]);
        (lamp - Vec3::from(p)).dot(n.into()) > 0.0
    };
    let differs = |i: &usize| (seen[*i] > 0.5) != (exact[*i] > 0.5);
    let by_segments = prm.evaluate(&prm.cell_irradiance(lights, &exact)?)?;
    let squares = by_segments
        .iter()
        .flatten()
        .zip(expected.iter().flatten())
        .map(|(a, b)| f64::from(a - b).powi(2))
        .sum::<f64>();
    Ok(Found {
        difference: difference / mean,
        lightmap: lightmap / mean,
        differing: (0..entries).filter(differs).count(),
        differing_lit: (0..entries).filter(|&i| faces(i)).filter(differs).count(),
        lit: (0..entries).filter(|&i| faces(i)).count(),
        effect: (squares / (3 * expected.len()) as f64).sqrt() / mean,
    })
}
