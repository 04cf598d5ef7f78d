//! Lightkiln precomputes light transport of static scenes for real-time lighting.
//!
//! Data moves to the right only: manifest and scene, domain, plan, gather, bake, assets.

pub mod domain;
pub mod error;
pub mod gather;
pub mod manifest;
pub mod scene;
pub mod trace;
