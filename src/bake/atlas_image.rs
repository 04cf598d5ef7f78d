//! The atlas as OpenEXR images, one a page: position, normal, total response. For digital content
//! tools, and for `evaluate`, which takes the reference points' places from it.

use crate::domain::Domain;
use crate::error::{Error, Result};
use exr::prelude::*;
use glam::{DVec3, Vec3};
use lightkiln_format::prm::Prm;
use std::io::Cursor;
use std::path::Path as FilePath;

/// The images of all pages as EXR files in memory.
///
/// Channels, f32: `position.X/Y/Z` (metres, world), `normal.X/Y/Z` (unit, zero where there is no
/// point), `R/G/B`: the sum of all responses, dimensionless, which is the indirect irradiance under
/// a direct irradiance of 1 W/m² everywhere. Filled texels copy their source.
///
/// # Errors
/// [`Error::Input`] if the encoder refuses.
pub fn encode(file: &FilePath, prm: &Prm, domain: &Domain) -> Result<Vec<Vec<u8>>> {
    let unit = vec![[1.0; 3]; prm.cells()];
    let gain = prm
        .evaluate(&unit)
        .map_err(|e| Error::input(file, "responses", e.to_string(), "report this as a bug"))?;
    let origin = DVec3::from_array(prm.origin);
    let place = |axis: usize| {
        let world = |p: Vec3| (p.as_dvec3() + origin)[axis] as f32;
        domain
            .points
            .iter()
            .map(move |p| world(p.position))
            .collect::<Vec<_>>()
    };
    let normal = |axis: usize| {
        domain
            .points
            .iter()
            .map(|p| p.normal[axis])
            .collect::<Vec<_>>()
    };
    let total = |k: usize| gain.iter().map(|g| g[k]).collect::<Vec<_>>();
    let layers: [(&str, Vec<f32>); 9] = [
        ("position.X", place(0)),
        ("position.Y", place(1)),
        ("position.Z", place(2)),
        ("normal.X", normal(0)),
        ("normal.Y", normal(1)),
        ("normal.Z", normal(2)),
        ("R", total(0)),
        ("G", total(1)),
        ("B", total(2)),
    ];
    (0..prm.pages.len())
        .map(|page| encode_page(file, prm, page, &layers))
        .collect()
}

fn encode_page(
    file: &FilePath,
    prm: &Prm,
    page: usize,
    layers: &[(&str, Vec<f32>)],
) -> Result<Vec<u8>> {
    let [width, height] = prm.pages[page].map(|s| s as usize);
    let mut channels = SmallVec::new();
    for (name, values) in layers {
        let mut pixels = vec![0.0_f32; width * height];
        for (texel, value) in prm.point_texel.iter().zip(values) {
            if usize::from(texel[0]) == page {
                pixels[usize::from(texel[2]) * width + usize::from(texel[1])] = *value;
            }
        }
        for fill in prm.fill.iter().filter(|f| f[0] as usize == page) {
            pixels[fill[2] as usize * width + fill[1] as usize] = values[fill[3] as usize];
        }
        channels.push(AnyChannel::new(*name, FlatSamples::F32(pixels)));
    }
    let layer = Layer::new(
        (width, height),
        LayerAttributes::named("lightmap"),
        Encoding::SMALL_LOSSLESS,
        AnyChannels::sort(channels),
    );
    let mut bytes = Cursor::new(Vec::new());
    // One thread: compressed blocks in file order, the same bytes on any machine.
    Image::from_layer(layer)
        .write()
        .non_parallel()
        .to_buffered(&mut bytes)
        .map_err(|e| Error::input(file, "image", e.to_string(), "report this as a bug"))?;
    Ok(bytes.into_inner())
}

/// Position (metres, world) and normal of every reference point of `prm`, from its atlas images.
///
/// # Errors
/// [`Error::Input`] when an image is missing, damaged or of the wrong size.
pub fn read_points(files: &[std::path::PathBuf], prm: &Prm) -> Result<Vec<[Vec3; 2]>> {
    let mut points = vec![[Vec3::ZERO; 2]; prm.point_texel.len()];
    for (page, file) in files.iter().enumerate() {
        let bad = |problem: String| Error::input(file, "image", problem, "bake the asset again");
        let image = read_first_flat_layer_from_file(file).map_err(|e| bad(e.to_string()))?;
        let [width, height] = prm.pages.get(page).copied().unwrap_or_default();
        if image.layer_data.size != Vec2(width as usize, height as usize) {
            return Err(bad(format!("is not {width} x {height} texels")));
        }
        for (k, name) in ["position.X", "position.Y", "position.Z"]
            .iter()
            .enumerate()
        {
            copy(&image, name, prm, page, |i, x| points[i][0][k] = x).map_err(bad)?;
        }
        for (k, name) in ["normal.X", "normal.Y", "normal.Z"].iter().enumerate() {
            copy(&image, name, prm, page, |i, x| points[i][1][k] = x).map_err(bad)?;
        }
    }
    Ok(points)
}

fn copy(
    image: &Image<Layer<AnyChannels<FlatSamples>>>,
    name: &str,
    prm: &Prm,
    page: usize,
    mut put: impl FnMut(usize, f32),
) -> Result<(), String> {
    let channels = &image.layer_data.channel_data.list;
    let channel = channels.iter().find(|c| c.name.eq(name));
    let Some(FlatSamples::F32(pixels)) = channel.map(|c| &c.sample_data) else {
        return Err(format!("has no f32 channel `{name}`"));
    };
    let width = prm.pages[page][0] as usize;
    for (i, texel) in prm.point_texel.iter().enumerate() {
        if usize::from(texel[0]) == page {
            put(
                i,
                pixels[usize::from(texel[2]) * width + usize::from(texel[1])],
            );
        }
    }
    Ok(())
}
