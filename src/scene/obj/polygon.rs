//! Polygons to triangles.

use glam::DVec3;

/// Largest concave polygon that is cut with care: the search for ears is of third order.
const MAX_CONCAVE: usize = 256;

/// Triangles (corner numbers) of a polygon, `n - 2` of them, turning as the polygon does.
///
/// Convex polygons become a fan of their first corner. Concave ones are cut by ears; beyond
/// [`MAX_CONCAVE`] corners they become a fan too.
pub(super) fn triangulate(points: &[DVec3]) -> Vec<[usize; 3]> {
    let mut left: Vec<usize> = (0..points.len()).collect();
    let normal = newell(points);
    let turn = |a: usize, b: usize, c: usize| {
        (points[b] - points[a])
            .cross(points[c] - points[b])
            .dot(normal)
    };
    let n = points.len();
    let convex = (0..n).all(|i| turn(i, (i + 1) % n, (i + 2) % n) >= 0.0);
    let mut triangles = Vec::with_capacity(n.saturating_sub(2));
    while left.len() > 3 && !convex && n <= MAX_CONCAVE {
        let m = left.len();
        let corners = |i: usize| [left[(i + m - 1) % m], left[i], left[(i + 1) % m]];
        let ear = (0..m).find(|&i| {
            let [a, b, c] = corners(i);
            let inside =
                |p: usize| turn(a, b, p) >= 0.0 && turn(b, c, p) >= 0.0 && turn(c, a, p) >= 0.0;
            let other = |p: usize| ![a, b, c].iter().any(|&q| points[p] == points[q]);
            turn(a, b, c) > 0.0 && !left.iter().any(|&p| other(p) && inside(p))
        });
        // A polygon that crosses itself may have no ear: what is left becomes a fan.
        let Some(ear) = ear else { break };
        triangles.push(corners(ear));
        left.remove(ear);
    }
    let fan = left.windows(2).skip(1).map(|w| [left[0], w[0], w[1]]);
    triangles.extend(fan);
    triangles
}

/// Normal of a polygon that need not be flat; its length is twice the area.
fn newell(points: &[DVec3]) -> DVec3 {
    let origin = points.first().copied().unwrap_or_default();
    let next = points.iter().skip(1).chain(points.first());
    points
        .iter()
        .zip(next)
        .map(|(&a, &b)| (a - origin).cross(b - origin))
        .sum()
}
