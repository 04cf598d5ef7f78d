//! The shaders against their CPU twin at equal visibility.

use crate::gpu;
use crate::random::{self, Random};
use lightkiln_format::lighting::Light;
use lightkiln_format::prm::Prm;
use lightkiln_runtime::error::RuntimeError;
use lightkiln_runtime::prm::PrmRuntime;

type Gpu = (wgpu::Device, wgpu::Queue);

/// Lights `prm` on both sides; returns the largest difference over the mean, in f32 and in the
/// lightmap.
fn compare(
    gpu: &Gpu,
    prm: &Prm,
    runtime: &mut PrmRuntime,
    lights: &[Light],
    seed: u64,
) -> [f64; 2] {
    let random = &mut Random(seed);
    let entries = prm.entry_position.len();
    let visibility: Vec<_> = (0..lights.len() * entries)
        .map(|_| [0.0, 1.0, random.uniform(0.0, 1.0)][random.below(3)])
        .collect();
    runtime.set_lights(lights).unwrap();
    for (light, values) in visibility.chunks(entries).enumerate() {
        runtime.set_visibility(light, values).unwrap();
    }
    gpu::submit(gpu, |encoder| runtime.encode(encoder)).unwrap();
    let cells = prm.cell_irradiance(lights, &visibility).unwrap();
    let expected = prm.evaluate(&cells).unwrap();
    let sum: f64 = expected.iter().flatten().map(|&v| f64::from(v)).sum();
    let mean = sum / (3 * expected.len()) as f64;
    assert!(mean > 0.0 || expected.len() < 64, "no light to compare");
    let largest = |pairs: &mut dyn Iterator<Item = (f32, f32)>| {
        pairs
            .map(|(a, b)| f64::from((a - b).abs()))
            .fold(0.0, f64::max)
            / mean
    };
    let points: Vec<[f32; 4]> = gpu::read(gpu, runtime.points());
    let pairs = expected.iter().zip(&points);
    let plain = largest(&mut pairs.flat_map(|(e, p)| (0..3).map(move |c| (e[c], p[c]))));
    let mut rounded = 0.0;
    for (page, texels) in prm.lightmap(&expected).unwrap().iter().enumerate() {
        let layer = gpu::read_layer(gpu, runtime.lightmap().texture(), page as u32);
        let stride = runtime.lightmap().texture().width() as usize;
        let width = prm.pages[page][0] as usize;
        for (i, texel) in texels.iter().enumerate() {
            let found = layer[i / width * stride + i % width];
            for channel in 0..3 {
                // A device may round to half precision either way: 2^-10 of the value; the rest
                // counts.
                let excess = (found[channel] - texel[channel]).abs() - texel[channel] / 1024.0;
                rounded = f64::max(rounded, f64::from(excess) / mean);
            }
        }
    }
    [plain, rounded]
}

#[test]
fn the_shaders_equal_their_twin() {
    let Some(gpu) = gpu::open() else { return };
    let mut worst = [0.0; 2];
    // Several pages, short last blocks, one point, none; from one lamp to many, and back.
    for (seed, points, cells, pages) in [
        (1, 1000, 200, 3),
        (2, 64, 5, 1),
        (3, 65, 70, 2),
        (4, 1, 1, 1),
        (5, 0, 3, 1),
    ] {
        let prm = random::prm(seed, points, cells, pages);
        let mut runtime = PrmRuntime::new(&gpu.0, &gpu.1, &prm).unwrap();
        for count in [1, 40, 3] {
            let lights = random::lights(seed + 50, count, prm.origin);
            let found = compare(&gpu, &prm, &mut runtime, &lights, seed);
            for i in 0..2 {
                worst[i] = f64::max(worst[i], found[i]);
            }
        }
    }
    println!(
        "largest difference over the mean: f32 {:.2e}, lightmap {:.2e}",
        worst[0], worst[1]
    );
    assert!(worst[0] <= 1e-5 && worst[1] <= 1e-5, "{worst:?}");
}

#[test]
fn responses_are_split_into_pages() {
    // 64 KiB a binding: 170 rows a chunk, of about 470.
    let Some(gpu) = gpu::open_with(|l| l.max_storage_buffer_binding_size = 1 << 16) else {
        return;
    };
    let prm = random::prm(7, 1500, 30, 2);
    assert!(size_of_val(prm.row_response.as_slice()) > 2 << 16);
    let mut runtime = PrmRuntime::new(&gpu.0, &gpu.1, &prm).unwrap();
    let lights = random::lights(8, 4, prm.origin);
    let found = compare(&gpu, &prm, &mut runtime, &lights, 9);
    assert!(found[0] <= 1e-5 && found[1] <= 1e-5, "{found:?}");

    // A block that does not fit, and points that do not, are refused by name.
    let error = PrmRuntime::new(&gpu.0, &gpu.1, &random::prm(1, 64, 300, 1)).unwrap_err();
    assert!(
        error.to_string().contains("responses of a block"),
        "{error}"
    );
    let error = PrmRuntime::new(&gpu.0, &gpu.1, &random::prm(1, 5000, 1, 1)).unwrap_err();
    assert!(
        error
            .to_string()
            .contains("max_storage_buffer_binding_size"),
        "{error}"
    );
}

#[test]
fn no_lights_give_darkness() {
    let Some(gpu) = gpu::open() else { return };
    let prm = random::prm(11, 100, 9, 1);
    let mut runtime = PrmRuntime::new(&gpu.0, &gpu.1, &prm).unwrap();
    runtime
        .set_lights(&random::lights(12, 1, prm.origin))
        .unwrap();
    runtime
        .set_visibility(0, &vec![1.0; prm.entry_position.len()])
        .unwrap();
    gpu::submit(&gpu, |encoder| runtime.encode(encoder)).unwrap();
    let lit: Vec<[f32; 4]> = gpu::read(&gpu, runtime.points());
    assert!(lit.iter().flatten().any(|v| *v > 0.0));
    runtime.set_lights(&[]).unwrap();
    gpu::submit(&gpu, |encoder| runtime.encode(encoder)).unwrap();
    let dark: Vec<[f32; 4]> = gpu::read(&gpu, runtime.points());
    assert!(dark.iter().flatten().all(|v| *v == 0.0));
}

#[test]
fn wrong_input_is_an_error() {
    let Some(gpu) = gpu::open() else { return };
    let prm = random::prm(13, 100, 9, 1);
    let mut broken = prm.clone();
    broken.row_cell[3] = 9;
    let error = PrmRuntime::new(&gpu.0, &gpu.1, &broken)
        .unwrap_err()
        .to_string();
    assert!(error.contains("row_cell") && error.contains('3'), "{error}");
    let mut runtime = PrmRuntime::new(&gpu.0, &gpu.1, &prm).unwrap();
    runtime
        .set_lights(&random::lights(14, 2, prm.origin))
        .unwrap();
    let entries = prm.entry_position.len();
    runtime.set_visibility(0, &vec![1.0; entries]).unwrap();
    let error = gpu::submit(&gpu, |encoder| runtime.encode(encoder)).unwrap_err();
    assert!(
        matches!(error, RuntimeError::VisibilityMissing { light: 1 }),
        "{error}"
    );
    assert!(runtime.set_visibility(2, &[]).is_err());
    assert!(runtime.set_visibility(1, &vec![1.5; entries]).is_err());
    assert!(runtime.set_visibility(1, &[]).is_err());
}
