//! Leaks and self-hits at any scale and distance from the origin (dossier 6.1).

use crate::Figure;
use crate::files::{Offset, through_gltf};
use crate::walks::{self, OFFSETS, SCALES, ball, closed_room};
use lightkiln::scene::Scene;

/// Scales beside those of the tests, so that no factor of 40 is left out.
const MORE_SCALES: [f64; 2] = [0.03, 1e3];

/// Rays a scale, spread over its rooms.
const LEAK_RAYS: u64 = 10_000_000;

/// Hits walked of each path.
const BOUNCES: u32 = 20;

/// Rays of each convex mesh.
const SELF_HIT_RAYS: u32 = 1_000_000;

fn scales() -> Vec<f64> {
    let mut scales: Vec<f64> = SCALES.iter().chain(&MORE_SCALES).copied().collect();
    scales.sort_by(f64::total_cmp);
    scales
}

/// The room as built, and as loaded from glTF with its offset in the node and in the vertices.
fn rooms(scale: f64, offset: f64) -> [Scene; 3] {
    let room = closed_room(scale, offset);
    let [node, vertices] = [Offset::Node, Offset::Vertices].map(|o| through_gltf(&room, o));
    [room, node, vertices]
}

/// Rays that leave a closed room.
pub fn leaks() -> Figure {
    let rooms_a_scale = OFFSETS.len() as u64 * 3;
    let paths = LEAK_RAYS.div_ceil(rooms_a_scale * u64::from(BOUNCES)) as u32;
    let (mut lost, mut traced, mut leaking) = (0, 0, Vec::new());
    for scale in scales() {
        for offset in OFFSETS {
            let kinds = ["memory", "node translation", "f32 vertices"];
            for (room, kind) in rooms(scale, offset).iter().zip(kinds) {
                let (escapes, rays) = walks::escapes(room, paths, BOUNCES);
                lost += escapes;
                traced += rays;
                if escapes > 0 {
                    leaking.push(format!("{kind}, {scale} m, {offset} sizes away: {escapes}"));
                }
            }
        }
    }
    Figure {
        asked: format!(
            "0 escapes of 10^7 rays a scale in closed rooms; scales {:?} m, offsets {OFFSETS:?} \
             room sizes; in memory, as a glTF node's translation, in f32 vertices",
            scales()
        ),
        measured: format!("{lost} of {traced} rays"),
        met: lost == 0 && traced >= LEAK_RAYS * scales().len() as u64,
        notes: leaking.join("; "),
    }
}

/// Rays from a convex mesh that meet it again.
pub fn self_hits() -> Figure {
    let (mut struck, mut meshes, mut failing) = (0, 0, Vec::new());
    for scale in scales() {
        for offset in OFFSETS {
            let built = ball(scale, offset);
            let loaded = through_gltf(&built, Offset::Node);
            for (mesh, kind) in [built, loaded].iter().zip(["memory", "node translation"]) {
                let hits = walks::self_hits(mesh, SELF_HIT_RAYS);
                struck += hits;
                meshes += 1;
                if hits > 0 {
                    failing.push(format!("{kind}, {scale} m, {offset} sizes away: {hits}"));
                }
            }
        }
    }
    Figure {
        asked: "0 self-hits of 10^6 cosine rays from a convex mesh at each of the same scales \
                and offsets"
            .into(),
        measured: format!("{struck} of {meshes} x {SELF_HIT_RAYS} rays"),
        met: struck == 0,
        notes: failing.join("; "),
    }
}
