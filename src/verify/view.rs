//! Pictures of a lit scene from a camera: direct light by shadow rays, indirect light from the asset
//! or from the reference.

use super::poses::lamp_volumes;
use super::statistics::{baked_irradiance, reference_halves, unit_lamp};
use crate::domain::{Domain, NO_PAGE};
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::scene::View;
use crate::scene::surface::SurfacePoint;
use crate::trace::emitters::{Emitters, Receiver};
use crate::trace::{Hit, NO_TRIANGLE, Ray, Tracer, sampler};
use glam::{Vec2, Vec3};
use lightkiln_format::prm::Prm;
use rayon::prelude::*;

/// Linear RGB pixels, first row at the top.
#[derive(Debug, Clone, Default)]
pub struct Picture {
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
    /// Radiance or irradiance, row by row.
    pub pixels: Vec<Vec3>,
}

/// What a camera sees of the surfaces.
pub struct Seen {
    width: u32,
    height: u32,
    /// `None` where nothing is seen.
    pixels: Vec<Option<Sighting>>,
}

/// What one pixel sees.
struct Sighting {
    surface: SurfacePoint,
    receiver: Receiver,
    /// Lightmap page and coordinates in it, texels.
    page: u16,
    texel: Vec2,
}

/// The manifest's camera, or one found by trying: an eye among the lamp volumes, looking where most
/// of the scene is to be seen.
pub fn camera(tracer: &Tracer) -> View {
    let scene = tracer.scene();
    if let Some(view) = scene.view {
        return view;
    }
    let volumes = lamp_volumes(scene);
    let mut best = (f32::NEG_INFINITY, None);
    for volume in &volumes {
        for i in 0..8 {
            let [u, v, w, _] = sampler::sobol(i, 0, 9);
            let eye = volume.min + (volume.max - volume.min) * Vec3::new(u, v, w);
            for turn in 0..16 {
                let (sin, cos) = (std::f32::consts::TAU * turn as f32 / 16.0).sin_cos();
                let forward = Vec3::new(cos, -0.12, sin).normalize();
                let score = openness(tracer, eye, forward);
                if score > best.0 {
                    best = (score, Some((eye, forward)));
                }
            }
        }
    }
    let (eye, forward) = best.1.unwrap_or((Vec3::ZERO, Vec3::X));
    View {
        eye,
        target: eye + forward,
        vertical_fov: 60_f32.to_radians(),
    }
}

/// Mean logarithm of the distances seen in a cone of 60 degrees; back faces and misses count as
/// nothing near.
fn openness(tracer: &Tracer, eye: Vec3, forward: Vec3) -> f32 {
    let (right, up) = sampler::basis(forward);
    let rays: Vec<Ray> = (0..64)
        .map(|i| {
            let [u, v, ..] = sampler::sobol(i, 0, 4);
            let direction = forward + right * (u - 0.5) * 1.6 + up * (v - 0.5) * 1.0;
            Ray::new(eye, direction.normalize(), NO_TRIANGLE)
        })
        .collect();
    let mut hits = vec![Hit::MISS; rays.len()];
    tracer.closest(&rays, &mut hits);
    let scale = tracer.scene().bounds().diagonal();
    let worth = |(ray, hit): (&Ray, &Hit)| {
        if hit.is_hit() && tracer.facet(hit.triangle).normal.dot(ray.direction) < 0.0 {
            (hit.t / scale).max(1e-3).ln()
        } else {
            1e-3_f32.ln()
        }
    };
    rays.iter().zip(&hits).map(worth).sum::<f32>()
}

/// Pixels of a reference picture traced between two looks at whether to stop.
const REFERENCE_BATCH: usize = 4096;

/// Traces the camera's rays.
pub fn see(tracer: &Tracer, domain: &Domain, view: &View, width: u32, height: u32) -> Seen {
    let forward = (view.target - view.eye).normalize_or(Vec3::NEG_Z);
    let side = if forward.y.abs() > 0.999 {
        Vec3::Z
    } else {
        Vec3::Y
    };
    let right = forward.cross(side).normalize();
    let up = right.cross(forward);
    let half = (view.vertical_fov * 0.5).tan();
    let rays: Vec<Ray> = (0..width * height)
        .map(|i| {
            let (x, y) = (i % width, i / width);
            let sx =
                (2.0 * (x as f32 + 0.5) / width as f32 - 1.0) * half * width as f32 / height as f32;
            let sy = (1.0 - 2.0 * (y as f32 + 0.5) / height as f32) * half;
            Ray::new(
                view.eye,
                (forward + right * sx + up * sy).normalize(),
                NO_TRIANGLE,
            )
        })
        .collect();
    let mut hits = vec![Hit::MISS; rays.len()];
    tracer.closest(&rays, &mut hits);
    let pixels = rays
        .par_iter()
        .zip(&hits)
        .map(|(ray, hit)| {
            if !hit.is_hit() {
                return None;
            }
            let point = tracer.surface(ray, hit);
            let scene = tracer.scene();
            let [a, b, c] = scene.triangles[hit.triangle as usize]
                .vertices
                .map(|v| scene.normals[v as usize]);
            let smooth = a * (1.0 - hit.u - hit.v) + b * hit.u + c * hit.v;
            let smooth = if point.front { smooth } else { -smooth };
            let normal = smooth.normalize_or(point.normal);
            let normal = if normal.dot(point.normal) > 0.0 {
                normal
            } else {
                point.normal
            };
            let receiver = Receiver {
                position: point.position,
                normal,
                geometric_normal: point.normal,
                triangle: point.triangle,
            };
            let page = domain.uvs.page_of[hit.triangle as usize];
            let [a, b, c] = domain.uvs.corners[hit.triangle as usize];
            let texel = a * (1.0 - hit.u - hit.v) + b * hit.u + c * hit.v;
            Some(Sighting {
                surface: point,
                receiver,
                page,
                texel,
            })
        })
        .collect();
    Seen {
        width,
        height,
        pixels,
    }
}

impl Seen {
    /// One value a pixel; black where nothing is seen.
    fn map(&self, f: impl Fn(&Sighting) -> Vec3 + Sync) -> Picture {
        let pixels = self
            .pixels
            .par_iter()
            .map(|p| p.as_ref().map_or(Vec3::ZERO, &f))
            .collect();
        Picture {
            width: self.width,
            height: self.height,
            pixels,
        }
    }

    /// Diffuse albedo.
    pub fn albedo(&self) -> Picture {
        self.map(|seen| seen.surface.albedo)
    }

    /// Direct irradiance of a point lamp of 1 W/sr, W/m².
    ///
    /// # Errors
    /// Those of the lamp's position.
    pub fn direct(&self, tracer: &Tracer, lamp: Vec3) -> Result<Picture> {
        let emitters = Emitters::lamps(tracer.scene(), &[unit_lamp(tracer, lamp)])?;
        Ok(self.map(|seen| {
            let mut incident = Vec::new();
            emitters.incident(tracer, &seen.receiver, [0.5; 4], &mut incident);
            let mut blocked = vec![false; incident.len()];
            let rays: Vec<Ray> = incident.iter().map(|i| i.ray).collect();
            tracer.occluded(&rays, &mut blocked);
            incident
                .iter()
                .zip(blocked)
                .filter(|(_, b)| !b)
                .map(|(i, _)| i.irradiance)
                .sum()
        }))
    }

    /// Indirect irradiance of the same lamp from the asset's lightmap, bilinear, W/m².
    ///
    /// # Errors
    /// Those of the asset's evaluation.
    pub fn baked(&self, tracer: &Tracer, prm: &Prm, lamp: Vec3) -> Result<Picture> {
        let values = baked_irradiance(tracer, prm, lamp)?;
        let pages = prm
            .lightmap(&values)
            .map_err(|e| Error::input("asset".as_ref(), "prm", e.to_string(), "bake it again"))?;
        Ok(self.map(|&Sighting { page, texel, .. }| {
            if page == NO_PAGE {
                return Vec3::ZERO;
            }
            let [width, height] = prm.pages[page as usize].map(|s| s as i32);
            let at = texel - 0.5;
            let base = at.floor();
            let f = at - base;
            let fetch = |dx: i32, dy: i32| {
                let x = (base.x as i32 + dx).clamp(0, width - 1);
                let y = (base.y as i32 + dy).clamp(0, height - 1);
                Vec3::from(pages[page as usize][(y * width + x) as usize])
            };
            let top = fetch(0, 0).lerp(fetch(1, 0), f.x);
            top.lerp(fetch(0, 1).lerp(fetch(1, 1), f.x), f.y)
        }))
    }

    /// Indirect irradiance of the same lamp by the path tracer, `paths` a pixel, W/m².
    ///
    /// # Errors
    /// [`Error::Interrupted`].
    pub fn reference(
        &self,
        tracer: &Tracer,
        lamp: Vec3,
        paths: u32,
        progress: &Progress,
    ) -> Result<Picture> {
        let receivers: Vec<Receiver> = self.pixels.iter().flatten().map(|p| p.receiver).collect();
        let lamp = unit_lamp(tracer, lamp);
        let batches = receivers.chunks(REFERENCE_BATCH);
        let scene = &tracer.scene().name;
        progress.stage(scene, "drawing the reference", batches.len() as u64);
        let mut values = Vec::with_capacity(receivers.len());
        for (number, batch) in batches.enumerate() {
            progress.check()?;
            let [a, b] = reference_halves(tracer, &lamp, batch, paths, number as u32)?;
            values.extend(a.iter().zip(&b).map(|(a, b)| ((*a + *b) * 0.5).as_vec3()));
            progress.step(1);
        }
        let mut values = values.into_iter();
        let pixels = self
            .pixels
            .iter()
            .map(|p| {
                if p.is_some() {
                    values.next().unwrap_or_default()
                } else {
                    Vec3::ZERO
                }
            })
            .collect();
        Ok(Picture {
            width: self.width,
            height: self.height,
            pixels,
        })
    }
}

impl Picture {
    /// Pixel by pixel from two pictures of one size.
    pub fn zip(&self, other: &Self, f: impl Fn(Vec3, Vec3) -> Vec3) -> Self {
        let pixels = self
            .pixels
            .iter()
            .zip(&other.pixels)
            .map(|(a, b)| f(*a, *b))
            .collect();
        Self { pixels, ..*self }
    }

    /// Half the size: means of 2 x 2 pixels.
    pub fn halved(&self) -> Self {
        let (width, height) = (self.width / 2, self.height / 2);
        let at = |x: u32, y: u32| self.pixels[(y * self.width + x) as usize];
        let pixels = (0..width * height)
            .map(|i| {
                let (x, y) = (2 * (i % width), 2 * (i / width));
                (at(x, y) + at(x + 1, y) + at(x, y + 1) + at(x + 1, y + 1)) * 0.25
            })
            .collect();
        Self {
            width,
            height,
            pixels,
        }
    }

    /// Exposure that brings the 95th percentile of the brightest channel to 0.8.
    pub fn exposure(&self) -> f32 {
        let mut values: Vec<f32> = self
            .pixels
            .iter()
            .map(|p| p.max_element())
            .filter(|v| *v > 0.0)
            .collect();
        values.sort_by(f32::total_cmp);
        values.get(values.len() * 95 / 100).map_or(1.0, |v| 0.8 / v)
    }

    /// PNG of the picture times `exposure`: linear to 0.8, then rolled off towards 1; sRGB-encoded.
    ///
    /// # Errors
    /// Those of the encoder, as text.
    pub fn to_png(&self, exposure: f32) -> std::result::Result<Vec<u8>, String> {
        let shoulder = |x: f32| {
            if x <= 0.8 {
                x
            } else {
                0.8 + 0.2 * (1.0 - (-(x - 0.8) / 0.2).exp())
            }
        };
        let encode = |x: f32| {
            let x = shoulder(x * exposure);
            let s = if x <= 0.003_130_8 {
                12.92 * x
            } else {
                1.055 * x.powf(1.0 / 2.4) - 0.055
            };
            (s.clamp(0.0, 1.0) * 255.0 + 0.5) as u8
        };
        self.encode_png(|p| p.to_array().map(encode))
    }

    /// PNG of signed values in false colour: blue below zero, white at zero, red above; saturated at
    /// `limit`.
    ///
    /// # Errors
    /// Those of the encoder, as text.
    pub fn to_signed_png(&self, limit: f32) -> std::result::Result<Vec<u8>, String> {
        self.encode_png(|p| {
            let x = (p.element_sum() / 3.0 / limit).clamp(-1.0, 1.0);
            let fade = ((1.0 - x.abs()) * 255.0 + 0.5) as u8;
            if x >= 0.0 {
                [255, fade, fade]
            } else {
                [fade, fade, 255]
            }
        })
    }

    fn encode_png(&self, f: impl Fn(Vec3) -> [u8; 3]) -> std::result::Result<Vec<u8>, String> {
        let bytes: Vec<u8> = self.pixels.iter().flat_map(|p| f(*p)).collect();
        let mut png = std::io::Cursor::new(Vec::new());
        image::RgbImage::from_raw(self.width, self.height, bytes)
            .ok_or("picture has the wrong number of pixels")?
            .write_to(&mut png, image::ImageFormat::Png)
            .map_err(|e| e.to_string())?;
        Ok(png.into_inner())
    }
}
