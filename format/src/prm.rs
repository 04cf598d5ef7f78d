//! Precomputed radiance maps: indirect irradiance of a static diffuse scene under moving lamps.
//!
//! L. Szécsi, L. Szirmay-Kalos, M. Sbert, *Light animation with precomputed light paths on the
//! GPU*, Graphics Interface 2006. At a reference point `x`
//!
//! ```text
//! E(x) = Σ_c S_c(x) Ē_c        Ē_c = mean over the entry points i of cell c of  E_direct(y_i) v_i
//! ```
//!
//! which is the paper's equation (4) with its clustering (section 5.1): responses of the entry
//! points of a cell summed, their weights averaged. `S_c` is dimensionless RGB and holds every
//! albedo on the way except the receiver's own; the host multiplies `E` by `ρ/π`.
//!
//! Deviations: instead of dense panes of texels by cells, reference points come in blocks of
//! [`LANES`], and a block lists only the cells that reach it; a response is stored as irradiance,
//! not radiance, so albedo textures keep their resolution.
//!
//! The shader is `runtime/shaders/prm.wgsl`; [`Prm::cell_irradiance`] and [`Prm::evaluate`] are its
//! CPU twin, in f32 and in the same order.

use crate::container::{self, ArrayView, Container, Written};
use crate::direct::Lamp;
use crate::error::{AssetError, InvalidArray};
use crate::lighting::{Light, LightingError};
use glam::Vec3;
use half::f16;
use half::slice::HalfFloatSliceExt;
use std::path::Path;

/// Kind of asset, as in the container and the index.
pub const FORMAT: &str = "lightkiln-prm";
/// Version of the layout.
pub const VERSION: u32 = 1;
/// Reference points in a block: one shader workgroup.
pub const LANES: usize = 64;
/// Half floats in a row: red, green and blue of each lane.
pub const ROW: usize = 3 * LANES;
/// Marks a reference point that lies inside a wall: its responses are zero and its texel is filled
/// from another point.
pub const UNSOUND: u16 = 1;
/// Longest side of a page, texels: what current GPUs allow in a 2D texture.
pub const MAX_PAGE_SIDE: u32 = 16_384;
/// Most texels in all pages; bounds what a hostile file can make a reader allocate.
pub const MAX_TEXELS: u64 = 1 << 28;

/// Largest deviation of a squared normal from one: components rounded to half precision.
const NORMAL_TOLERANCE: f32 = 4.0 / 1024.0;

/// A precomputed radiance map. `E`, `C`, `P`, `B`, `R`, `F` below are the numbers of entry points,
/// cells, reference points, blocks, rows and fills.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Prm {
    /// World position, metres, of the local zero; entry positions are relative to it.
    pub origin: [f64; 3],
    /// Width and height of each lightmap page, texels.
    pub pages: Vec<[u32; 2]>,
    /// `E` entry points, metres, local, sorted by cell, lifted off the surface.
    pub entry_position: Vec<[f32; 3]>,
    /// `E` unit normals.
    pub entry_normal: Vec<[f32; 3]>,
    /// `C + 1` prefix sums: the entry points of cell `c` are
    /// `cell_entries[c]..cell_entries[c + 1]`, at least one.
    pub cell_entries: Vec<u32>,
    /// `P` reference points: page, x, y, and 0 or [`UNSOUND`]. [`LANES`] consecutive ones form a
    /// block; the last may be short.
    pub point_texel: Vec<[u16; 4]>,
    /// `B + 1` prefix sums, `B = ⌈P / LANES⌉`: the rows of block `b` are
    /// `block_rows[b]..block_rows[b + 1]`.
    pub block_rows: Vec<u32>,
    /// `R` rows: the cell whose responses the row holds.
    pub row_cell: Vec<u16>,
    /// `R × ROW` responses, dimensionless: for each row red of all lanes, then green, then blue.
    /// Lanes past the last point are zero.
    pub row_response: Vec<f16>,
    /// `F` texels that copy a reference point: page, x, y, point. They stand in for texels without
    /// a sound point, and widen charts so that bilinear filtering stays inside.
    pub fill: Vec<[u32; 4]>,
}

/// Why a [`Prm`] could not be evaluated.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum EvaluateError {
    /// A light is out of range or of an unsupported kind.
    #[error(transparent)]
    Lighting(#[from] LightingError),
    /// A slice has the wrong length or a value out of range.
    #[error(transparent)]
    Input(#[from] InvalidArray),
}

impl Prm {
    /// Number of cells.
    pub fn cells(&self) -> usize {
        self.cell_entries.len().saturating_sub(1)
    }

    /// Number of blocks.
    pub fn blocks(&self) -> usize {
        self.point_texel.len().div_ceil(LANES)
    }

    /// Checks every shape, index and value; what passes can be evaluated and uploaded.
    ///
    /// # Errors
    /// [`InvalidArray`] for the first element that breaks a rule.
    pub fn validate(&self) -> Result<(), InvalidArray> {
        self.validate_pages()?;
        self.validate_entries()?;
        prefix(
            "block_rows",
            &self.block_rows,
            self.blocks(),
            self.row_cell.len(),
            0,
        )?;
        for (i, &cell) in self.row_cell.iter().enumerate() {
            if usize::from(cell) >= self.cells() {
                let problem = format!("is cell {cell} of {}", self.cells());
                return Err(InvalidArray::new("row_cell", i, problem));
            }
        }
        self.validate_responses()?;
        self.validate_texels()
    }

    fn validate_pages(&self) -> Result<(), InvalidArray> {
        if let Some(i) = self.origin.iter().position(|v| !v.is_finite()) {
            return Err(InvalidArray::new("origin", i, "is not finite"));
        }
        let mut texels = 0;
        for (i, &[width, height]) in self.pages.iter().enumerate() {
            if !(1..=MAX_PAGE_SIDE).contains(&width) || !(1..=MAX_PAGE_SIDE).contains(&height) {
                let problem = format!("is {width} x {height}; a side has 1 to {MAX_PAGE_SIDE}");
                return Err(InvalidArray::new("pages", i, problem));
            }
            texels += u64::from(width) * u64::from(height);
            if texels > MAX_TEXELS {
                let problem = format!("brings the texels to {texels}, more than {MAX_TEXELS}");
                return Err(InvalidArray::new("pages", i, problem));
            }
        }
        Ok(())
    }

    fn validate_entries(&self) -> Result<(), InvalidArray> {
        let entries = self.entry_position.len();
        length("entry_normal", self.entry_normal.len(), entries)?;
        for (i, &position) in self.entry_position.iter().enumerate() {
            if !Vec3::from(position).is_finite() {
                return Err(InvalidArray::new("entry_position", i, "is not finite"));
            }
        }
        for (i, &normal) in self.entry_normal.iter().enumerate() {
            let squared = Vec3::from(normal).length_squared();
            let unit = 1.0 - NORMAL_TOLERANCE..=1.0 + NORMAL_TOLERANCE;
            if !unit.contains(&squared) {
                return Err(InvalidArray::new("entry_normal", i, "is not a unit vector"));
            }
        }
        if self.cells() > usize::from(u16::MAX) + 1 {
            let problem = format!("there are {} cells; rows can name 65536", self.cells());
            return Err(InvalidArray::new("cell_entries", 65_537, problem));
        }
        prefix("cell_entries", &self.cell_entries, self.cells(), entries, 1)
    }

    fn validate_responses(&self) -> Result<(), InvalidArray> {
        length(
            "row_response",
            self.row_response.len(),
            self.row_cell.len().saturating_mul(ROW),
        )?;
        // Half floats from +0 to the largest finite one are the bit patterns 0 to 0x7bff.
        let sound = |v: &f16| v.to_bits() <= f16::MAX.to_bits() || *v == f16::ZERO;
        if let Some(i) = self.row_response.iter().position(|v| !sound(v)) {
            let problem = format!(
                "is {}; a response is finite and not negative",
                self.row_response[i]
            );
            return Err(InvalidArray::new("row_response", i, problem));
        }
        let lanes = self.point_texel.len() % LANES;
        if lanes != 0 {
            let first = self.block_rows[self.blocks() - 1] as usize * ROW;
            for (i, &v) in self.row_response.iter().enumerate().skip(first) {
                if i % LANES >= lanes && v != f16::ZERO {
                    let problem = "is not zero, though its lane is past the last point";
                    return Err(InvalidArray::new("row_response", i, problem));
                }
            }
        }
        Ok(())
    }

    fn validate_texels(&self) -> Result<(), InvalidArray> {
        let outside = |[page, x, y]: [u32; 3]| {
            self.pages
                .get(page as usize)
                .is_none_or(|&[w, h]| x >= w || y >= h)
        };
        let mut written = Vec::with_capacity(self.point_texel.len() + self.fill.len());
        for (i, texel) in self.point_texel.iter().enumerate() {
            let place = point_place(texel);
            if outside(place) || texel[3] > UNSOUND {
                let problem = format!("{texel:?} is not page, x, y, 0 or 1 inside a page");
                return Err(InvalidArray::new("point_texel", i, problem));
            }
            if texel[3] != UNSOUND {
                written.push((place, "point_texel", i));
            }
        }
        for (i, &[page, x, y, source]) in self.fill.iter().enumerate() {
            let sound = self
                .point_texel
                .get(source as usize)
                .is_some_and(|p| p[3] != UNSOUND);
            if outside([page, x, y]) || !sound {
                let problem = format!(
                    "{:?} is not page, x, y inside a page and a sound point below {}",
                    self.fill[i],
                    self.point_texel.len()
                );
                return Err(InvalidArray::new("fill", i, problem));
            }
            written.push(([page, x, y], "fill", i));
        }
        // A texel with two writers would have a value that depends on the order of threads.
        written.sort_unstable();
        match written.windows(2).find(|w| w[0].0 == w[1].0) {
            Some(&[_, (place, array, i)]) => Err(InvalidArray::new(
                array,
                i,
                format!("texel {place:?} is written twice"),
            )),
            _ => Ok(()),
        }
    }

    /// Validates and writes the asset to `path`, atomically.
    ///
    /// # Errors
    /// [`AssetError::Invalid`] or [`AssetError::Io`].
    pub fn write(&self, path: &Path) -> Result<Written, AssetError> {
        self.validate().map_err(|source| AssetError::Invalid {
            path: path.into(),
            source,
        })?;
        let arrays = [
            ArrayView::new("origin", &self.origin),
            ArrayView::new("pages", &self.pages),
            ArrayView::new("entry_position", &self.entry_position),
            ArrayView::new("entry_normal", &self.entry_normal),
            ArrayView::new("cell_entries", &self.cell_entries),
            ArrayView::new("point_texel", &self.point_texel),
            ArrayView::new("block_rows", &self.block_rows),
            ArrayView::new("row_cell", &self.row_cell),
            ArrayView::new("row_response", &self.row_response),
            ArrayView::new("fill", &self.fill),
        ];
        container::write(path, FORMAT, VERSION, &arrays)
    }

    /// Reads and validates the asset at `path`.
    ///
    /// # Errors
    /// [`AssetError`] names the file and the array.
    pub fn read(path: &Path) -> Result<Self, AssetError> {
        let file = Container::open(path, FORMAT, VERSION)?;
        let origin = file.array::<f64>("origin")?;
        let origin = origin.try_into().map_err(|found: Vec<f64>| {
            let problem = format!("has {} numbers instead of 3", found.len());
            AssetError::damaged(path, "array `origin`", problem)
        })?;
        let prm = Self {
            origin,
            pages: file.array("pages")?,
            entry_position: file.array("entry_position")?,
            entry_normal: file.array("entry_normal")?,
            cell_entries: file.array("cell_entries")?,
            point_texel: file.array("point_texel")?,
            block_rows: file.array("block_rows")?,
            row_cell: file.array("row_cell")?,
            row_response: file.array("row_response")?,
            fill: file.array("fill")?,
        };
        prm.validate().map_err(|source| AssetError::Invalid {
            path: path.into(),
            source,
        })?;
        Ok(prm)
    }

    /// Mean direct irradiance `Ē_c`, W/m², of each cell.
    ///
    /// `visibility` holds, light by light, a number in 0..1 for each entry point.
    ///
    /// # Errors
    /// [`EvaluateError`] for a light out of range or unsupported, and for a `visibility` of the
    /// wrong length or range.
    ///
    /// # Panics
    /// If [`Prm::validate`] would refuse `self`.
    pub fn cell_irradiance(
        &self,
        lights: &[Light],
        visibility: &[f32],
    ) -> Result<Vec<[f32; 3]>, EvaluateError> {
        let entries = self.entry_position.len();
        validate_visibility(visibility, lights.len() * entries)?;
        let lamps = lights
            .iter()
            .enumerate()
            .map(|(i, light)| Lamp::new(light, i, self.origin));
        let lamps = lamps.collect::<Result<Vec<_>, _>>()?;
        let entry_irradiance = |entry: usize| {
            let position = Vec3::from(self.entry_position[entry]);
            let normal = Vec3::from(self.entry_normal[entry]);
            let of = |(i, lamp): (usize, &Lamp)| {
                lamp.irradiance(position, normal) * visibility[i * entries + entry]
            };
            lamps.iter().enumerate().map(of).sum::<Vec3>()
        };
        let cell = |range: &[u32]| {
            let sum: Vec3 = (range[0] as usize..range[1] as usize)
                .map(entry_irradiance)
                .sum();
            (sum / (range[1] - range[0]) as f32).to_array()
        };
        Ok(self.cell_entries.windows(2).map(cell).collect())
    }

    /// Indirect irradiance, W/m², at each reference point.
    ///
    /// # Errors
    /// [`InvalidArray`] if there is not one irradiance a cell.
    ///
    /// # Panics
    /// If [`Prm::validate`] would refuse `self`.
    pub fn evaluate(&self, cell_irradiance: &[[f32; 3]]) -> Result<Vec<[f32; 3]>, InvalidArray> {
        length("cell_irradiance", cell_irradiance.len(), self.cells())?;
        let mut points = vec![[0.0; 3]; self.point_texel.len()];
        let mut response = [0.0; ROW];
        for (block, points) in points.chunks_mut(LANES).enumerate() {
            for row in self.block_rows[block] as usize..self.block_rows[block + 1] as usize {
                let irradiance = cell_irradiance[usize::from(self.row_cell[row])];
                if irradiance == [0.0; 3] {
                    continue;
                }
                self.row_response[row * ROW..][..ROW].convert_to_f32_slice(&mut response);
                for (lane, point) in points.iter_mut().enumerate() {
                    for (channel, sum) in point.iter_mut().enumerate() {
                        *sum += response[channel * LANES + lane] * irradiance[channel];
                    }
                }
            }
        }
        Ok(points)
    }

    /// Irradiance of each page, row by row, from that of the reference points, with all fills.
    /// Texels without a value are zero.
    ///
    /// # Errors
    /// [`InvalidArray`] if there is not one value a reference point.
    ///
    /// # Panics
    /// If [`Prm::validate`] would refuse `self`.
    pub fn lightmap(&self, points: &[[f32; 3]]) -> Result<Vec<Vec<[f32; 3]>>, InvalidArray> {
        length("point_values", points.len(), self.point_texel.len())?;
        let page = |&[width, height]: &[u32; 2]| vec![[0.0; 3]; width as usize * height as usize];
        let mut pages: Vec<_> = self.pages.iter().map(page).collect();
        let mut put = |[page, x, y]: [u32; 3], value| {
            let width = self.pages[page as usize][0];
            pages[page as usize][y as usize * width as usize + x as usize] = value;
        };
        for (texel, &value) in self.point_texel.iter().zip(points) {
            put(point_place(texel), value);
        }
        for &[page, x, y, source] in &self.fill {
            put([page, x, y], points[source as usize]);
        }
        Ok(pages)
    }
}

/// Page, x and y of a reference point.
fn point_place(texel: &[u16; 4]) -> [u32; 3] {
    [texel[0], texel[1], texel[2]].map(u32::from)
}

/// Checks that `visibility` has `expected` values, each in 0..1.
///
/// # Errors
/// [`InvalidArray`] for the length or the first value out of range.
pub fn validate_visibility(visibility: &[f32], expected: usize) -> Result<(), InvalidArray> {
    length("visibility", visibility.len(), expected)?;
    match visibility.iter().position(|v| !(0.0..=1.0).contains(v)) {
        Some(i) => {
            let problem = format!("is {}, outside 0 to 1", visibility[i]);
            Err(InvalidArray::new("visibility", i, problem))
        }
        None => Ok(()),
    }
}

fn length(array: &'static str, found: usize, expected: usize) -> Result<(), InvalidArray> {
    if found == expected {
        return Ok(());
    }
    let problem = format!("the array has {found} elements instead of {expected}");
    Err(InvalidArray::new(array, found.min(expected), problem))
}

/// Checks prefix sums over `count` groups, each of at least `least` elements, `total` in all.
fn prefix(
    array: &'static str,
    sums: &[u32],
    count: usize,
    total: usize,
    least: u32,
) -> Result<(), InvalidArray> {
    length(array, sums.len(), count + 1)?;
    if sums[0] != 0 {
        return Err(InvalidArray::new(
            array,
            0,
            format!("is {} instead of 0", sums[0]),
        ));
    }
    for (i, pair) in sums.windows(2).enumerate() {
        if pair[1].checked_sub(pair[0]).is_none_or(|n| n < least) {
            let problem = format!("is {} after {}; at least {least} more", pair[1], pair[0]);
            return Err(InvalidArray::new(array, i + 1, problem));
        }
    }
    if sums[count] as usize != total {
        let problem = format!("is {}, the elements are {total}", sums[count]);
        return Err(InvalidArray::new(array, count, problem));
    }
    Ok(())
}
