//! Radiance to pictures: exposure, sRGB, false colour, PNG.
//!
//! Tone mapping is exposure alone: radiance times one factor, clipped at white, sRGB curve. Both
//! pictures share the factor, so that their difference is light and nothing else.

use image::{Rgb, RgbImage};
use std::path::Path;

/// Linear radiance, row by row from the top.
#[derive(Debug)]
pub struct Radiance {
    /// Width, pixels.
    pub width: u32,
    /// `width × height` pixels.
    pub pixels: Vec<[f32; 3]>,
}

impl Radiance {
    /// Averages squares of `factor × factor` pixels.
    pub fn shrink(&self, factor: usize) -> Self {
        let wide = self.width as usize;
        let (width, height) = (wide / factor, self.pixels.len() / wide / factor);
        let pixel = |i: usize| {
            let (x, y) = (i % width * factor, i / width * factor);
            let mut sum = [0.0; 3];
            for k in 0..factor * factor {
                let source = self.pixels[(y + k / factor) * wide + x + k % factor];
                (0..3).for_each(|c| sum[c] += source[c]);
            }
            sum.map(|v| v / (factor * factor) as f32)
        };
        Self {
            width: width as u32,
            pixels: (0..width * height).map(pixel).collect(),
        }
    }

    /// The sum of two.
    pub fn plus(&self, other: &Self) -> Self {
        let add = |(a, b): (&[f32; 3], &[f32; 3])| [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
        Self {
            width: self.width,
            pixels: self.pixels.iter().zip(&other.pixels).map(add).collect(),
        }
    }

    /// Mean of the three channels over all pixels.
    pub fn mean(&self) -> f64 {
        let sum: f64 = self.pixels.iter().flatten().map(|&v| f64::from(v)).sum();
        sum / (3 * self.pixels.len()) as f64
    }

    /// Luminance below which `share` of the pixels lie (ITU-R BT.709 weights).
    pub fn quantile(&self, share: f32) -> f32 {
        let mut values: Vec<_> = self.pixels.iter().map(luminance).collect();
        values.sort_unstable_by(f32::total_cmp);
        values[((values.len() - 1) as f32 * share) as usize]
    }

    /// Exposed and clipped.
    pub fn exposed(&self, exposure: f32) -> RgbImage {
        self.picture(|pixel| pixel.map(|v| encode(v * exposure)))
    }

    /// Luminance in false colour, black to white at `scale`.
    pub fn false_colour(&self, scale: f32) -> RgbImage {
        self.picture(|pixel| heat((luminance(pixel) / scale).clamp(0.0, 1.0)))
    }

    fn picture(&self, colour: impl Fn(&[f32; 3]) -> [u8; 3]) -> RgbImage {
        let height = self.pixels.len() as u32 / self.width;
        RgbImage::from_fn(self.width, height, |x, y| {
            Rgb(colour(&self.pixels[(y * self.width + x) as usize]))
        })
    }
}

/// Writes the pictures side by side.
///
/// # Errors
/// A message with the file.
pub fn write_sheet(path: &Path, pictures: &[RgbImage]) -> Result<(), String> {
    const GAP: u32 = 8;
    let width = pictures
        .iter()
        .map(|p| p.width() + GAP)
        .sum::<u32>()
        .saturating_sub(GAP);
    let height = pictures.iter().map(RgbImage::height).max().unwrap_or(0);
    let mut sheet = RgbImage::from_pixel(width, height, Rgb([255; 3]));
    let mut x = 0;
    for picture in pictures {
        image::imageops::replace(&mut sheet, picture, i64::from(x), 0);
        x += picture.width() + GAP;
    }
    write(path, &sheet)
}

/// Writes one picture.
///
/// # Errors
/// A message with the file.
pub fn write(path: &Path, picture: &RgbImage) -> Result<(), String> {
    picture
        .save(path)
        .map_err(|e| format!("{}: {e}", path.display()))
}

fn luminance(pixel: &[f32; 3]) -> f32 {
    0.2126 * pixel[0] + 0.7152 * pixel[1] + 0.0722 * pixel[2]
}

/// IEC 61966-2-1.
fn encode(linear: f32) -> u8 {
    let linear = linear.clamp(0.0, 1.0);
    let curved = if linear <= 0.003_130_8 {
        12.92 * linear
    } else {
        1.055 * linear.powf(1.0 / 2.4) - 0.055
    };
    (curved * 255.0).round() as u8
}

/// Black, violet, red, orange, yellow, white.
fn heat(t: f32) -> [u8; 3] {
    const STOPS: [[f32; 3]; 6] = [
        [0.0, 0.0, 0.0],
        [70.0, 15.0, 110.0],
        [190.0, 40.0, 75.0],
        [245.0, 125.0, 20.0],
        [250.0, 220.0, 80.0],
        [255.0, 255.0, 255.0],
    ];
    let place = t * (STOPS.len() - 1) as f32;
    let low = (place as usize).min(STOPS.len() - 2);
    let part = place - low as f32;
    [0, 1, 2].map(|c| (STOPS[low][c] * (1.0 - part) + STOPS[low + 1][c] * part).round() as u8)
}
