//! Lightmap atlas: texture coordinates for every static triangle, the texels they cover, and what
//! fills the texels they do not.
//!
//! Authored second texture coordinates are kept where they are usable (`authored.rs`); everything
//! else is unwrapped (`unwrap.rs`). [`reference_points`] turns the coordinates into reference points,
//! and [`dilation()`] says from which point each remaining texel is copied.

mod authored;
mod coverage;
mod dilation;
mod polygon;
mod unwrap;

pub use coverage::reference_points;
pub use dilation::{Fill, NO_SOURCE, dilation};

use super::{LightmapUvs, NO_CHART, NO_PAGE};
use crate::error::{Error, Result};
use crate::scene::{Role, Scene};
use glam::{DVec2, Vec2};
use std::path::Path;

/// Most texels of surface that [`unwrap`] accepts: 4096 x 4096. Reference points take about 100
/// bytes a texel while they are made, so this bounds memory at some 2 GB.
pub const MAX_TEXELS: u64 = 1 << 24;

/// Most texels of all pages together, packing waste and padding included.
pub const MAX_PAGE_TEXELS: u64 = 1 << 28;

/// Largest side of a page, texels: what WebGPU guarantees for 2-D textures.
pub const MAX_PAGE_SIDE: u32 = 8192;

/// Pages are cropped to their content, rounded up to this many texels (the tile of
/// [`reference_points`]).
const PAGE_STEP: u32 = 8;

/// How [`unwrap`] lays out the atlas.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AtlasOptions {
    /// Texel density, texels per metre of surface.
    pub texels_per_metre: f32,
    /// Side of a page, texels. Pages grow to the next power of two, up to [`MAX_PAGE_SIDE`], that
    /// holds the largest chart, and are cropped to their content.
    pub page_size: u32,
    /// Empty texels around each chart: two charts are at least twice this apart.
    pub padding: u32,
}

impl Default for AtlasOptions {
    fn default() -> Self {
        Self {
            texels_per_metre: 8.0,
            page_size: 1024,
            padding: 2,
        }
    }
}

/// One instance or unwrapped set of instances, placed: page, coordinates and chart of triangles.
struct Placed {
    triangle: u32,
    page: u32,
    chart: u32,
    corners: [DVec2; 3],
}

/// Lays out a lightmap for every triangle of a [`Role::Static`] instance.
///
/// Zero-area triangles receive no page. `progress` is called with the fraction done, in `[0, 1]`,
/// possibly from worker threads but never concurrently; `false` cancels. The result depends on the
/// scene and the options alone, not on the number of threads.
///
/// # Errors
/// [`Error::Input`] when an option is out of range, when the static surface needs more than
/// [`MAX_TEXELS`] texels (found before anything is unwrapped) or a chart is larger than
/// [`MAX_PAGE_SIDE`]; [`Error::Interrupted`] when cancelled.
pub fn unwrap(
    scene: &Scene,
    options: &AtlasOptions,
    progress: &(dyn Fn(f32) -> bool + Sync),
) -> Result<LightmapUvs> {
    validate(scene, options)?;
    let going = |fraction| {
        if progress(fraction) {
            Ok(())
        } else {
            Err(Error::Interrupted)
        }
    };
    going(0.0)?;

    let (mut kept, mut others) = (Vec::new(), Vec::new());
    for instance in scene.instances.iter().filter(|i| i.role == Role::Static) {
        match authored::layout(scene, instance, options.texels_per_metre) {
            Some(layout) => kept.push(layout),
            None => others.push(instance.triangles.clone()),
        }
        going(0.0)?;
    }
    let unwrapped = unwrap::unwrap(scene, &others, options, &|f| progress(0.95 * f))?;
    let (page_base, chart_base) = unwrapped
        .iter()
        .fold((0, 0), |(p, c), t| (p.max(t.page + 1), c.max(t.chart + 1)));
    let authored = authored::pack(kept, options, page_base, chart_base);
    let uvs = assemble(scene, unwrapped.into_iter().chain(authored), options)?;
    going(1.0)?;
    Ok(uvs)
}

fn refuse(scene: &Scene, field: &str, problem: String, remedy: &str) -> Error {
    Error::input(
        Path::new(&scene.name),
        format!("domain.{field}"),
        problem,
        remedy,
    )
}

fn validate(scene: &Scene, options: &AtlasOptions) -> Result<()> {
    let density = options.texels_per_metre;
    if !(density.is_finite() && density > 0.0) {
        return Err(refuse(
            scene,
            "texels_per_metre",
            format!("{density} is not a density"),
            "give a positive number of texels per metre, for example 8",
        ));
    }
    if options.page_size > MAX_PAGE_SIDE || options.padding > 64 {
        return Err(refuse(
            scene,
            "page_size",
            format!(
                "{} with padding {} is too large",
                options.page_size, options.padding
            ),
            "give a page_size of at most 8192 and a padding of at most 64 texels",
        ));
    }
    if options.page_size < 8 || options.page_size <= 4 * options.padding {
        return Err(refuse(
            scene,
            "page_size",
            format!(
                "{} leaves no room inside padding {}",
                options.page_size, options.padding
            ),
            "give a page_size of at least 8 texels and more than four times the padding",
        ));
    }
    let area: f64 = (0..scene.triangles.len() as u32)
        .filter(|&t| scene.role_of(t) == Role::Static)
        .map(|t| surface_area(scene, t))
        .sum();
    let texels = area * f64::from(density).powi(2);
    if texels > MAX_TEXELS as f64 || !texels.is_finite() {
        let fitting = (MAX_TEXELS as f64 / area).sqrt();
        return Err(refuse(
            scene,
            "texels_per_metre",
            format!(
                "{density} makes {texels:.3e} texels of {area:.3e} m² of static surface; the \
                 limit is {MAX_TEXELS}"
            ),
            &format!(
                "lower texels_per_metre to {fitting:.3} or less, check metres_per_unit, or give \
                 large distant parts the role \"occluder\""
            ),
        ));
    }
    Ok(())
}

/// Area of a triangle, m².
fn surface_area(scene: &Scene, triangle: u32) -> f64 {
    let [a, b, c] = scene.corners(triangle).map(|p| p.as_dvec3());
    0.5 * (b - a).cross(c - a).length()
}

/// Gathers the placed triangles and crops the pages to what is used.
fn assemble(
    scene: &Scene,
    placed: impl Iterator<Item = Placed>,
    options: &AtlasOptions,
) -> Result<LightmapUvs> {
    let count = scene.triangles.len();
    let mut uvs = LightmapUvs {
        pages: Vec::new(),
        page_of: vec![NO_PAGE; count],
        corners: vec![[Vec2::ZERO; 3]; count],
        chart_of: vec![NO_CHART; count],
    };
    let mut used: Vec<DVec2> = Vec::new();
    for Placed {
        triangle,
        page,
        chart,
        corners,
    } in placed
    {
        let too_many = |_| {
            refuse(
                scene,
                "page_size",
                format!(
                    "{} texels needs more than {NO_PAGE} pages",
                    options.page_size
                ),
                "raise page_size or lower texels_per_metre",
            )
        };
        let number = u16::try_from(page + 1).map_err(too_many)? - 1;
        used.resize(used.len().max(page as usize + 1), DVec2::ZERO);
        let extent = &mut used[page as usize];
        *extent = corners.iter().fold(*extent, |e, &c| e.max(c));
        uvs.page_of[triangle as usize] = number;
        uvs.corners[triangle as usize] = corners.map(|c| c.as_vec2());
        uvs.chart_of[triangle as usize] = chart;
    }
    let side = |extent: f64| {
        (extent.ceil() as u32)
            .saturating_add(options.padding)
            .next_multiple_of(PAGE_STEP)
    };
    uvs.pages = used.iter().map(|e| [side(e.x), side(e.y)]).collect();
    let texels: u64 = uvs
        .pages
        .iter()
        .map(|&[w, h]| u64::from(w) * u64::from(h))
        .sum();
    if texels > MAX_PAGE_TEXELS {
        return Err(refuse(
            scene,
            "padding",
            format!("{} makes {texels} texels of pages", options.padding),
            "lower padding or texels_per_metre",
        ));
    }
    Ok(uvs)
}
