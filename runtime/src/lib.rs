//! Lights a scene with Lightkiln's assets in real time, on wgpu.
//!
//! ```text
//! asset + lights + visibility → cell irradiance → irradiance lightmap → any host shader
//! ```
//!
//! Every shader has a CPU twin in `lightkiln-format` and is tested against it. Coordinates are
//! local: metres relative to the asset's origin.

pub mod device;
pub mod error;
pub mod prm;
pub mod shadow_cube;
