//! Exact overlap of a triangle with unit texel squares, in texel coordinates.

use glam::DVec2;
use std::ops::Range;

/// A convex polygon: a triangle cut by at most four lines has at most seven corners.
#[derive(Clone, Copy)]
struct Polygon {
    corners: [DVec2; 8],
    count: usize,
}

impl Polygon {
    fn push(&mut self, corner: DVec2) {
        self.corners[self.count] = corner;
        self.count += 1;
    }

    fn as_slice(&self) -> &[DVec2] {
        &self.corners[..self.count]
    }

    /// The part where `side * (p[axis] - bound) >= 0` (Sutherland and Hodgman 1974).
    fn clip(&self, axis: usize, bound: f64, side: f64) -> Self {
        let mut out = Self {
            corners: [DVec2::ZERO; 8],
            count: 0,
        };
        let points = self.as_slice();
        for (i, &b) in points.iter().enumerate() {
            let a = points[(i + points.len() - 1) % points.len()];
            let (da, db) = (side * (a[axis] - bound), side * (b[axis] - bound));
            if (da < 0.0 && db > 0.0) || (da > 0.0 && db < 0.0) {
                let mut p = a + (b - a) * (da / (da - db));
                p[axis] = bound;
                out.push(p);
            }
            if db >= 0.0 {
                out.push(b);
            }
        }
        out
    }

    /// Area (texels²) and centroid; the area is unsigned. Taken about `origin` for precision.
    fn area_centroid(&self, origin: DVec2) -> (f64, DVec2) {
        let points = self.as_slice();
        let (mut twice, mut moment) = (0.0, DVec2::ZERO);
        for (i, &b) in points.iter().enumerate() {
            let a = points[(i + points.len() - 1) % points.len()] - origin;
            let b = b - origin;
            let cross = a.perp_dot(b);
            twice += cross;
            moment += (a + b) * cross;
        }
        (0.5 * twice.abs(), origin + moment / (3.0 * twice))
    }

    fn triangle([a, b, c]: [DVec2; 3]) -> Self {
        let mut corners = [DVec2::ZERO; 8];
        corners[..3].copy_from_slice(&[a, b, c]);
        Self { corners, count: 3 }
    }

    /// The part in row `y` of texels.
    fn row(&self, y: u32) -> Self {
        self.clip(1, f64::from(y), 1.0)
            .clip(1, f64::from(y) + 1.0, -1.0)
    }

    /// The columns of row `y` whose texels lie wholly in this part of a row: those between its
    /// corners on both borders.
    fn full_columns(&self, y: u32) -> Range<u32> {
        let (mut begin, mut end) = (0.0f64, f64::INFINITY);
        for border in [f64::from(y), f64::from(y) + 1.0] {
            let (mut lo, mut hi) = (f64::INFINITY, f64::NEG_INFINITY);
            for p in self.as_slice().iter().filter(|p| p.y == border) {
                (lo, hi) = (lo.min(p.x), hi.max(p.x));
            }
            (begin, end) = (begin.max(lo), end.min(hi));
        }
        // Infinite where the part does not reach a border: an empty range.
        begin.ceil() as u32..end.max(0.0) as u32
    }

    /// Texel columns (axis 0) or rows (axis 1) that the polygon reaches.
    fn range(&self, axis: usize) -> Range<u32> {
        let (mut lo, mut hi) = (f64::INFINITY, 0.0f64);
        for p in self.as_slice() {
            (lo, hi) = (lo.min(p[axis]), hi.max(p[axis]));
        }
        lo.max(0.0) as u32..hi.ceil() as u32
    }
}

/// Calls `found(texel, area, centroid)` for every texel square that the triangle overlaps with
/// positive area (texels²); `centroid` is that of the overlap, in texels.
pub(super) fn overlaps(corners: [DVec2; 3], mut found: impl FnMut([u32; 2], f64, DVec2)) {
    let triangle = Polygon::triangle(corners);
    for y in triangle.range(1) {
        let row = triangle.row(y);
        let full = row.full_columns(y);
        for x in row.range(0) {
            let origin = DVec2::new(f64::from(x), f64::from(y));
            if full.contains(&x) {
                found([x, y], 1.0, origin + 0.5);
                continue;
            }
            let cell = row.clip(0, origin.x, 1.0).clip(0, origin.x + 1.0, -1.0);
            let (area, centroid) = cell.area_centroid(origin);
            if area > 0.0 {
                found([x, y], area, centroid.clamp(origin, origin + 1.0));
            }
        }
    }
}

/// Calls `found(texel)` for every texel whose centre lies strictly inside the triangle.
pub(super) fn centres_inside(corners: [DVec2; 3], mut found: impl FnMut([u32; 2])) {
    let triangle = Polygon::triangle(corners);
    for y in triangle.range(1) {
        for x in triangle.row(y).range(0) {
            if inside(corners, DVec2::new(f64::from(x), f64::from(y)) + 0.5) > 0.0 {
                found([x, y]);
            }
        }
    }
}

/// Twice the signed area of the triangle, texels².
pub(super) fn doubled_area([a, b, c]: [DVec2; 3]) -> f64 {
    (b - a).perp_dot(c - a)
}

/// On which side of the line `a b` the point lies; exactly antisymmetric in `a` and `b`, so that two
/// triangles never disagree about their common edge.
fn side(a: DVec2, b: DVec2, p: DVec2) -> f64 {
    if (a.x, a.y) <= (b.x, b.y) {
        (b - a).perp_dot(p - a)
    } else {
        -(a - b).perp_dot(p - b)
    }
}

/// Smallest of the three edge functions, positive inside whatever the winding: above zero the point
/// is strictly inside, at zero on the border.
pub(super) fn inside(corners: [DVec2; 3], p: DVec2) -> f64 {
    let turn = doubled_area(corners).signum();
    let [a, b, c] = corners;
    (turn * side(a, b, p))
        .min(turn * side(b, c, p))
        .min(turn * side(c, a, p))
}

/// Barycentric weights of `p`; the triangle must not be degenerate.
pub(super) fn barycentric([a, b, c]: [DVec2; 3], p: DVec2) -> [f64; 3] {
    let whole = doubled_area([a, b, c]);
    let (v, w) = (
        doubled_area([a, p, c]) / whole,
        doubled_area([a, b, p]) / whole,
    );
    [1.0 - v - w, v, w]
}
