//! The scenes: a box of coloured walls and a vaulted chamber.

mod chamber;
mod mesh;
mod room;
mod solids;
mod stone;

use lightkiln::scene::Scene;

/// All scenes, each under the name of its folder in `assets/`.
pub fn all() -> [Scene; 2] {
    [room::build(), chamber::build()]
}
