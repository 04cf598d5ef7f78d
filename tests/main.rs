//! One test binary; this file is its table of contents.

/// Closed forms: form factors, furnaces, the integrating sphere.
mod analytic;
/// The scenes in `assets/`: reproducible, closed, lit from open space.
mod assets;
/// Lightmap atlas: coverage, charts, determinism.
mod atlas;
/// The built command: plan, bake, inspect, evaluate, verify, refusals, Ctrl-C, determinism.
mod cli;
/// Closed forms with their estimates.
mod closed_forms;
/// Precomputed radiance maps.
mod prm;
/// Loading glTF and OBJ, manifests, materials, refusals.
mod scene;
/// Scenes built in memory.
mod shapes;
/// Rays: no leaks, no self-hits, masks, agreement with brute force.
mod tracing;
/// Rays that must not get lost or caught.
mod walks;
