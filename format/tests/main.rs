//! Tests of the formats.
//!
//! - `prm`: rules, round trip and arithmetic of precomputed radiance maps
//! - `hostile`: damaged containers
//! - `direct`: lamps against closed forms
//! - `index`: `index.json`, its schema and its determinism
//! - `random`: the random assets the others use

mod direct;
mod hostile;
mod index;
mod prm;
mod random;
