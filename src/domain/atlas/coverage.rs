//! Reference points: conservative rasterisation of every chart in its page.

use super::polygon::{barycentric, doubled_area, inside, overlaps};
use super::surface_area;
use crate::domain::{LightmapUvs, NO_PAGE, ReferencePoint};
use crate::scene::Scene;
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
/// chart contains that, at the centroid of what the triangle covers; it is held inside the triangle
/// by the rounding bound of interpolation and lifted off its plane as in pbrt-v4 6.8.6.
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
    let points: Vec<Vec<Candidate>> = charts
        .par_iter()
        .map(|triangles| chart_points(scene, uvs, triangles))
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

fn chart_points(scene: &Scene, uvs: &LightmapUvs, triangles: &[u32]) -> Vec<Candidate> {
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
        return vec![collapsed(scene, uvs, triangles, total)];
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
                point: place.point(scene, cover.triangle, weights, surface * total / kept),
                centre_inside: cover.centre_inside,
                area,
            }
        })
        .collect()
}

/// The one point of a chart whose coordinates all round to a line or a point: the middle of its
/// largest triangle.
fn collapsed(scene: &Scene, uvs: &LightmapUvs, triangles: &[u32], total: f64) -> Candidate {
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
    let point = place.point(scene, triangle, [1.0 / 3.0; 3], total);
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

/// pbrt's bound on the relative error of `n` roundings to f32.
const fn gamma(n: u32) -> f64 {
    let nu = n as f64 * (f32::EPSILON as f64 / 2.0);
    nu / (1.0 - nu)
}

impl Place {
    fn point(&self, scene: &Scene, triangle: u32, weights: [f64; 3], area: f64) -> ReferencePoint {
        let corners = scene.corners(triangle).map(|p| p.as_dvec3());
        let normal = (corners[1] - corners[0])
            .cross(corners[2] - corners[0])
            .normalize();
        let weights = hold_inside(corners, weights);
        let position: DVec3 = corners.iter().zip(weights).map(|(&p, b)| p * b).sum();
        let error: DVec3 = corners.iter().zip(weights).map(|(p, b)| p.abs() * b).sum();
        let geometric_normal = normal.as_vec3().normalize();
        ReferencePoint {
            position: lift(position, normal, error * gamma(7)),
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

/// Barycentric weights moved towards the inside so that rounding the position to f32, and any other
/// evaluation in f32 of seven roundings or less, leaves it off every edge: the distance from the
/// edge opposite to a corner is the corner's weight times its height. A triangle lower than the bound
/// gets its centroid.
fn hold_inside(corners: [DVec3; 3], weights: [f64; 3]) -> [f64; 3] {
    let [a, b, c] = corners;
    let largest = a.abs().max(b.abs()).max(c.abs());
    let error = gamma(7) * largest.length();
    let doubled = (b - a).cross(c - a).length();
    let least = [c - b, a - c, b - a].map(|edge| error * edge.length() / doubled);
    let room = 1.0 - least.iter().sum::<f64>();
    if room.is_nan() || room <= 0.0 {
        return [1.0 / 3.0; 3];
    }
    let clamped = weights.map(|w| w.max(0.0));
    let sum: f64 = clamped.iter().sum();
    std::array::from_fn(|i| least[i] + room * clamped[i] / sum)
}

/// `position` moved along `normal` past its error bound, and rounded away from the plane by at least
/// one ulp in each coordinate in which the normal has a component.
fn lift(position: DVec3, normal: DVec3, error: DVec3) -> Vec3 {
    let offset = normal * normal.abs().dot(error);
    let moved = position + offset;
    let away = |moved: f64, from: f64, direction: f64| {
        let (rounded, from) = (moved as f32, from as f32);
        if direction > 0.0 {
            let up = if f64::from(rounded) < moved {
                rounded.next_up()
            } else {
                rounded
            };
            up.max(from.next_up())
        } else if direction < 0.0 {
            let down = if f64::from(rounded) > moved {
                rounded.next_down()
            } else {
                rounded
            };
            down.min(from.next_down())
        } else {
            rounded
        }
    };
    Vec3::new(
        away(moved.x, position.x, normal.x),
        away(moved.y, position.y, normal.y),
        away(moved.z, position.z, normal.z),
    )
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
