//! One thin recipe a technique: sinks for the gather, then the format. And what all share: writing
//! the asset, its pictures and the index.

pub mod atlas_image;
pub mod prm;
