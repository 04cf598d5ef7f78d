//! What encloses the chamber: floor, walls with recesses, vaults, ribs.

use super::super::mesh::{Corner, Mesh};
use super::{BAYS, DEPTH, PIECES, Palette, RADIUS, RIB, SPRING, STILT, bay, bay_end};
use glam::{DVec2, DVec3, dvec3};
use std::f64::consts::PI;

/// Depth of the apse and of the recesses in the side walls, metres.
pub const APSE: f64 = 1.5;
const RECESS: f64 = 0.45;

/// A place on an arch of some radius over a span of `2 RADIUS`: how far along the span, how high
/// above the springing, and the cosine and sine of the angle it is seen at from the centre.
#[derive(Clone, Copy)]
struct Place {
    along: f64,
    up: f64,
    cos: f64,
    sin: f64,
}

/// Place `k` of `0..=PIECES` of an arch.
fn place(radius: f64, k: usize) -> Place {
    let (sin, cos) = (PI * k as f64 / PIECES as f64).sin_cos();
    Place {
        along: RADIUS - radius * cos,
        up: radius * sin,
        cos,
        sin,
    }
}

/// Place `k` of `0..=PIECES + 2` of an arch with its stilts.
fn stilted(radius: f64, k: usize) -> Place {
    let foot = k == 0 || k == PIECES + 2;
    let on_arch = place(radius, k.saturating_sub(1).min(PIECES));
    Place {
        up: if foot { -STILT } else { on_arch.up },
        ..on_arch
    }
}

/// One side of a bay: where it begins, the direction along it and the one into the bay.
#[derive(Clone, Copy)]
struct Side {
    start: DVec3,
    along: DVec3,
    inward: DVec3,
}

impl Side {
    /// A point `into` metres into the bay, heights above the springing.
    fn at(&self, along: f64, up: f64, into: f64) -> DVec3 {
        self.start + self.along * along + self.inward * into + DVec3::Y * (SPRING + up)
    }

    /// A place on an arch and the normal there of a surface that runs straight into the bay.
    fn arch(&self, p: Place, into: f64, uv: DVec2) -> Corner {
        Corner {
            position: self.at(p.along, p.up, into),
            normal: self.along * p.cos - DVec3::Y * p.sin,
            uv,
        }
    }
}

/// The sides of bay (`i`, `j`): towards low z, high z, low x, high x.
fn sides(i: usize, j: usize) -> [Side; 4] {
    let (x, z) = (bay(i), bay(j));
    let side = |start, along, inward| Side {
        start,
        along,
        inward,
    };
    [
        side(dvec3(x, 0.0, z), DVec3::X, DVec3::Z),
        side(dvec3(x, 0.0, bay_end(j)), DVec3::X, -DVec3::Z),
        side(dvec3(x, 0.0, z), DVec3::Z, DVec3::X),
        side(dvec3(bay_end(i), 0.0, z), DVec3::Z, -DVec3::X),
    ]
}

/// Depth of the recess in the wall on side `s` of bay (`i`, `j`); `None` where there is no wall.
fn wall(i: usize, j: usize, s: usize) -> Option<f64> {
    match s {
        0 if j == 0 => Some(if i == 1 { APSE } else { 0.0 }),
        1 if j == BAYS[1] - 1 => Some(0.0),
        2 if i == 0 => Some(if j % 2 == 1 { RECESS } else { 0.0 }),
        3 if i == BAYS[0] - 1 => Some(if j % 2 == 1 { RECESS } else { 0.0 }),
        _ => None,
    }
}

pub fn build(mesh: &mut Mesh, palette: &Palette) {
    mesh.node("floor", palette.slabs);
    floor(mesh);
    let bays = || (0..BAYS[1]).flat_map(|j| (0..BAYS[0]).map(move |i| (i, j)));
    mesh.node("vaults", palette.vault);
    for (i, j) in bays() {
        for side in sides(i, j) {
            vault(mesh, side);
        }
    }
    mesh.node("ribs", palette.rib);
    for (i, j) in bays() {
        let [_, high_z, _, high_x] = sides(i, j);
        if i + 1 < BAYS[0] {
            rib(mesh, high_x);
        }
        if j + 1 < BAYS[1] {
            rib(mesh, high_z);
        }
    }
    mesh.node("walls", palette.ashlar);
    for (i, j) in bays() {
        for (s, side) in sides(i, j).into_iter().enumerate() {
            match wall(i, j, s) {
                Some(depth) if depth < APSE => panel(mesh, side, depth),
                _ => (),
            }
            // The strip behind the pier between this bay and the next along the wall.
            let next = if s < 2 {
                i + 1 < BAYS[0]
            } else {
                j + 1 < BAYS[1]
            };
            if wall(i, j, s).is_some() && next {
                let [from, to] = [2.0 * RADIUS, 2.0 * RADIUS + RIB];
                let strip = [(from, 0), (to, 0), (to, 1), (from, 1)];
                let top = |level| if level == 1 { -STILT } else { -SPRING };
                let corners = strip.map(|(along, level)| side.at(along, top(level), 0.0));
                mesh.polygon(&corners, side.inward);
            }
        }
    }
    mesh.node("apse", palette.apse);
    panel(mesh, sides(1, 0)[0], APSE);
}

/// A grid whose lines are the borders of the bays.
fn floor(mesh: &mut Mesh) {
    let lines = |n: usize| -> Vec<f64> { (0..n).flat_map(|i| [bay(i), bay_end(i)]).collect() };
    for x in lines(BAYS[0]).windows(2) {
        for z in lines(BAYS[1]).windows(2) {
            let corners = [(0, 0), (1, 0), (1, 1), (0, 1)];
            let corners = corners.map(|(i, k): (usize, usize)| dvec3(x[i], 0.0, z[k]));
            mesh.polygon(&corners, DVec3::Y);
        }
    }
}

/// The quarter of a groin vault that rests on one side: straight lines into the bay, from an arch
/// over the side to the diagonals.
fn vault(mesh: &mut Mesh, side: Side) {
    mesh.patch([PIECES, 1], |k, inner| {
        let p = place(RADIUS, k);
        let into = if inner == 1 {
            p.along.min(2.0 * RADIUS - p.along)
        } else {
            0.0
        };
        side.arch(p, into, DVec2::ZERO)
    });
}

/// The rib that leaves a bay over one of its sides: two faces and the soffit between them.
fn rib(mesh: &mut Mesh, side: Side) {
    for (into, normal) in [(0.0, side.inward), (-RIB, -side.inward)] {
        mesh.patch([PIECES + 2, 1], |k, outer| {
            let p = stilted(RADIUS - if outer == 1 { 0.0 } else { DEPTH }, k);
            Corner {
                position: side.at(p.along, p.up, into),
                normal,
                uv: DVec2::ZERO,
            }
        });
    }
    mesh.patch([PIECES + 2, 1], |k, far| {
        let into = -RIB * far as f64;
        side.arch(stilted(RADIUS - DEPTH, k), into, DVec2::ZERO)
    });
}

/// A wall below an arch, set back by `depth` behind jambs and a barrel of the same outline.
fn panel(mesh: &mut Mesh, side: Side, depth: f64) {
    let at = |along, up| side.at(along, up, -depth);
    let (left, right) = (0.0, 2.0 * RADIUS);
    let middle = at(RADIUS, 0.0);
    let feet = [at(left, -STILT), at(right, -STILT)];
    let base = [at(left, -SPRING), at(right, -SPRING), feet[1], feet[0]];
    mesh.polygon(&base, side.inward);
    let mut outline = vec![middle];
    outline.extend((0..=PIECES + 2).map(|k| {
        let p = stilted(RADIUS, k);
        at(p.along, p.up)
    }));
    mesh.polygon(&outline, side.inward);
    mesh.polygon(&[middle, feet[1], feet[0]], side.inward);
    if depth == 0.0 {
        return;
    }
    mesh.patch([PIECES + 4, 1], |k, far| {
        let foot = k == 0 || k == PIECES + 4;
        let p = stilted(RADIUS, k.saturating_sub(1).min(PIECES + 2));
        let p = Place {
            up: if foot { -SPRING } else { p.up },
            ..p
        };
        let length = if p.up > 0.0 {
            p.up + (p.along - RADIUS).abs() * 0.5
        } else {
            p.up
        };
        side.arch(
            p,
            -depth * far as f64,
            DVec2::new(depth * far as f64, -length),
        )
    });
    let sill = [(left, 0.0), (right, 0.0), (right, depth), (left, depth)];
    let sill = sill.map(|(along, out)| side.at(along, -SPRING, -out));
    mesh.polygon(&sill, DVec3::Y);
}
