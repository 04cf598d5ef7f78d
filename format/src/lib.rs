//! What Lightkiln's baked bytes and coefficients mean.
//!
//! The baker writes these assets, the runtime and the tools read them. Nothing here traces a ray or
//! touches a GPU; every `evaluate` here is the CPU twin of a WGSL shader in `lightkiln-runtime`.

pub mod container;
pub mod direct;
pub mod error;
pub mod index;
pub mod lighting;
pub mod prm;
