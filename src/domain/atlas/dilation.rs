//! Which point each texel without a point of its own is copied from.

use crate::domain::{LightmapUvs, ReferencePoint};
use rayon::prelude::*;
use std::cmp::Reverse;
use std::collections::{BinaryHeap, HashMap};

/// [`Fill::source`] of a covered texel whose whole chart has no valid point.
pub const NO_SOURCE: u32 = u32::MAX;

/// A texel that takes the value of a point elsewhere.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Fill {
    /// Lightmap page.
    pub page: u16,
    /// Texel column and row in the page.
    pub texel: [u16; 2],
    /// Index of the point to copy, always valid, or [`NO_SOURCE`].
    pub source: u32,
}

/// No point here.
const FREE: u32 = u32::MAX;

/// Fills for texels without valid point, by page, row and column.
///
/// An invalid point's texel takes the valid point of its chart that is nearest along the surface,
/// however far ([`NO_SOURCE`] if its chart has none). A texel that no chart covers takes the value of
/// the nearest covered texel, if one lies within `reach` texels in each direction (the lowest point
/// of equally near ones). `points` are those of [`reference_points`](super::reference_points), in
/// its order; `valid` has one entry a point.
///
/// # Panics
/// If `valid` and `points` differ in length.
pub fn dilation(
    uvs: &LightmapUvs,
    points: &[ReferencePoint],
    valid: &[bool],
    reach: u32,
) -> Vec<Fill> {
    assert_eq!(points.len(), valid.len(), "one validity a point");
    let sources = sources(points, valid);
    let mut by_page: Vec<Vec<u32>> = vec![Vec::new(); uvs.pages.len()];
    for (i, point) in points.iter().enumerate() {
        by_page[point.page as usize].push(i as u32);
    }
    let offsets = offsets(i64::from(reach));
    let mut fills = Vec::new();
    for (page, inside) in by_page.iter().enumerate() {
        let [width, height] = uvs.pages[page].map(|s| s as usize);
        let mut owner = vec![FREE; width * height];
        for &i in inside {
            let [x, y] = points[i as usize].texel.map(usize::from);
            owner[y * width + x] = i;
        }
        let resolved = |x: i64, y: i64| {
            let within = (0..width as i64).contains(&x) && (0..height as i64).contains(&y);
            let i = if within {
                owner[y as usize * width + x as usize]
            } else {
                FREE
            };
            (i != FREE && sources[i as usize] != NO_SOURCE).then_some(i)
        };
        let row = |y: usize| -> Vec<Fill> {
            let fill = |x: usize| {
                let own = owner[y * width + x];
                let source = if own != FREE {
                    (!valid[own as usize]).then(|| sources[own as usize])
                } else {
                    offsets.iter().find_map(|ring| {
                        let near = |&[dx, dy]: &[i64; 2]| resolved(x as i64 + dx, y as i64 + dy);
                        ring.iter()
                            .filter_map(near)
                            .min()
                            .map(|i| sources[i as usize])
                    })
                };
                source.map(|source| Fill {
                    page: page as u16,
                    texel: [x as u16, y as u16],
                    source,
                })
            };
            (0..width).filter_map(fill).collect()
        };
        let rows: Vec<Vec<Fill>> = (0..height).into_par_iter().map(row).collect();
        fills.extend(rows.into_iter().flatten());
    }
    fills
}

/// Offsets to at most `reach` in each direction, grouped by distance, nearest first.
fn offsets(reach: i64) -> Vec<Vec<[i64; 2]>> {
    let mut all: Vec<[i64; 2]> = (-reach..=reach)
        .flat_map(|y| (-reach..=reach).map(move |x| [x, y]))
        .collect();
    let squared = |o: &[i64; 2]| o[0] * o[0] + o[1] * o[1];
    all.retain(|o| squared(o) > 0);
    all.sort_by_key(squared);
    all.chunk_by(|a, b| squared(a) == squared(b))
        .map(<[_]>::to_vec)
        .collect()
}

/// For each point the valid point nearest along its chart's surface: itself if valid.
fn sources(points: &[ReferencePoint], valid: &[bool]) -> Vec<u32> {
    let mut sources: Vec<u32> = (0..points.len())
        .map(|i| if valid[i] { i as u32 } else { NO_SOURCE })
        .collect();
    let mut begin = 0;
    for chart in points.chunk_by(|a, b| a.chart == b.chart) {
        let range = begin..begin + chart.len();
        begin = range.end;
        let good = valid[range.clone()].iter().filter(|&&v| v).count();
        if good > 0 && good < chart.len() {
            spread(chart, range.start as u32, &mut sources[range]);
        }
    }
    sources
}

/// Shortest paths (Dijkstra 1959) from all valid points over neighbouring texels of one chart, whose
/// lengths are the distances of their points. `base` is the number of the chart's first point.
fn spread(chart: &[ReferencePoint], base: u32, sources: &mut [u32]) {
    let at: HashMap<[u16; 2], u32> = chart
        .iter()
        .enumerate()
        .map(|(i, p)| (p.texel, i as u32))
        .collect();
    let distance = |a: u32, b: u32| {
        let (p, q) = (chart[a as usize].position, chart[b as usize].position);
        p.as_dvec3().distance(q.as_dvec3())
    };
    // Non-negative floats order as their bits.
    let mut heap: BinaryHeap<Reverse<(u64, u32, u32)>> = BinaryHeap::new();
    let mut settled: Vec<bool> = sources.iter().map(|&s| s != NO_SOURCE).collect();
    let visit =
        |heap: &mut BinaryHeap<_>, settled: &[bool], from: u32, length: f64, source: u32| {
            let [x, y] = chart[from as usize].texel.map(i32::from);
            for (dx, dy) in [
                (-1, -1),
                (0, -1),
                (1, -1),
                (-1, 0),
                (1, 0),
                (-1, 1),
                (0, 1),
                (1, 1),
            ] {
                let (Ok(x), Ok(y)) = (u16::try_from(x + dx), u16::try_from(y + dy)) else {
                    continue;
                };
                if let Some(&next) = at.get(&[x, y]).filter(|&&n| !settled[n as usize]) {
                    let length: f64 = length + distance(from, next);
                    heap.push(Reverse((length.to_bits(), source, next)));
                }
            }
        };
    for i in 0..chart.len() as u32 {
        if settled[i as usize] {
            visit(&mut heap, &settled, i, 0.0, base + i);
        }
    }
    while let Some(Reverse((length, source, i))) = heap.pop() {
        if !std::mem::replace(&mut settled[i as usize], true) {
            sources[i as usize] = source;
            visit(&mut heap, &settled, i, f64::from_bits(length), source);
        }
    }
    // What texels do not connect (two parts of a chart that meet in a point) goes by plain distance.
    let reached: Vec<u32> = (0..chart.len() as u32)
        .filter(|&i| settled[i as usize])
        .collect();
    for i in (0..chart.len() as u32).filter(|&i| !settled[i as usize]) {
        let nearest = reached
            .iter()
            .min_by(|&&a, &&b| distance(i, a).total_cmp(&distance(i, b)));
        sources[i as usize] = sources[*nearest.expect("the chart has a valid point") as usize];
    }
}
