//! What stands and hangs in the chamber: columns, wall piers, steps, an urn, curtains.

use super::super::mesh::{Corner, Mesh};
use super::super::solids::{block, revolve};
use super::shell::APSE;
use super::{BAYS, DEPTH, Palette, RADIUS, RIB, SPRING, STILT, SUNK, bay, bay_end};
use glam::{DVec2, DVec3, dvec3};
use std::f64::consts::TAU;

/// Sides of a column.
const SEGMENTS: usize = 12;
/// Underside and upper side of the abaci, metres.
const ABACUS: [f64; 2] = [SPRING - STILT - 0.12, SPRING - STILT + SUNK];
/// Half the width of a free pier's abacus: it covers the cross of the ribs that meet on it.
const ABACUS_HALF: f64 = RIB / 2.0 + DEPTH + 0.03;
/// How far things stand in what they join, metres.
const JOIN: f64 = 0.02;

pub fn build(mesh: &mut Mesh, palette: &Palette) {
    mesh.node("columns", palette.marble);
    for j in 1..BAYS[1] {
        for i in 1..BAYS[0] {
            column(mesh, dvec3(bay(i) - RIB / 2.0, 0.0, bay(j) - RIB / 2.0));
        }
    }
    mesh.node("wall piers", palette.rib);
    let far = [bay_end(BAYS[0] - 1), bay_end(BAYS[1] - 1)];
    for i in 1..BAYS[0] {
        let x = bay(i) - RIB / 2.0;
        wall_pier(mesh, dvec3(x, 0.0, 0.0), DVec3::Z);
        wall_pier(mesh, dvec3(x, 0.0, far[1]), -DVec3::Z);
    }
    for j in 1..BAYS[1] {
        let z = bay(j) - RIB / 2.0;
        wall_pier(mesh, dvec3(0.0, 0.0, z), DVec3::X);
        wall_pier(mesh, dvec3(far[0], 0.0, z), -DVec3::X);
    }
    mesh.node("steps", palette.marble);
    let (left, right) = (bay(1), bay_end(1));
    let low = dvec3(left - JOIN, -JOIN, -APSE - JOIN);
    block(
        mesh,
        low,
        dvec3(right + JOIN, 0.22, 0.62),
        &[-DVec3::Y, -DVec3::Z],
    );
    let low = dvec3(left + 0.08, -JOIN, 0.6);
    block(
        mesh,
        low,
        dvec3(right - 0.08, 0.11, 0.98),
        &[-DVec3::Y, -DVec3::Z],
    );

    mesh.node("pedestal", palette.marble);
    let foot = dvec3(left + RADIUS, 0.22, -0.62);
    let half = dvec3(0.26, 0.0, 0.26);
    block(
        mesh,
        foot - half - DVec3::Y * JOIN,
        foot + half + DVec3::Y * 0.75,
        &[-DVec3::Y],
    );
    mesh.node("urn", palette.bronze);
    urn(mesh, foot + DVec3::Y * (0.75 - JOIN));

    mesh.node("crimson curtain", palette.crimson);
    curtain(mesh, 0.16, [bay(1) + 0.1, bay(1) + 1.5]);
    mesh.node("teal curtain", palette.teal);
    curtain(mesh, far[0] - 0.16, [bay(1) + 0.1, bay(1) + 1.5]);
}

fn column(mesh: &mut Mesh, foot: DVec3) {
    let half = dvec3(0.33, 0.0, 0.33);
    block(
        mesh,
        foot - half - DVec3::Y * JOIN,
        foot + half + DVec3::Y * 0.16,
        &[-DVec3::Y],
    );
    let under = ABACUS[0] + JOIN;
    let base = [(0.31, 0.14), (0.315, 0.22), (0.225, 0.32)];
    let shaft = [(0.225, 0.32), (0.2, under - 0.3)];
    let capital = [(0.2, under - 0.3), (0.37, under)];
    revolve(mesh, foot, &[&base, &shaft, &capital], SEGMENTS);
    let half = dvec3(ABACUS_HALF, 0.0, ABACUS_HALF);
    let [low, high] = ABACUS.map(|y| DVec3::Y * y);
    block(mesh, foot + low - half, foot + high + half, &[]);
}

/// A pilaster with base and abacus in front of a wall whose normal is `out`.
fn wall_pier(mesh: &mut Mesh, foot: DVec3, out: DVec3) {
    let along = DVec3::Y.cross(out).abs();
    let mut part = |half: f64, depth: f64, [low, high]: [f64; 2], hidden: &[DVec3]| {
        let [a, b] = [
            foot - along * half - out * JOIN + DVec3::Y * low,
            foot + along * half + out * depth + DVec3::Y * high,
        ];
        block(mesh, a.min(b), a.max(b), hidden);
    };
    let shaft = DEPTH + 0.02;
    part(
        RIB / 2.0 - 0.03,
        shaft,
        [0.1, ABACUS[0] + JOIN],
        &[-DVec3::Y, DVec3::Y, -out],
    );
    part(RIB / 2.0 + 0.03, shaft + 0.06, [-JOIN, 0.3], &[-DVec3::Y]);
    part(RIB / 2.0 + 0.04, shaft + 0.05, ABACUS, &[]);
}

fn urn(mesh: &mut Mesh, foot: DVec3) {
    let stem = [(0.13, 0.0), (0.12, 0.05), (0.05, 0.12)];
    let body = [
        (0.05, 0.12),
        (0.2, 0.26),
        (0.23, 0.42),
        (0.12, 0.58),
        (0.1, 0.64),
    ];
    let lip = [(0.1, 0.64), (0.15, 0.68)];
    let lid = [(0.15, 0.68), (0.0, 0.7)];
    revolve(mesh, foot, &[&stem, &body, &lip, &lid], SEGMENTS + 2);
}

/// A curtain in folds, hung on a beam along z at `x`; the beam runs into the piers' abaci.
fn curtain(mesh: &mut Mesh, x: f64, [from, to]: [f64; 2]) {
    const FOLDS: usize = 4;
    const PIECES: usize = 4 * FOLDS;
    const BOTTOM: f64 = 0.06;
    let top = ABACUS[0] + 0.05;
    let half = 0.012;
    // Sine and derivative at quarter turns: the folds are zigzags with smooth normals.
    let place = |k: usize, up: f64, side: f64| {
        let phase = TAU * k as f64 / 4.0;
        // Folds are deeper at the hem.
        let amplitude = 0.045 + 0.035 * (1.0 - up);
        let length = (to - from) / PIECES as f64;
        let slope = amplitude * TAU / 4.0 / length * phase.cos();
        let normal = dvec3(1.0, 0.0, -slope).normalize() * side;
        let y = BOTTOM + (top - BOTTOM) * up;
        let middle = dvec3(x + amplitude * phase.sin(), y, from + length * k as f64);
        Corner {
            position: middle + DVec3::X * (half * side),
            normal,
            uv: DVec2::ZERO,
        }
    };
    for side in [-1.0, 1.0] {
        mesh.patch([PIECES, 1], |k, j| place(k, j as f64, side));
    }
    let edges = [(0, -DVec3::Z), (PIECES, DVec3::Z)];
    for (k, normal) in edges {
        let corners = [(0.0, -1.0), (0.0, 1.0), (1.0, 1.0), (1.0, -1.0)];
        mesh.polygon(
            &corners.map(|(up, side)| place(k, up, side).position),
            normal,
        );
    }
    mesh.patch([PIECES, 1], |k, j| Corner {
        normal: -DVec3::Y,
        ..place(k, 0.0, 2.0 * j as f64 - 1.0)
    });
    let low = dvec3(x - 0.06, top - 0.05, bay(1) - 0.1);
    block(
        mesh,
        low,
        dvec3(x + 0.06, top + 0.04, bay_end(1) + 0.1),
        &[],
    );
}
