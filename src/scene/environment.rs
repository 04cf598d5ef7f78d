//! Light from infinity: an equirectangular image or a constant, and a way to sample it.
//!
//! Convention: `+Y` is up. Row 0 looks at `+Y`, the last row at `-Y`. With `theta` the angle from
//! `+Y` and `phi = atan2(z, x)`, `u = 0.5 + phi / 2π` and `v = theta / π`: the image's centre looks
//! along `+X` and its right-hand half towards `+Z`.
//! Look-ups take the nearest texel, so that radiance is constant over each texel and the density of
//! [`Environment::sample`] is exact: proportional to luminance times solid angle, texel by texel.

use crate::error::{Error, Result};
use crate::scene::resource::read_file;
use glam::{Vec2, Vec3};
use image::{ImageDecoder, ImageReader, Limits};
use std::f64::consts::PI;
use std::io::Cursor;
use std::path::Path;

/// Most texels an environment may have: 16384 x 8192.
pub const MAX_ENVIRONMENT_TEXELS: u64 = 1 << 27;

/// Luminance of linear sRGB.
const LUMINANCE: Vec3 = Vec3::new(0.2126, 0.7152, 0.0722);

/// Radiance from all directions.
#[derive(Debug, Clone)]
pub struct Environment {
    /// Width in texels.
    pub width: u32,
    /// Height in texels.
    pub height: u32,
    /// `width * height` radiances, linear RGB, W/(m² sr), finite and not negative; first row up.
    pub radiance: Vec<Vec3>,
    /// Texels that were negative, infinite or not a number, and are zero now.
    pub repaired: u64,
    /// Cumulative probability of the rows, `height + 1` values from 0 to 1.
    rows: Vec<f64>,
    /// Cumulative probability within each row, `width + 1` values from 0 to 1 a row.
    columns: Vec<f64>,
}

impl Environment {
    /// Loads a `.hdr` (Radiance) or `.exr` (OpenEXR, channels R, G and B of the first layer) image.
    ///
    /// # Errors
    /// [`Error::Io`] or [`Error::Input`]: unreadable, malformed or larger than
    /// [`MAX_ENVIRONMENT_TEXELS`].
    pub fn load(file: &Path) -> Result<Self> {
        let bytes = read_file(file)?;
        let extension = file
            .extension()
            .unwrap_or_default()
            .to_string_lossy()
            .to_lowercase();
        let read = match extension.as_str() {
            "hdr" => read_hdr(&bytes),
            "exr" => read_exr(&bytes),
            _ => Err(format!(
                "`.{extension}` is not a format of environments that is read"
            )),
        };
        let (width, height, radiance) = read.map_err(|problem| {
            let remedy = "give an equirectangular .hdr or .exr image";
            Error::input(file, "environment", problem, remedy)
        })?;
        Ok(Self::new(width, height, radiance))
    }

    /// The same radiance (linear RGB, W/(m² sr)) from everywhere.
    pub fn constant(radiance: Vec3) -> Self {
        Self::new(1, 1, vec![radiance])
    }

    /// An environment of `width * height` texels, first row up; missing texels are black.
    fn new(width: u32, height: u32, mut radiance: Vec<Vec3>) -> Self {
        radiance.resize(width as usize * height as usize, Vec3::ZERO);
        let mut repaired = 0;
        for texel in &mut radiance {
            if !(texel.is_finite() && texel.min_element() >= 0.0) {
                *texel = Vec3::ZERO;
                repaired += 1;
            }
        }
        let mut columns = Vec::with_capacity((width as usize + 1) * height as usize);
        let mut weights = Vec::with_capacity(height as usize);
        for (y, row) in radiance.chunks_exact(width as usize).enumerate() {
            let luminance = row.iter().map(|t| f64::from(t.dot(LUMINANCE)));
            let sum = push_cumulative(&mut columns, luminance);
            weights.push(sum * row_height(y, height));
        }
        let mut rows = Vec::with_capacity(height as usize + 1);
        push_cumulative(&mut rows, weights.into_iter());
        Self {
            width,
            height,
            radiance,
            repaired,
            rows,
            columns,
        }
    }

    /// Radiance from a unit direction (pointing away from the receiver), W/(m² sr).
    pub fn lookup(&self, direction: Vec3) -> Vec3 {
        self.radiance[self.texel(direction).2]
    }

    /// A direction drawn from `u` in `[0, 1)²`, its radiance, and its density in solid angle (1/sr).
    /// A black environment is sampled uniformly.
    pub fn sample(&self, u: Vec2) -> (Vec3, Vec3, f32) {
        let (y, fy) = invert(&self.rows, f64::from(u.y));
        let (x, fx) = invert(self.row(y), f64::from(u.x));
        // Within a texel the density is constant in solid angle: linear in cos theta, not in theta.
        let cos = lerp(cosine(y, self.height), cosine(y + 1, self.height), fy);
        let sin = (1.0 - cos * cos).max(0.0).sqrt();
        let phi = ((x as f64 + fx) / f64::from(self.width) - 0.5) * 2.0 * PI;
        let direction = Vec3::new(
            (sin * phi.cos()) as f32,
            cos as f32,
            (sin * phi.sin()) as f32,
        );
        let index = y * self.width as usize + x;
        (direction, self.radiance[index], self.density(x, y) as f32)
    }

    /// Density with which [`Environment::sample`] draws a unit direction, 1/sr.
    pub fn pdf(&self, direction: Vec3) -> f32 {
        let (x, y, _) = self.texel(direction);
        self.density(x, y) as f32
    }

    fn row(&self, y: usize) -> &[f64] {
        let stride = self.width as usize + 1;
        &self.columns[y * stride..(y + 1) * stride]
    }

    fn density(&self, x: usize, y: usize) -> f64 {
        let row = self.row(y);
        let probability = (self.rows[y + 1] - self.rows[y]) * (row[x + 1] - row[x]);
        let solid_angle = row_height(y, self.height) * 2.0 * PI / f64::from(self.width);
        probability / solid_angle
    }

    /// Column, row and index of the texel a direction falls into.
    fn texel(&self, direction: Vec3) -> (usize, usize, usize) {
        let d = direction.as_dvec3();
        let u = 0.5 + d.z.atan2(d.x) / (2.0 * PI);
        let v = d.x.hypot(d.z).atan2(d.y) / PI;
        let cell = |t: f64, n: u32| ((t * f64::from(n)) as usize).min(n as usize - 1);
        let (x, y) = (cell(u, self.width), cell(v, self.height));
        (x, y, y * self.width as usize + x)
    }
}

/// Cosine of the angle from `+Y` at the upper edge of row `y`.
fn cosine(y: usize, height: u32) -> f64 {
    (PI * y as f64 / f64::from(height)).cos()
}

/// Solid angle of a row over 2π.
fn row_height(y: usize, height: u32) -> f64 {
    cosine(y, height) - cosine(y + 1, height)
}

fn lerp(a: f64, b: f64, t: f64) -> f64 {
    a + (b - a) * t
}

/// Appends the running sums of `weights`, from 0 to 1; evenly spaced if all are zero. Returns the
/// total.
fn push_cumulative(into: &mut Vec<f64>, weights: impl Iterator<Item = f64>) -> f64 {
    let start = into.len();
    into.push(0.0);
    let mut sum = 0.0;
    for weight in weights {
        sum += weight;
        into.push(sum);
    }
    let count = (into.len() - start - 1) as f64;
    for (i, value) in into[start..].iter_mut().enumerate() {
        *value = if sum > 0.0 {
            *value / sum
        } else {
            i as f64 / count
        };
    }
    sum
}

/// Cell of a cumulative distribution that holds `u`, and the place within it, in `[0, 1)`.
fn invert(cumulative: &[f64], u: f64) -> (usize, f64) {
    let last = cumulative.len() - 2;
    let mut cell = cumulative
        .partition_point(|&c| c <= u)
        .saturating_sub(1)
        .min(last);
    // `u = 1` may land behind the last cell of any weight.
    while cell > 0 && cumulative[cell + 1] <= cumulative[cell] {
        cell -= 1;
    }
    let width = cumulative[cell + 1] - cumulative[cell];
    let place = if width > 0.0 {
        (u - cumulative[cell]) / width
    } else {
        0.0
    };
    (cell, place.clamp(0.0, 1.0 - f64::EPSILON))
}

type Pixels = (u32, u32, Vec<Vec3>);

fn check_size(width: u64, height: u64) -> std::result::Result<(), String> {
    let good = width > 0
        && height > 0
        && width
            .checked_mul(height)
            .is_some_and(|n| n <= MAX_ENVIRONMENT_TEXELS);
    if good {
        Ok(())
    } else {
        Err(format!("{width} x {height} texels are not read"))
    }
}

fn read_hdr(bytes: &[u8]) -> std::result::Result<Pixels, String> {
    let mut reader = ImageReader::with_format(Cursor::new(bytes), image::ImageFormat::Hdr);
    let mut limits = Limits::default();
    limits.max_alloc = Some(32 * MAX_ENVIRONMENT_TEXELS);
    reader.limits(limits);
    let decoder = reader.into_decoder().map_err(|e| e.to_string())?;
    let (width, height) = decoder.dimensions();
    check_size(width.into(), height.into())?;
    // A scan line takes four bytes at least, however well it is packed.
    if u64::from(height) * 4 > bytes.len() as u64 {
        return Err(format!(
            "{height} rows do not fit into {} bytes",
            bytes.len()
        ));
    }
    let image = image::DynamicImage::from_decoder(decoder)
        .map_err(|e| e.to_string())?
        .into_rgb32f();
    Ok((
        width,
        height,
        image.pixels().map(|p| Vec3::from(p.0)).collect(),
    ))
}

fn read_exr(bytes: &[u8]) -> std::result::Result<Pixels, String> {
    use exr::prelude::*;
    let meta =
        MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(|e| e.to_string())?;
    let Some(header) = meta.headers.first() else {
        return Err("has no layer".into());
    };
    check_size(header.layer_size.x() as u64, header.layer_size.y() as u64)?;
    let image = read()
        .no_deep_data()
        .largest_resolution_level()
        .rgb_channels(
            |size, _| (size.x(), vec![Vec3::ZERO; size.area()]),
            |(width, pixels): &mut (usize, Vec<Vec3>), at, (r, g, b): (f32, f32, f32)| {
                pixels[at.y() * *width + at.x()] = Vec3::new(r, g, b);
            },
        )
        .first_valid_layer()
        .all_attributes()
        .from_buffered(Cursor::new(bytes))
        .map_err(|e| e.to_string())?;
    let size = image.layer_data.size;
    check_size(size.x() as u64, size.y() as u64)?;
    Ok((
        size.x() as u32,
        size.y() as u32,
        image.layer_data.channel_data.pixels.1,
    ))
}
