//! Direct irradiance of a lamp at a point: the light weight of Szécsi et al. 2006, section 5.2.
//!
//! A [`Lamp`] is a [`Light`] made ready for evaluation: local coordinates, f32, constants folded.
//! Its bytes are what the runtime uploads, and [`Lamp::irradiance`] is the CPU twin of `irradiance`
//! in `runtime/shaders/shared/lamp.wgsl`, operation by operation.
//!
//! Deviation from the paper: its weight `cos cos / (d² + A/π)` drops the lamp's area factor; here
//! the lamp is given by its radiant intensity, and `1/d²` is bounded by the lamp's radius.

use crate::lighting::{Light, LightingError};
use bytemuck::{Pod, Zeroable};
use glam::{DVec3, Vec3};

/// Least lamp radius, metres. `1/d²` of a smaller one would leave little of the range of an f32 for
/// the sums that follow; no lamp is smaller.
pub const MIN_LAMP_RADIUS: f32 = 1e-6;

/// Least difference of the cosines of a spot's half angles, from the reference code in the
/// `KHR_lights_punctual` specification; it keeps a hard cone finite.
const MIN_CONE_COSINES: f64 = 1e-3;

/// [`Lamp::kind`] of a point lamp.
pub const POINT: u32 = 0;
/// [`Lamp::kind`] of a spot.
pub const SPOT: u32 = 1;
/// [`Lamp::kind`] of light from infinity.
pub const DIRECTIONAL: u32 = 2;

/// A light in local coordinates, laid out for the shaders (64 bytes).
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Lamp {
    /// Position, metres, relative to the asset's origin; zero for directional light.
    pub position: [f32; 3],
    /// [`POINT`], [`SPOT`] or [`DIRECTIONAL`].
    pub kind: u32,
    /// Unit direction in which the light travels; zero for point lamps.
    pub direction: [f32; 3],
    /// Square of the lamp's radius, m².
    pub radius_squared: f32,
    /// Radiant intensity, W/sr; irradiance, W/m², for directional light.
    pub power: [f32; 3],
    /// `KHR_lights_punctual`'s `lightAngleScale`.
    pub cone_scale: f32,
    /// `KHR_lights_punctual`'s `lightAngleOffset`.
    pub cone_offset: f32,
    /// Zero.
    pub padding: [f32; 3],
}

impl Lamp {
    /// Resolves light number `index` relative to `origin` (metres, world space).
    ///
    /// # Errors
    /// [`LightingError::Value`] for values out of range, a lamp too strong for f32, and rectangles,
    /// which are not supported yet.
    pub fn new(light: &Light, index: usize, origin: [f64; 3]) -> Result<Self, LightingError> {
        light.validate(index)?;
        let bad = |field, problem: &str| {
            Err(LightingError::Value {
                index,
                field,
                problem: problem.into(),
            })
        };
        let local = |position: DVec3| (position - DVec3::from(origin)).as_vec3();
        let unit = |direction: Vec3| direction.as_dvec3().normalize().as_vec3();
        let mut lamp = Self {
            cone_offset: 1.0,
            ..Self::zeroed()
        };
        match *light {
            Light::Point {
                position,
                intensity,
                radius,
            } => {
                lamp.kind = POINT;
                lamp.position = local(position).into();
                lamp.power = intensity.into();
                lamp.radius_squared = radius.max(MIN_LAMP_RADIUS).powi(2);
            }
            Light::Spot {
                position,
                direction,
                intensity,
                inner_cone,
                outer_cone,
                radius,
            } => {
                let (inner, outer) = (f64::from(inner_cone).cos(), f64::from(outer_cone).cos());
                let scale = 1.0 / (inner - outer).max(MIN_CONE_COSINES);
                lamp.kind = SPOT;
                lamp.position = local(position).into();
                lamp.direction = unit(direction).into();
                lamp.power = intensity.into();
                lamp.cone_scale = scale as f32;
                lamp.cone_offset = (-outer * scale) as f32;
                lamp.radius_squared = radius.max(MIN_LAMP_RADIUS).powi(2);
            }
            Light::Directional {
                direction,
                irradiance,
            } => {
                lamp.kind = DIRECTIONAL;
                lamp.direction = unit(direction).into();
                lamp.power = irradiance.into();
                lamp.radius_squared = 1.0;
            }
            Light::Rectangle { .. } => {
                return bad(
                    "kind",
                    "`rectangle` is not supported here; use point or spot lamps",
                );
            }
        }
        if !Vec3::from(lamp.position).is_finite() {
            return bad("position", "is too far from the asset for f32");
        }
        let peak = Vec3::from(lamp.power).max_element() / lamp.radius_squared;
        if !(lamp.radius_squared.is_finite() && peak.is_finite()) {
            return bad(
                "intensity",
                "over the square of the radius leaves the range of f32",
            );
        }
        Ok(lamp)
    }

    /// Whether rays to this lamp end at [`Lamp::position`]: true for point lamps and spots.
    pub fn is_local(&self) -> bool {
        self.kind != DIRECTIONAL
    }

    /// Unoccluded irradiance, W/m², at `position` (local, metres) on a surface of unit `normal`:
    /// `I cos θ / max(d², r²)`, times the cone's falloff for spots; `E cos θ` from infinity.
    pub fn irradiance(&self, position: Vec3, normal: Vec3) -> Vec3 {
        if self.kind == DIRECTIONAL {
            return Vec3::from(self.power) * normal.dot(-Vec3::from(self.direction)).max(0.0);
        }
        let to_lamp = Vec3::from(self.position) - position;
        let squared = to_lamp.dot(to_lamp);
        if squared == 0.0 {
            return Vec3::ZERO;
        }
        let to_lamp = to_lamp / squared.sqrt();
        let mut factor = normal.dot(to_lamp).max(0.0) / squared.max(self.radius_squared);
        if self.kind == SPOT {
            let cosine = Vec3::from(self.direction).dot(-to_lamp);
            let falloff = (cosine * self.cone_scale + self.cone_offset).clamp(0.0, 1.0);
            factor *= falloff * falloff;
        }
        Vec3::from(self.power) * factor
    }
}
