//! Watertight ray-triangle test, four triangles at a time.
//!
//! Woop, Benthin, Wald, "Watertight Ray/Triangle Intersection", JCGT 2(1) 2013: triangles are moved
//! to the ray's origin and sheared so that the ray is the z axis; the signs of the three edge
//! functions decide. Neighbours evaluate a shared edge from the same rounded numbers, and an edge
//! function of exactly zero is evaluated again in f64, so no ray slips between them.
//! No fused operations: the same bits on every processor.

use super::{Hit, Ray};
use glam::{Vec3, Vec4};

/// Four triangles side by side; unused lanes carry NaN and are never hit.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(16))]
pub struct Block {
    /// `corners[k][axis]`: coordinate `axis` of corner `k`, one lane a triangle.
    corners: [[Vec4; 3]; 3],
    /// Triangle numbers; the highest bit marks an alpha-masked triangle.
    ids: [u32; 4],
}

/// Marks alpha-masked triangles in [`Block`] ids.
pub const MASKED: u32 = 1 << 31;

/// What the test needs of a ray: axis permutation and shear.
#[derive(Debug, Clone, Copy)]
pub struct Shear {
    axes: [usize; 3],
    shear: Vec3,
    origin: Vec3,
}

impl Shear {
    /// Precomputes the shear of a ray.
    #[inline]
    pub fn of(ray: &Ray) -> Self {
        let magnitude = ray.direction.abs();
        let z = if magnitude.x >= magnitude.y && magnitude.x >= magnitude.z {
            0
        } else if magnitude.y >= magnitude.z {
            1
        } else {
            2
        };
        let (mut x, mut y) = ((z + 1) % 3, (z + 2) % 3);
        if ray.direction[z] < 0.0 {
            (x, y) = (y, x);
        }
        let along = ray.direction[z];
        Self {
            axes: [x, y, z],
            shear: Vec3::new(
                ray.direction[x] / along,
                ray.direction[y] / along,
                1.0 / along,
            ),
            origin: ray.origin,
        }
    }
}

impl Block {
    /// A block of up to four triangles: corner positions and ids.
    pub fn new(triangles: &[([Vec3; 3], u32)]) -> Self {
        let mut block = Self {
            corners: [[Vec4::NAN; 3]; 3],
            ids: [u32::MAX; 4],
        };
        for (lane, (corners, id)) in triangles.iter().enumerate() {
            for (k, corner) in corners.iter().enumerate() {
                for axis in 0..3 {
                    block.corners[k][axis][lane] = corner[axis];
                }
            }
            block.ids[lane] = *id;
        }
        block
    }

    /// Calls `report` for every lane hit at `0 < t <= limit`, in lane order.
    #[inline]
    pub fn intersect(&self, shear: &Shear, limit: f32, mut report: impl FnMut(Hit, bool)) {
        let [kx, ky, kz] = shear.axes;
        let o = shear.origin;
        let sheared = |k: usize| {
            let z = self.corners[k][kz] - o[kz];
            let x = (self.corners[k][kx] - o[kx]) - z * shear.shear.x;
            let y = (self.corners[k][ky] - o[ky]) - z * shear.shear.y;
            (x, y, z)
        };
        let ((ax, ay, az), (bx, by, bz), (cx, cy, cz)) = (sheared(0), sheared(1), sheared(2));
        let mut u = cx * by - cy * bx;
        let mut v = ax * cy - ay * cx;
        let mut w = bx * ay - by * ax;
        let zero = Vec4::ZERO;
        let on_edge = u.cmpeq(zero) | v.cmpeq(zero) | w.cmpeq(zero);
        if on_edge.any() {
            let exact = |p: Vec4, q: Vec4, r: Vec4, s: Vec4, i: usize| {
                (f64::from(p[i]) * f64::from(q[i]) - f64::from(r[i]) * f64::from(s[i])) as f32
            };
            for i in 0..4 {
                if on_edge.test(i) {
                    u[i] = exact(cx, by, cy, bx, i);
                    v[i] = exact(ax, cy, ay, cx, i);
                    w[i] = exact(bx, ay, by, ax, i);
                }
            }
        }
        let negative = u.cmplt(zero) | v.cmplt(zero) | w.cmplt(zero);
        let positive = u.cmpgt(zero) | v.cmpgt(zero) | w.cmpgt(zero);
        let det = u + v + w;
        let inside = !(negative & positive) & (det.cmplt(zero) | det.cmpgt(zero));
        if !inside.any() {
            return;
        }
        let inv = det.recip();
        let t = (u * az + v * bz + w * cz) * shear.shear.z * inv;
        let hit = inside & t.cmpgt(zero) & t.cmple(Vec4::splat(limit));
        let mut lanes = hit.bitmask();
        while lanes != 0 {
            let i = lanes.trailing_zeros() as usize;
            lanes &= lanes - 1;
            let id = self.ids[i];
            let (u, v) = (v[i] * inv[i], w[i] * inv[i]);
            report(
                Hit {
                    t: t[i],
                    triangle: id & !MASKED,
                    u,
                    v,
                },
                id & MASKED != 0,
            );
        }
    }
}
