//! Tests of the runtime, on a real device; lavapipe will do.
//!
//! - `prm`: the shaders against their CPU twin at equal visibility
//! - `shadow_cube`: visibility by depth cubes against analytic occlusion
//! - `headless`: the example (its `picture`, `scene` and `texture` too) renders a small room
//! - `room`: that room, with its map and its glTF
//! - `gpu`: opening the device, reading buffers back
//! - `random`: random maps and lamps, shared with the format's tests

mod gpu;
mod headless;
#[path = "../examples/headless/picture.rs"]
mod picture;
mod prm;
#[path = "../../format/tests/random.rs"]
mod random;
mod room;
#[path = "../examples/headless/scene.rs"]
mod scene;
mod shadow_cube;
#[path = "../examples/headless/texture.rs"]
mod texture;
