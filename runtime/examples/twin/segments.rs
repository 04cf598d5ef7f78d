//! Which segments meet a triangle, one by one and in f64: slow, and independent of the baker.

use glam::{DVec3, Vec3};

/// Triangles that block, with their bounds.
pub struct Triangles {
    all: Vec<[DVec3; 3]>,
}

impl Triangles {
    /// The triangles of a mesh.
    pub fn new(positions: &[[f32; 3]], indices: &[u32]) -> Self {
        let corner = |i: u32| Vec3::from(positions[i as usize]).as_dvec3();
        Self {
            all: indices
                .chunks_exact(3)
                .map(|t| [corner(t[0]), corner(t[1]), corner(t[2])])
                .collect(),
        }
    }

    /// Whether anything stands between two points, both off all surfaces (Möller, Trumbore 1997).
    pub fn block(&self, from: Vec3, to: Vec3) -> bool {
        let (from, to) = (from.as_dvec3(), to.as_dvec3());
        let along = to - from;
        self.all.iter().any(|&[a, b, c]| {
            let (u, v) = (b - a, c - a);
            let across = along.cross(v);
            let volume = u.dot(across);
            if volume == 0.0 {
                return false;
            }
            let offset = from - a;
            let turned = offset.cross(u);
            let x = offset.dot(across) / volume;
            let y = along.dot(turned) / volume;
            let t = v.dot(turned) / volume;
            x >= 0.0 && y >= 0.0 && x + y <= 1.0 && t > 0.0 && t < 1.0
        })
    }
}
