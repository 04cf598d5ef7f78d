//! Solids: blocks, spheres, bodies of revolution.

use super::mesh::{Corner, Mesh};
use glam::{DMat3, DVec2, DVec3};
use std::f64::consts::TAU;

const AXES: [DVec3; 3] = [DVec3::X, DVec3::Y, DVec3::Z];

/// An axis-aligned block without the faces whose outward normals are in `hidden`.
pub fn block(mesh: &mut Mesh, min: DVec3, max: DVec3, hidden: &[DVec3]) {
    let (centre, half) = ((min + max) * 0.5, (max - min) * 0.5);
    for axis in 0..3 {
        for sign in [-1.0, 1.0] {
            let normal = AXES[axis] * sign;
            if hidden.contains(&normal) {
                continue;
            }
            let u = AXES[(axis + 1) % 3] * half;
            let v = AXES[(axis + 2) % 3] * half;
            let middle = centre + normal * half;
            let corners = [
                middle - u - v,
                middle + u - v,
                middle + u + v,
                middle - u + v,
            ];
            mesh.polygon(&corners, normal);
        }
    }
}

/// A block with chamfered edges, turned by `degrees` about the vertical.
pub fn bevelled(mesh: &mut Mesh, centre: DVec3, half: DVec3, bevel: f64, degrees: f64) {
    let turn = DMat3::from_rotation_y(degrees.to_radians());
    // The vertex of the octant `s` that lies on the face across `axis`.
    let vertex = |s: DVec3, axis: usize| {
        let mut inset = DVec3::splat(bevel);
        inset[axis] = 0.0;
        centre + turn * (s * (half - inset))
    };
    let signs = [-1.0, 1.0];
    for (axis, across) in AXES.into_iter().enumerate() {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let octant = |a: f64, b: f64, c: f64| across * a + AXES[u] * b + AXES[v] * c;
        for a in signs {
            let face = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
            let corners = face.map(|(b, c)| vertex(octant(a, b, c), axis));
            mesh.polygon(&corners, turn * (across * a));
            for b in signs {
                // The edge between the faces across `axis` and `u`.
                let ends = signs.map(|c| octant(a, b, c));
                let corners = [
                    vertex(ends[0], axis),
                    vertex(ends[1], axis),
                    vertex(ends[1], u),
                    vertex(ends[0], u),
                ];
                mesh.polygon(&corners, turn * (across * a + AXES[u] * b));
                if axis == 0 {
                    for s in ends {
                        mesh.polygon(&[0, 1, 2].map(|k| vertex(s, k)), turn * s);
                    }
                }
            }
        }
    }
}

/// A sphere of `6 * 2 n²` triangles: a cube's faces, each `n` by `n`, pushed out.
pub fn sphere(mesh: &mut Mesh, centre: DVec3, radius: f64, n: usize) {
    let at = |k: usize| (TAU / 8.0 * (2.0 * k as f64 / n as f64 - 1.0)).tan();
    for axis in 0..3 {
        for sign in [-1.0, 1.0] {
            let (u, v) = (AXES[(axis + 1) % 3], AXES[(axis + 2) % 3]);
            mesh.patch([n, n], |i, j| {
                let normal = (AXES[axis] * sign + u * at(i) + v * at(j)).normalize();
                Corner {
                    position: centre + normal * radius,
                    normal,
                    uv: DVec2::ZERO,
                }
            });
        }
    }
}

/// A body of revolution about the vertical through `foot`: each profile of (radius, height) is
/// smooth in itself, with its outside to the right of the way up.
pub fn revolve(mesh: &mut Mesh, foot: DVec3, profiles: &[&[(f64, f64)]], segments: usize) {
    for profile in profiles {
        let last = profile.len() - 1;
        mesh.patch([segments, last], |i, j| {
            let (sin, cos) = (TAU * (i % segments) as f64 / segments as f64).sin_cos();
            let around = DVec3::new(cos, 0.0, sin);
            let (radius, height) = profile[j];
            let (before, after) = (profile[j.saturating_sub(1)], profile[(j + 1).min(last)]);
            let along = DVec2::new(after.0 - before.0, after.1 - before.1);
            Corner {
                position: foot + around * radius + DVec3::Y * height,
                normal: around * along.y - DVec3::Y * along.x,
                uv: DVec2::new(i as f64 / segments as f64, height),
            }
        });
    }
}
