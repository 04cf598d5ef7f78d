//! The chamber: a hall of three by four groin-vaulted bays on two rows of columns, with an apse.
//!
//! The shell (floor, walls, vaults and the ribs between them) is one surface whose parts share
//! their vertices. It is open only where ribs come down on piers; those ends lie inside the
//! piers' abaci, and whatever else meets does so by standing some centimetres in its neighbour.

mod fittings;
mod shell;

use super::mesh::Mesh;
use super::stone;
use lightkiln::scene::Scene;

/// Bays across and along.
const BAYS: [usize; 2] = [3, 4];
/// Radius of the vaults, half a bay, metres.
const RADIUS: f64 = 1.2;
/// Width of the ribs between bays, metres.
const RIB: f64 = 0.48;
/// How far ribs stand out from the vault, metres.
const DEPTH: f64 = 0.17;
/// Height at which the arches begin, metres.
const SPRING: f64 = 2.7;
/// Straight length of the ribs below that, metres.
const STILT: f64 = 0.22;
/// How far ribs reach into the abaci, metres.
const SUNK: f64 = 0.05;
/// Straight pieces of an arch.
const PIECES: usize = 8;

/// First coordinate of bay `i` in either direction, metres.
fn bay(i: usize) -> f64 {
    i as f64 * (2.0 * RADIUS + RIB)
}

/// Last coordinate of bay `i`, metres.
fn bay_end(i: usize) -> f64 {
    bay(i) + 2.0 * RADIUS
}

/// The materials.
struct Palette {
    ashlar: u32,
    slabs: u32,
    marble: u32,
    vault: u32,
    rib: u32,
    apse: u32,
    crimson: u32,
    teal: u32,
    bronze: u32,
}

/// The scene.
pub fn build() -> Scene {
    let mut mesh = Mesh::new("chamber");
    let palette = Palette {
        ashlar: mesh.textured(stone::ashlar(), 1.6),
        slabs: mesh.textured(stone::slabs(), 1.44),
        marble: mesh.textured(stone::veined(), 1.0),
        vault: mesh.colour("vault plaster", [0.68, 0.61, 0.5]),
        rib: mesh.colour("rib stone", [0.55, 0.46, 0.34]),
        apse: mesh.colour("apse plaster", [0.3, 0.42, 0.6]),
        crimson: mesh.colour("crimson cloth", [0.58, 0.06, 0.05]),
        teal: mesh.colour("teal cloth", [0.05, 0.32, 0.33]),
        bronze: mesh.colour("bronze", [0.55, 0.36, 0.16]),
    };
    shell::build(&mut mesh, &palette);
    fittings::build(&mut mesh, &palette);
    mesh.finish()
}
