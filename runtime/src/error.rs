//! Why the runtime refused.

use lightkiln_format::error::InvalidArray;
use lightkiln_format::lighting::LightingError;

/// Any failure of the runtime.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RuntimeError {
    /// An asset, or an array given by the host, breaks a rule.
    #[error(transparent)]
    Array(#[from] InvalidArray),
    /// A light is out of range or of an unsupported kind.
    #[error(transparent)]
    Lighting(#[from] LightingError),
    /// The device cannot hold the data.
    #[error("{what} need {needed}, the device's limit `{limit_name}` is {limit}")]
    TooLarge {
        /// What does not fit.
        what: &'static str,
        /// Bytes, texels or layers needed.
        needed: u64,
        /// Name of the limit, as in `wgpu::Limits`.
        limit_name: &'static str,
        /// Its value.
        limit: u64,
    },
    /// The device runs on OpenGL, whose shaders cannot load a texel of a depth texture.
    #[error("OpenGL is not supported; open the device on Vulkan, Metal or Direct3D 12")]
    OpenGl,
    /// A light has neither a depth cube nor visibility from the host.
    #[error("light {light} has no visibility: render depth cubes, or call `set_visibility`")]
    VisibilityMissing {
        /// Zero-based number of the light.
        light: usize,
    },
    /// There is no light of that number.
    #[error("there is no light {light}; {count} are set")]
    NoSuchLight {
        /// Number asked for.
        light: usize,
        /// Number of lights.
        count: usize,
    },
    /// No graphics adapter, or none that gives a device.
    #[error(
        "no usable graphics adapter ({0}); install a Vulkan driver, such as Debian's \
             mesa-vulkan-drivers, whose lavapipe runs without a GPU"
    )]
    NoAdapter(String),
}
