//! One test binary; this file is its table of contents.

/// Lightmap atlas: coverage, charts, determinism.
mod atlas;
/// Loading glTF and OBJ, manifests, materials, refusals.
mod scene;
