//! The box: a closed room with two coloured walls, two bevelled blocks and two spheres.

use super::mesh::Mesh;
use super::solids::{bevelled, sphere};
use glam::{DVec3, dvec3};
use lightkiln::scene::Scene;

/// Inner size, metres; the room stands on `y = 0`, centred in `x`, its back wall at `z = 0`.
const SIZE: DVec3 = dvec3(2.6, 2.0, 3.6);

/// The scene.
pub fn build() -> Scene {
    let mut mesh = Mesh::new("box");
    let white = mesh.colour("white", [0.74, 0.73, 0.7]);
    let red = mesh.colour("red", [0.64, 0.11, 0.07]);
    let green = mesh.colour("green", [0.12, 0.42, 0.16]);
    let ochre = mesh.colour("ochre", [0.68, 0.5, 0.24]);
    let blue = mesh.colour("blue", [0.2, 0.31, 0.58]);

    let at = |x: f64, y: f64, z: f64| dvec3((x - 0.5) * SIZE.x, y * SIZE.y, z * SIZE.z);
    // Corners in the order of a polygon over the two directions that vary.
    let walls = [
        (
            "floor",
            white,
            DVec3::Y,
            [(0, 0, 0), (1, 0, 0), (1, 0, 1), (0, 0, 1)],
        ),
        (
            "ceiling",
            white,
            -DVec3::Y,
            [(0, 1, 0), (1, 1, 0), (1, 1, 1), (0, 1, 1)],
        ),
        (
            "back",
            white,
            DVec3::Z,
            [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)],
        ),
        (
            "front",
            white,
            -DVec3::Z,
            [(0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)],
        ),
        (
            "left",
            red,
            DVec3::X,
            [(0, 0, 0), (0, 0, 1), (0, 1, 1), (0, 1, 0)],
        ),
        (
            "right",
            green,
            -DVec3::X,
            [(1, 0, 0), (1, 0, 1), (1, 1, 1), (1, 1, 0)],
        ),
    ];
    for (name, material, normal, corners) in walls {
        mesh.node(name, material);
        let corners = corners.map(|(x, y, z)| at(f64::from(x), f64::from(y), f64::from(z)));
        mesh.polygon(&corners, normal);
    }
    // Everything that stands is sunk by 2 mm, so that nothing touches along a line.
    let sink = 0.002;
    mesh.node("tall block", white);
    let half = dvec3(0.3, 0.58, 0.28);
    bevelled(
        &mut mesh,
        dvec3(-0.5, half.y - sink, 0.85),
        half,
        0.02,
        20.0,
    );
    mesh.node("low block", white);
    let half = dvec3(0.3, 0.26, 0.3);
    bevelled(
        &mut mesh,
        dvec3(0.52, half.y - sink, 1.2),
        half,
        0.02,
        -16.0,
    );
    mesh.node("ochre sphere", ochre);
    let top = 2.0 * half.y - sink;
    sphere(&mut mesh, dvec3(0.52, top + 0.24 - sink, 1.2), 0.24, 8);
    mesh.node("blue sphere", blue);
    sphere(&mut mesh, dvec3(-0.1, 0.17 - sink, 1.5), 0.17, 8);
    mesh.finish()
}
