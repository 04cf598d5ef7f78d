//! Authored second texture coordinates: which can be kept, at which size, and where.

use super::polygon::{centres_inside, doubled_area, overlaps};
use super::{AtlasOptions, MAX_PAGE_SIDE, Placed, surface_area};
use crate::scene::{Instance, Scene};
use glam::DVec2;
use std::collections::HashMap;

/// Authored coordinates are kept only if they fill at least this share of their rectangle.
const LEAST_USE: f64 = 1.0 / 16.0;

/// Overlap is looked for at this many samples along each side of a texel.
const SAMPLES: u32 = 4;

/// An instance whose authored coordinates are kept: one rectangle to place.
pub(super) struct Layout {
    /// Width and height, texels.
    size: [u32; 2],
    /// Triangle, corners in texels from the rectangle's corner, island.
    triangles: Vec<(u32, [DVec2; 3], u32)>,
    islands: u32,
}

/// The instance's authored coordinates at the size at which its mean density is `texels_per_metre`,
/// or nothing if they cannot serve as a lightmap: absent, outside `[0, 1]`, degenerate, wasteful,
/// overlapping, or with islands so near that they would share texels or bilinear neighbours.
pub(super) fn layout(scene: &Scene, instance: &Instance, texels_per_metre: f32) -> Option<Layout> {
    let triangles: Vec<u32> = instance
        .triangles
        .clone()
        .filter(|&t| surface_area(scene, t) > 0.0)
        .collect();
    let authored = |t: u32| {
        scene.triangles[t as usize]
            .vertices
            .map(|v| scene.lightmap_uvs[v as usize].as_dvec2())
    };
    let (mut surface, mut covered) = (0.0, 0.0);
    let (mut min, mut max) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
    for &t in &triangles {
        let corners = authored(t);
        let usable = |c: &DVec2| c.cmpge(DVec2::ZERO).all() && c.cmple(DVec2::ONE).all();
        let doubled = doubled_area(corners).abs();
        if !corners.iter().all(usable) || doubled == 0.0 {
            return None;
        }
        surface += surface_area(scene, t);
        covered += 0.5 * doubled;
        (min, max) = corners
            .iter()
            .fold((min, max), |(lo, hi), &c| (lo.min(c), hi.max(c)));
    }
    if triangles.is_empty() {
        return None;
    }
    let texels = surface * f64::from(texels_per_metre).powi(2);
    let scale = (texels / covered).sqrt();
    let extent = ((max - min) * scale).ceil().max(DVec2::ONE);
    // One texel of tolerance on each side: a tiny instance always wastes most of its rectangle.
    let wasteful = (extent.x - 2.0).max(0.0) * (extent.y - 2.0).max(0.0) * LEAST_USE > texels;
    let fits = extent
        .cmple(DVec2::splat(f64::from(MAX_PAGE_SIDE / 2)))
        .all();
    if !fits || wasteful {
        return None;
    }
    let (islands, island_of) = islands(scene, &triangles);
    let layout = Layout {
        size: [extent.x as u32, extent.y as u32],
        triangles: triangles
            .iter()
            .zip(island_of)
            .map(|(&t, island)| (t, authored(t).map(|c| (c - min) * scale), island))
            .collect(),
        islands,
    };
    (!layout.islands_touch() && !layout.triangles_overlap()).then_some(layout)
}

/// Number of islands, and the island of each triangle: triangles that share an edge, in space and in
/// the lightmap, belong together. Islands are numbered by their first triangle.
fn islands(scene: &Scene, triangles: &[u32]) -> (u32, Vec<u32>) {
    fn root(parent: &mut [u32], mut i: u32) -> u32 {
        while parent[i as usize] != i {
            parent[i as usize] = parent[parent[i as usize] as usize];
            i = parent[i as usize];
        }
        i
    }
    let mut parent: Vec<u32> = (0..triangles.len() as u32).collect();
    let mut first_at: HashMap<[[u32; 5]; 2], u32> = HashMap::new();
    for (i, &t) in triangles.iter().enumerate() {
        let keys = scene.triangles[t as usize].vertices.map(|v| {
            let (p, uv) = (scene.positions[v as usize], scene.lightmap_uvs[v as usize]);
            [p.x, p.y, p.z, uv.x, uv.y].map(|x| (x + 0.0).to_bits())
        });
        for edge in 0..3 {
            let (a, b) = (keys[edge], keys[(edge + 1) % 3]);
            let other = *first_at.entry([a.min(b), a.max(b)]).or_insert(i as u32);
            let (x, y) = (root(&mut parent, other), root(&mut parent, i as u32));
            parent[x.max(y) as usize] = x.min(y);
        }
    }
    let mut number = HashMap::new();
    let of = (0..triangles.len() as u32).map(|i| {
        let next = number.len() as u32;
        *number.entry(root(&mut parent, i)).or_insert(next)
    });
    let of: Vec<u32> = of.collect();
    (number.len() as u32, of)
}

impl Layout {
    /// Whether two islands come so near that a bilinear read of one would see the other's texels.
    fn islands_touch(&self) -> bool {
        const FREE: u32 = u32::MAX;
        let [width, height] = self.size.map(|s| s as usize);
        let mut owner = vec![FREE; width * height];
        for &(_, corners, island) in &self.triangles {
            let mut shared = false;
            overlaps(corners, |[x, y], _, _| {
                let cell =
                    &mut owner[(y as usize).min(height - 1) * width + (x as usize).min(width - 1)];
                shared |= *cell != FREE && *cell != island;
                *cell = island;
            });
            if shared {
                return true;
            }
        }
        let differ = |a: u32, b: u32| a != FREE && b != FREE && a != b;
        (0..width * height).any(|i| {
            let (x, right, below) = (i % width, i % width + 1 < width, i + width < width * height);
            (right && differ(owner[i], owner[i + 1]))
                || (below && differ(owner[i], owner[i + width]))
                || (below && right && differ(owner[i], owner[i + width + 1]))
                || (below && x > 0 && differ(owner[i], owner[i + width - 1]))
        })
    }

    /// Whether some texel has more samples strictly inside two triangles than one line holds: a
    /// single line of samples may lie in the crack of a seam that was rounded to overlap itself.
    fn triangles_overlap(&self) -> bool {
        let [width, height] = self.size.map(|s| (s * SAMPLES) as usize);
        let mut taken = vec![0u64; (width * height).div_ceil(64)];
        let mut doubled = vec![0u32; (self.size[0] * self.size[1]) as usize];
        let step = f64::from(SAMPLES);
        self.triangles.iter().any(|&(_, corners, _)| {
            let samples = corners.map(|c| c * step);
            let mut overlap = false;
            centres_inside(samples, |[x, y]| {
                let bit = y as usize * width + x as usize;
                if taken[bit / 64] >> (bit % 64) & 1 == 1 {
                    let texel = y / SAMPLES * self.size[0] + x / SAMPLES;
                    doubled[texel as usize] += 1;
                    overlap |= doubled[texel as usize] > SAMPLES;
                }
                taken[bit / 64] |= 1 << (bit % 64);
            });
            overlap
        })
    }
}

/// Packs the rectangles on shelves, tallest first, on pages from `page_base` on; charts are numbered
/// from `chart_base` in the order of the instances.
pub(super) fn pack(
    layouts: Vec<Layout>,
    options: &AtlasOptions,
    page_base: u32,
    chart_base: u32,
) -> Vec<Placed> {
    let margin = 2 * options.padding;
    let largest = layouts.iter().flat_map(|l| l.size).max().unwrap_or(0) + margin;
    let side = options.page_size.max(largest.next_power_of_two());
    let mut order: Vec<usize> = (0..layouts.len()).collect();
    order.sort_by_key(|&i| (std::cmp::Reverse(layouts[i].size[1]), i));
    let mut spots = vec![(0, DVec2::ZERO); layouts.len()];
    let (mut page, mut shelf, mut x) = (page_base, 0..0, 0);
    for i in order {
        let [width, height] = layouts[i].size.map(|s| s + margin);
        if x + width > side {
            (shelf, x) = (shelf.end..shelf.end, 0);
        }
        if shelf.start + height > side {
            (page, shelf, x) = (page + 1, 0..0, 0);
        }
        // The first of a shelf is its tallest.
        shelf.end = shelf.end.max(shelf.start + height);
        let corner = [x + options.padding, shelf.start + options.padding].map(f64::from);
        spots[i] = (page, DVec2::from(corner));
        x += width;
    }
    let mut placed = Vec::new();
    let mut chart = chart_base;
    for (layout, (page, corner)) in layouts.into_iter().zip(spots) {
        placed.extend(
            layout
                .triangles
                .into_iter()
                .map(|(triangle, corners, island)| {
                    let corners = corners.map(|c| c + corner);
                    Placed {
                        triangle,
                        page,
                        chart: chart + island,
                        corners,
                    }
                }),
        );
        chart += layout.islands;
    }
    placed
}
