//! Lights as the runtime and the tools receive them: the lighting file.
//!
//! Units: positions in metres (world space), radiant intensity in W/sr, irradiance in W/m²,
//! radiance in W/(m² sr), each as linear RGB.

use glam::{DVec3, Vec3};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// One light that may change at run time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase", deny_unknown_fields)]
pub enum Light {
    /// Isotropic point light.
    Point {
        /// Position in metres, world space.
        position: DVec3,
        /// Radiant intensity, W/sr, linear RGB.
        intensity: Vec3,
        /// Radius of the lamp in metres: `1/d²` is bounded by `1/radius²` (dossier 5.8).
        #[serde(default)]
        radius: f32,
    },
    /// Spot light with the smooth cone of `KHR_lights_punctual`.
    Spot {
        /// Position in metres, world space.
        position: DVec3,
        /// Unit direction in which the spot shines.
        direction: Vec3,
        /// Radiant intensity on the axis, W/sr, linear RGB.
        intensity: Vec3,
        /// Half angle of full intensity, radians.
        #[serde(default)]
        inner_cone: f32,
        /// Half angle at which the intensity reaches zero, radians.
        outer_cone: f32,
        /// Radius of the lamp in metres.
        #[serde(default)]
        radius: f32,
    },
    /// Light from infinity.
    Directional {
        /// Unit direction in which the light travels.
        direction: Vec3,
        /// Irradiance on a surface facing the light, W/m², linear RGB.
        irradiance: Vec3,
    },
    /// One-sided rectangle of constant radiance.
    Rectangle {
        /// Centre in metres, world space.
        position: DVec3,
        /// Half of the first edge, metres.
        half_u: Vec3,
        /// Half of the second edge, metres; the rectangle shines along `half_u × half_v`.
        half_v: Vec3,
        /// Radiance, W/(m² sr), linear RGB.
        radiance: Vec3,
    },
}

/// Light from infinity in all directions.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Environment {
    /// Equirectangular HDR image; its `+Y` is up. Relative to the lighting file.
    #[serde(default)]
    pub path: Option<PathBuf>,
    /// Constant radiance where there is no image, W/(m² sr), linear RGB.
    #[serde(default)]
    pub radiance: Vec3,
    /// Rotation about `+Y`, degrees.
    #[serde(default)]
    pub rotation_deg: f32,
    /// Factor on the image's radiance.
    #[serde(default = "one")]
    pub scale: f32,
}

fn one() -> f32 {
    1.0
}

/// A lighting file: what `evaluate`, `verify` and the examples read.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Lighting {
    /// The lights, in file order.
    #[serde(default, rename = "light")]
    pub lights: Vec<Light>,
    /// The sky, if any.
    #[serde(default)]
    pub environment: Option<Environment>,
}

/// Why a lighting file was refused.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LightingError {
    /// The file could not be read.
    #[error("{path}: cannot be read: {source}")]
    Io {
        /// File.
        path: PathBuf,
        /// Cause.
        source: std::io::Error,
    },
    /// The TOML is malformed or has an unknown key.
    #[error("{path}: {message}")]
    Toml {
        /// File.
        path: PathBuf,
        /// Message of the TOML reader, with line and key.
        message: String,
    },
    /// A value is out of range.
    #[error("light {index}: `{field}` {problem}")]
    Value {
        /// Zero-based number of the light.
        index: usize,
        /// Field.
        field: &'static str,
        /// What is wrong and what to write instead.
        problem: String,
    },
}

impl Lighting {
    /// Reads and validates a lighting file.
    ///
    /// # Errors
    /// [`LightingError`] names the file, the light and the field.
    pub fn read(path: &Path) -> Result<Self, LightingError> {
        let text = std::fs::read_to_string(path).map_err(|source| LightingError::Io {
            path: path.into(),
            source,
        })?;
        let lighting: Self = toml::from_str(&text).map_err(|e| LightingError::Toml {
            path: path.into(),
            message: e.to_string(),
        })?;
        lighting.validate()?;
        Ok(lighting)
    }

    /// Checks that every value is finite and in range.
    ///
    /// # Errors
    /// [`LightingError::Value`] for the first offending field.
    pub fn validate(&self) -> Result<(), LightingError> {
        for (index, light) in self.lights.iter().enumerate() {
            light.validate(index)?;
        }
        Ok(())
    }
}

impl Light {
    fn validate(&self, index: usize) -> Result<(), LightingError> {
        let bad = |field, problem: &str| {
            Err(LightingError::Value {
                index,
                field,
                problem: problem.into(),
            })
        };
        let power_ok = |v: Vec3| v.is_finite() && v.min_element() >= 0.0;
        let unit = |v: Vec3| v.is_finite() && v.length_squared() > 0.0;
        match *self {
            Self::Point {
                position,
                intensity,
                radius,
            } => {
                if !position.is_finite() {
                    return bad("position", "is not finite; give three numbers in metres");
                }
                if !power_ok(intensity) {
                    return bad("intensity", "must be finite and not negative (W/sr)");
                }
                if !(radius.is_finite() && radius >= 0.0) {
                    return bad("radius", "must be finite and not negative (metres)");
                }
            }
            Self::Spot {
                position,
                direction,
                intensity,
                inner_cone,
                outer_cone,
                radius,
            } => {
                if !position.is_finite() {
                    return bad("position", "is not finite; give three numbers in metres");
                }
                if !unit(direction) {
                    return bad("direction", "must be a finite, non-zero vector");
                }
                if !power_ok(intensity) {
                    return bad("intensity", "must be finite and not negative (W/sr)");
                }
                if !(0.0 <= inner_cone && inner_cone < outer_cone && outer_cone <= 3.2) {
                    return bad(
                        "outer_cone",
                        "needs 0 <= inner_cone < outer_cone <= pi (radians)",
                    );
                }
                if !(radius.is_finite() && radius >= 0.0) {
                    return bad("radius", "must be finite and not negative (metres)");
                }
            }
            Self::Directional {
                direction,
                irradiance,
            } => {
                if !unit(direction) {
                    return bad("direction", "must be a finite, non-zero vector");
                }
                if !power_ok(irradiance) {
                    return bad("irradiance", "must be finite and not negative (W/m²)");
                }
            }
            Self::Rectangle {
                position,
                half_u,
                half_v,
                radiance,
            } => {
                if !position.is_finite() {
                    return bad("position", "is not finite; give three numbers in metres");
                }
                if !unit(half_u.cross(half_v)) {
                    return bad(
                        "half_v",
                        "must not be parallel to half_u, and both not zero",
                    );
                }
                if !power_ok(radiance) {
                    return bad("radiance", "must be finite and not negative (W/(m² sr))");
                }
            }
        }
        Ok(())
    }
}
