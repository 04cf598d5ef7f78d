//! Reference points: conservative rasterisation of every chart in its page.

use super::polygon::{barycentric, doubled_area, inside, overlaps};
use super::surface_area;
use crate::domain::{LightmapUvs, NO_PAGE, ReferencePoint};
use crate::scene::Scene;
use crate::scene::surface::Surfaces;
use glam::{DVec2, DVec3, Vec3};
use rayon::prelude::*;

/// Points are ordered by square tiles of this many texels along a side.
const TILE: u32 = 8;

/// What one triangle covers of one texel.
struct Cover {
    texel: [u32; 2],
    /// Place in the order of tiles and rows.
    rank: [u32; 4],
    triangle: u32,
    /// Covered area, texels².
    area: f64,
    /// Covered area on the surface, m².
    surface: f64,
    /// Texel centre if it lies inside the triangle, else the centroid of the covered part.
    at: DVec2,
    centre_inside: bool,
}

/// One reference point for every texel of which `uvs` covers a positive area.
///
/// A texel belongs to the triangle that contains its centre, else to the one that covers most of it
/// (the lowest number of several). The point lies at the texel's centre or, when no triangle of the
/// chart contains that, at the centroid of what the triangle covers; it is kept off the triangle's
/// edges and lifted off its plane by [`Surfaces::lifted`].
///
/// The areas of a chart's points add up to its surface. A chart thinner than rounding still gets one
/// point. Texels covered by less than the rounding of their coordinates get none.
///
/// Order: chart by chart; within one, 8 x 8 texel tiles counted from the chart's corner, row by row,
/// and row by row in the tile.
pub fn reference_points(scene: &Scene, uvs: &LightmapUvs) -> Vec<ReferencePoint> {
    let mut charted: Vec<u32> = (0..uvs.page_of.len() as u32)
        .filter(|&t| uvs.page_of[t as usize] != NO_PAGE)
        .collect();
    charted.sort_by_key(|&t| uvs.chart_of[t as usize]);
    let charts: Vec<&[u32]> = charted
        .chunk_by(|&a, &b| uvs.chart_of[a as usize] == uvs.chart_of[b as usize])
        .collect();
    let surfaces = Surfaces::of(scene);
    let points: Vec<Vec<Candidate>> = charts
        .par_iter()
        .map(|triangles| chart_points(scene, &surfaces, uvs, triangles))
        .collect();
    claim_once(points.into_iter().flatten().collect())
}

/// A point, and what decides when two charts claim its texel.
struct Candidate {
    point: ReferencePoint,
    centre_inside: bool,
    area: f64,
}

/// Of the charts that claim one texel (their padding failed) keeps the one that contains its centre,
/// else the one that covers most of it, else the first.
fn claim_once(candidates: Vec<Candidate>) -> Vec<ReferencePoint> {
    let key = |c: &Candidate| (c.point.page, c.point.texel[1], c.point.texel[0]);
    let mut order: Vec<u32> = (0..candidates.len() as u32).collect();
    order.par_sort_unstable_by(|&a, &b| {
        let (x, y) = (&candidates[a as usize], &candidates[b as usize]);
        (key(x).cmp(&key(y)))
            .then(y.centre_inside.cmp(&x.centre_inside))
            .then(y.area.total_cmp(&x.area))
            .then(a.cmp(&b))
    });
    let mut kept = vec![false; candidates.len()];
    for group in
        order.chunk_by(|&a, &b| key(&candidates[a as usize]) == key(&candidates[b as usize]))
    {
        kept[group[0] as usize] = true;
    }
    candidates
        .into_iter()
        .zip(kept)
        .filter(|(_, kept)| *kept)
        .map(|(c, _)| c.point)
        .collect()
}

fn chart_points(
    scene: &Scene,
    surfaces: &Surfaces,
    uvs: &LightmapUvs,
    triangles: &[u32],
) -> Vec<Candidate> {
    let [width, height] = uvs.pages[uvs.page_of[triangles[0] as usize] as usize];
    let corners_of = |t: u32| uvs.corners[t as usize].map(|c| c.as_dvec2());
    let all_corners = triangles.iter().flat_map(|&t| corners_of(t));
    let origin = all_corners
        .fold(DVec2::INFINITY, DVec2::min)
        .max(DVec2::ZERO);
    let origin = [origin.x as u32, origin.y as u32];

    let mut covers = Vec::new();
    for &triangle in triangles {
        let corners = corners_of(triangle);
        let ratio = surface_area(scene, triangle) / (0.5 * doubled_area(corners).abs());
        if !ratio.is_finite() {
            continue;
        }
        overlaps(corners, |texel, area, centroid| {
            let centre = DVec2::from(texel.map(f64::from)) + 0.5;
            let centre_inside = inside(corners, centre) >= 0.0;
            let (dx, dy) = (texel[0] - origin[0], texel[1] - origin[1]);
            covers.push(Cover {
                texel,
                rank: [dy / TILE, dx / TILE, dy % TILE, dx % TILE],
                triangle,
                area,
                surface: area * ratio,
                at: if centre_inside { centre } else { centroid },
                centre_inside,
            });
        });
    }
    covers.sort_by_key(|c| c.rank);
    // A coordinate below `side` is rounded by at most half an ulp, side * EPSILON / 2; both borders
    // of a strip across the texel may be off by that.
    let rounding = f64::from(width.max(height)) * f64::from(f32::EPSILON);

    let page = uvs.page_of[triangles[0] as usize];
    let chart = uvs.chart_of[triangles[0] as usize];
    let total: f64 = triangles.iter().map(|&t| surface_area(scene, t)).sum();
    let mut groups: Vec<(&Cover, f64, f64)> = covers
        .chunk_by(|a, b| a.rank == b.rank)
        .map(|group| {
            let best = group.iter().reduce(|a, b| {
                // The sort is stable: of equals the lower triangle comes first and stays.
                let better = (b.centre_inside, b.area) > (a.centre_inside, a.area);
                if better && !(a.centre_inside && b.centre_inside) {
                    b
                } else {
                    a
                }
            });
            let sums = group
                .iter()
                .fold((0.0, 0.0), |(a, s), c| (a + c.area, s + c.surface));
            (best.expect("groups are not empty"), sums.0, sums.1)
        })
        .collect();
    let largest = groups.iter().map(|g| g.1).fold(0.0, f64::max);
    let mut first_largest = true;
    groups.retain(|&(best, area, _)| {
        let only = area == largest && std::mem::take(&mut first_largest);
        only || best.centre_inside || area > rounding
    });
    let kept: f64 = groups.iter().map(|g| g.2).sum();
    if groups.is_empty() || kept == 0.0 {
        return vec![collapsed(scene, surfaces, uvs, triangles, total)];
    }
    groups
        .into_iter()
        .map(|(cover, area, surface)| {
            let weights = barycentric(corners_of(cover.triangle), cover.at);
            let place = Place {
                page,
                chart,
                texel: cover.texel.map(|t| t as u16),
            };
            Candidate {
                point: place.point(
                    scene,
                    surfaces,
                    cover.triangle,
                    weights,
                    surface * total / kept,
                ),
                centre_inside: cover.centre_inside,
                area,
            }
        })
        .collect()
}

/// The one point of a chart whose coordinates all round to a line or a point: the middle of its
/// largest triangle.
fn collapsed(
    scene: &Scene,
    surfaces: &Surfaces,
    uvs: &LightmapUvs,
    triangles: &[u32],
    total: f64,
) -> Candidate {
    let larger = |a: u32, b: u32| {
        if surface_area(scene, b) > surface_area(scene, a) {
            b
        } else {
            a
        }
    };
    let triangle = triangles
        .iter()
        .copied()
        .reduce(larger)
        .expect("charts are not empty");
    let page = uvs.page_of[triangle as usize];
    let limit = uvs.pages[page as usize];
    let corner = uvs.corners[triangle as usize][0];
    let texel = [
        (corner.x as u32).min(limit[0] - 1),
        (corner.y as u32).min(limit[1] - 1),
    ];
    let chart = uvs.chart_of[triangle as usize];
    let place = Place {
        page,
        chart,
        texel: texel.map(|t| t as u16),
    };
    let point = place.point(scene, surfaces, triangle, [1.0 / 3.0; 3], total);
    Candidate {
        point,
        centre_inside: false,
        area: 0.0,
    }
}

struct Place {
    page: u16,
    chart: u32,
    texel: [u16; 2],
}

impl Place {
    fn point(
        &self,
        scene: &Scene,
        surfaces: &Surfaces,
        triangle: u32,
        weights: [f64; 3],
        area: f64,
    ) -> ReferencePoint {
        let geometric_normal = surfaces.facet(triangle).normal;
        let [_, u, v] = weights.map(|w| w as f32);
        ReferencePoint {
            position: surfaces.lifted(triangle, u, v, true),
            normal: shading_normal(scene, triangle, weights, geometric_normal),
            geometric_normal,
            triangle,
            area: area as f32,
            page: self.page,
            texel: self.texel,
            chart: self.chart,
        }
    }
}

/// Interpolated unit normal. Normals that all point to the back are turned; one that only
/// interpolation brings below the surface becomes the geometric normal.
fn shading_normal(scene: &Scene, triangle: u32, weights: [f64; 3], geometric: Vec3) -> Vec3 {
    let normals = scene.triangles[triangle as usize]
        .vertices
        .map(|v| scene.normals[v as usize]);
    let sum: DVec3 = normals
        .iter()
        .zip(weights)
        .map(|(n, b)| n.as_dvec3() * b)
        .sum();
    let normal = sum.as_vec3().normalize_or_zero();
    if normal.dot(geometric) > 0.0 {
        normal
    } else if normals.iter().all(|n| n.dot(geometric) < 0.0) {
        -normal
    } else {
        geometric
    }
}
