//! Sky.
use glam::{Vec2, Vec3};
/// Sky.
pub struct Environment;
/// Sample.
pub struct SkySample {
    /// d
    pub direction: Vec3,
    /// r
    pub radiance: Vec3,
    /// p
    pub pdf: f32,
}
impl Environment {
    /// s
    pub fn sample(&self, _u: Vec2) -> SkySample {
        SkySample {
            direction: Vec3::Y,
            radiance: Vec3::ONE,
            pdf: 1.0,
        }
    }
    /// r
    pub fn radiance(&self, _d: Vec3) -> Vec3 {
        Vec3::ONE
    }
    /// p
    pub fn pdf(&self, _d: Vec3) -> f32 {
        1.0
    }
}
