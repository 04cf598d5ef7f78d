//! Lightmap atlas: unwrapping, coverage, reference points, dilation, and the lit scene.

mod lit_scene;
mod scenes;

use glam::{DVec2, DVec3, Vec2, Vec3};
use lightkiln::bake::lit_scene::write_glb;
use lightkiln::domain::atlas::{
    AtlasOptions, Fill, MAX_TEXELS, NO_SOURCE, dilation, reference_points, unwrap,
};
use lightkiln::domain::{LightmapUvs, NO_PAGE, ReferencePoint};
use lightkiln::error::Error;
use lightkiln::scene::{Role, Scene};
use scenes::{add, cube, empty, icosphere, mixed, quad};
use std::collections::{HashMap, HashSet};

fn options(texels_per_metre: f32) -> AtlasOptions {
    AtlasOptions {
        texels_per_metre,
        page_size: 128,
        padding: 2,
    }
}

fn lay_out(scene: &Scene, options: &AtlasOptions) -> (LightmapUvs, Vec<ReferencePoint>) {
    let uvs = unwrap(scene, options, &|_| true).unwrap();
    let points = reference_points(scene, &uvs);
    (uvs, points)
}

fn area(scene: &Scene, t: u32) -> f64 {
    let [a, b, c] = scene.corners(t).map(|p| p.as_dvec3());
    0.5 * (b - a).cross(c - a).length()
}

fn corners(uvs: &LightmapUvs, t: u32) -> [DVec2; 3] {
    uvs.corners[t as usize].map(|c| c.as_dvec2())
}

/// Barycentric weights in the plane.
fn weights([a, b, c]: [DVec2; 3], p: DVec2) -> [f64; 3] {
    let whole = (b - a).perp_dot(c - a);
    [
        (b - p).perp_dot(c - p),
        (c - p).perp_dot(a - p),
        (a - p).perp_dot(b - p),
    ]
    .map(|w| w / whole)
}

#[test]
fn areas_of_the_points_add_up_to_the_surface() {
    for density in [2.0, 17.0, 40.0] {
        let scene = mixed();
        let (uvs, points) = lay_out(&scene, &options(density));
        let surface: f64 = (0..scene.triangles.len() as u32)
            .map(|t| area(&scene, t))
            .sum();
        let charted: f64 = (0..scene.triangles.len() as u32)
            .filter(|&t| uvs.page_of[t as usize] != NO_PAGE)
            .map(|t| area(&scene, t))
            .sum();
        let points: f64 = points.iter().map(|p| f64::from(p.area)).sum();
        assert_eq!(charted, surface, "every triangle has a page");
        // Each area is rounded to f32 once.
        let tolerance = surface * f64::from(f32::EPSILON) / 2.0;
        assert!(
            (points - surface).abs() <= tolerance,
            "{density}: {points} of {surface} m²"
        );
    }
}

#[test]
fn every_covered_texel_centre_is_one_point_and_none_is_claimed_twice() {
    let scene = mixed();
    let (uvs, points) = lay_out(&scene, &options(17.0));
    let mut at = HashMap::new();
    for p in &points {
        assert!(
            at.insert((p.page, p.texel), p).is_none(),
            "{:?} twice",
            p.texel
        );
        let size = uvs.pages[p.page as usize];
        assert!(u32::from(p.texel[0]) < size[0] && u32::from(p.texel[1]) < size[1]);
        assert_eq!(uvs.chart_of[p.triangle as usize], p.chart);
        assert_eq!(uvs.page_of[p.triangle as usize], p.page);
    }
    for t in 0..scene.triangles.len() as u32 {
        let c = corners(&uvs, t);
        let (lo, hi) = (c[0].min(c[1]).min(c[2]), c[0].max(c[1]).max(c[2]));
        for y in lo.y as u16..=hi.y as u16 {
            for x in lo.x as u16..=hi.x as u16 {
                let centre = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
                if weights(c, centre).iter().all(|&w| w > 0.0) {
                    let p = at.get(&(uvs.page_of[t as usize], [x, y])).expect("a point");
                    assert_eq!(p.triangle, t);
                }
            }
        }
    }
    let with_points: HashSet<u32> = points.iter().map(|p| p.chart).collect();
    let charts: HashSet<u32> = uvs.chart_of.iter().copied().collect();
    assert_eq!(with_points, charts, "every chart has a point");
}

#[test]
fn points_lie_above_their_plane_inside_their_triangle_and_where_their_texel_says() {
    for shift in [0.0, 1e3] {
        let mut scene = mixed();
        scene
            .positions
            .iter_mut()
            .for_each(|p| *p += Vec3::splat(shift));
        let (uvs, points) = lay_out(&scene, &options(17.0));
        for p in &points {
            let [a, b, c] = scene.corners(p.triangle).map(|p| p.as_dvec3());
            let position = p.position.as_dvec3();
            let normal = (b - a).cross(c - a);
            assert!(normal.dot(position - a) > 0.0, "{p:?} is above its plane");
            assert!(p.normal.dot(p.geometric_normal) > 0.0);
            assert!((p.normal.length() - 1.0).abs() < 1e-6 && p.area > 0.0);
            let inside = [(a, b), (b, c), (c, a)];
            let inside = inside.map(|(s, e)| normal.dot((e - s).cross(position - s)));
            // Triangles lower than the rounding of their coordinates have no inside in f32.
            let largest = a.abs().max(b.abs()).max(c.abs()).length();
            let edge = (b - a).length().max((c - b).length()).max((a - c).length());
            let height = normal.length() / edge;
            if height > 32.0 * f64::from(f32::EPSILON) * largest {
                assert!(
                    inside.iter().all(|&s| s > 0.0),
                    "{p:?} is inside {inside:?}"
                );
            }
            // Back from the position to the texel.
            let plane = |u: DVec3, v: DVec3| normal.dot(u.cross(v)) / normal.length_squared();
            let w = [
                plane(b - position, c - position),
                plane(c - position, a - position),
            ];
            let uv = corners(&uvs, p.triangle);
            let at = uv[0] * w[0] + uv[1] * w[1] + uv[2] * (1.0 - w[0] - w[1]);
            let texel = DVec2::new(f64::from(p.texel[0]), f64::from(p.texel[1]));
            let size = (uv[1] - uv[0])
                .length()
                .max((uv[2] - uv[0]).length())
                .max(1.0);
            let slack = 32.0 * f64::from(f32::EPSILON) * (largest / height * size + 128.0);
            let off = (at - texel).max(DVec2::ZERO).min(DVec2::ONE) - (at - texel);
            assert!(off.length() <= slack, "{p:?} off by {off}, slack {slack}");
            if uv.len() == 3 && weights(uv, texel + 0.5).iter().all(|&w| w > 0.0) {
                assert!(
                    (at - texel - 0.5).length() <= slack,
                    "{p:?} is at its texel's centre"
                );
            }
        }
    }
}

#[test]
fn charts_keep_their_distance() {
    let scene = mixed();
    for padding in [0, 1, 3] {
        let options = AtlasOptions {
            padding,
            ..options(12.0)
        };
        let (uvs, points) = lay_out(&scene, &options);
        let at: HashMap<_, _> = points
            .iter()
            .map(|p| ((p.page, p.texel), p.chart))
            .collect();
        // Islands of kept coordinates hold their own distance; here each is one island.
        let reach = 2 * i32::from(padding as u16);
        for p in &points {
            for dy in -reach..=reach {
                for dx in -reach..=reach {
                    let texel = [i32::from(p.texel[0]) + dx, i32::from(p.texel[1]) + dy];
                    let Ok(x) = u16::try_from(texel[0]) else {
                        continue;
                    };
                    let Ok(y) = u16::try_from(texel[1]) else {
                        continue;
                    };
                    if let Some(&chart) = at.get(&(p.page, [x, y])) {
                        assert_eq!(chart, p.chart, "padding {padding}");
                    }
                }
            }
            let size = uvs.pages[p.page as usize];
            for (t, s) in p.texel.into_iter().zip(size) {
                assert!(u32::from(t) >= padding && u32::from(t) + padding < s);
            }
        }
    }
}

#[test]
fn a_chart_does_not_run_around_the_edges_of_a_cube() {
    let mut scene = empty();
    cube(&mut scene, Vec3::ZERO, 1.0);
    let (uvs, _) = lay_out(&scene, &options(16.0));
    for s in 0..12 {
        for t in 0..12 {
            let along = scene.double_area_normal(s).dot(scene.double_area_normal(t));
            assert_eq!(
                uvs.chart_of[s as usize] == uvs.chart_of[t as usize],
                along > 0.5
            );
        }
    }
}

#[test]
fn texture_seams_of_a_smooth_surface_do_not_cut_charts() {
    let mut whole = empty();
    icosphere(&mut whole, Vec3::ZERO, 1.0, 3);
    let mut split = whole.clone();
    // Every corner a vertex of its own, as an exporter writes a surface with many texture seams.
    split.positions.clear();
    split.normals.clear();
    for (i, triangle) in whole.triangles.iter().enumerate() {
        split.triangles[i].vertices = [0, 1, 2].map(|c| 3 * i as u32 + c);
        for v in triangle.vertices {
            split.positions.push(whole.positions[v as usize]);
            split.normals.push(whole.normals[v as usize]);
        }
    }
    split.uvs = vec![Vec2::ZERO; split.positions.len()];
    split.lightmap_uvs = vec![Vec2::NAN; split.positions.len()];
    let (a, _) = lay_out(&whole, &options(16.0));
    let (b, _) = lay_out(&split, &options(16.0));
    assert_eq!(a.chart_of, b.chart_of);
    assert_eq!(a.corners, b.corners);
}

#[test]
fn authored_coordinates_are_kept_unless_they_overlap() {
    let density = 20.0;
    let scene = mixed();
    let (uvs, _) = lay_out(&scene, &options(density));
    for (name, kept) in [("kept", true), ("folded", false)] {
        let instance = scene.instances.iter().find(|i| i.node == name).unwrap();
        let t = instance.triangles.start as usize;
        // The kept rectangle is 1.5 x 1 m shown as a square: 1.5 m² at 20 texels/m.
        let side = density * 1.5f32.sqrt();
        let [a, b, _] = uvs.corners[t];
        let square = (b - a - Vec2::X * side).length() < 1e-3;
        assert_eq!(square, kept, "{name}: {a} {b}");
    }
}

#[test]
fn authored_islands_in_neighbouring_texels_are_laid_out_anew() {
    // Two squares side by side; the gap is two texels at 32 texels/m and half a texel at 8.
    for (density, kept) in [(64.0, true), (8.0, false)] {
        let mut scene = empty();
        let points = [0.0, 1.0, 5.0, 6.0]
            .map(|x| [Vec3::new(x, 0.0, 0.0), Vec3::new(x, 0.0, -1.0)])
            .concat();
        let gap = 0.5 - 1.0 / 32.0;
        let uv1 = [0.0, gap, 0.5, 0.5 + gap]
            .map(|x| [Vec2::new(x, 0.0), Vec2::new(x, gap)])
            .concat();
        let faces = [[0, 2, 3], [0, 3, 1], [4, 6, 7], [4, 7, 5]];
        add(&mut scene, "islands", &points, &faces, Some(&uv1));
        let (uvs, _) = lay_out(&scene, &options(density));
        let apart = uvs.corners[2][0].x - uvs.corners[0][1].x;
        let authored = density / gap * (1.0 / 32.0);
        let same_row = uvs.corners[2][0].y == uvs.corners[0][0].y;
        assert_eq!(
            same_row && (apart - authored).abs() < 1e-3,
            kept,
            "{density}: {apart} {authored}"
        );
    }
}

#[test]
fn dilation_fills_what_is_near_and_nothing_else() {
    let scene = mixed();
    let (uvs, points) = lay_out(&scene, &options(17.0));
    let valid: Vec<bool> = (0..points.len())
        .map(|i| i % 7 != 3 && points[i].chart != 0)
        .collect();
    let reach = 3;
    let fills = dilation(&uvs, &points, &valid, reach);
    let at: HashMap<_, _> = points
        .iter()
        .enumerate()
        .map(|(i, p)| ((p.page, p.texel), i))
        .collect();
    let filled: HashMap<_, _> = fills
        .iter()
        .map(|f| ((f.page, f.texel), f.source))
        .collect();
    assert_eq!(filled.len(), fills.len(), "no texel is filled twice");
    let usable: Vec<bool> = (0..points.len()).map(|i| points[i].chart != 0).collect();
    for f in &fills {
        let own = at.get(&(f.page, f.texel));
        if f.source == NO_SOURCE {
            assert!(!usable[*own.expect("only points are listed without source")]);
            continue;
        }
        assert!(valid[f.source as usize]);
        match own {
            Some(&i) => {
                assert!(!valid[i] && points[i].chart == points[f.source as usize].chart);
            }
            None => assert_eq!(points[f.source as usize].page, f.page),
        }
    }
    for (i, p) in points.iter().enumerate() {
        assert_eq!(filled.contains_key(&(p.page, p.texel)), !valid[i]);
    }
    for (page, size) in uvs.pages.iter().enumerate() {
        for y in 0..size[1] as u16 {
            for x in 0..size[0] as u16 {
                let key = (page as u16, [x, y]);
                if at.contains_key(&key) {
                    continue;
                }
                let r = reach as i32;
                let near = (-r..=r)
                    .flat_map(|dy| (-r..=r).map(move |dx| (dx, dy)))
                    .any(|(dx, dy)| {
                        let (Ok(x), Ok(y)) = (
                            u16::try_from(i32::from(x) + dx),
                            u16::try_from(i32::from(y) + dy),
                        ) else {
                            return false;
                        };
                        at.get(&(key.0, [x, y])).is_some_and(|&i| usable[i])
                    });
                assert_eq!(filled.contains_key(&key), near);
            }
        }
    }
}

#[test]
fn an_invalid_texel_takes_the_nearest_along_the_surface() {
    let mut scene = empty();
    quad(
        &mut scene,
        "strip",
        Vec3::ZERO,
        Vec3::X * 20.0,
        Vec3::Y,
        None,
    );
    let (uvs, points) = lay_out(&scene, &options(1.0));
    let x = |i: usize| points[i].position.x;
    let valid: Vec<bool> = (0..points.len())
        .map(|i| x(i) < 2.0 || x(i) > 18.0)
        .collect();
    let fills = dilation(&uvs, &points, &valid, 0);
    assert_eq!(fills.len(), valid.iter().filter(|&&v| !v).count());
    for Fill { texel, source, .. } in fills {
        let i = points.iter().position(|p| p.texel == texel).unwrap();
        assert_eq!(x(source as usize) < 10.0, x(i) < 10.0);
    }
    assert!(dilation(&uvs, &points, &vec![true; points.len()], 0).is_empty());
}

#[test]
fn the_same_on_any_number_of_threads() {
    let scene = mixed();
    let make = || {
        let (uvs, points) = lay_out(&scene, &options(30.0));
        let valid: Vec<bool> = (0..points.len()).map(|i| i % 5 != 0).collect();
        let fills = dilation(&uvs, &points, &valid, 4);
        (
            format!("{uvs:?} {points:?} {fills:?}"),
            write_glb(&scene, Some(&uvs)).unwrap(),
        )
    };
    let first = make();
    for threads in [1, 2, 7] {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        assert!(pool.install(make) == first, "{threads} threads");
    }
}

#[test]
fn a_surface_larger_than_a_page_gets_a_larger_page() {
    let mut scene = empty();
    quad(
        &mut scene,
        "floor",
        Vec3::ZERO,
        Vec3::X * 30.0,
        Vec3::Y,
        None,
    );
    let (uvs, points) = lay_out(&scene, &options(10.0));
    assert_eq!(uvs.pages.len(), 1);
    assert!(uvs.pages[0].into_iter().max().unwrap() >= 304);
    assert_eq!(points.len(), 3000);
}

#[test]
fn refusals_name_the_field_and_cancelling_stops() {
    let mut scene = empty();
    quad(
        &mut scene,
        "plain",
        Vec3::ZERO,
        Vec3::X * 1e4,
        Vec3::Y * 1e4,
        None,
    );
    let field = |o: &AtlasOptions| match unwrap(&scene, o, &|_| true) {
        Err(Error::Input {
            element, remedy, ..
        }) => {
            assert!(!remedy.is_empty());
            element
        }
        other => panic!("{other:?}"),
    };
    let density = (MAX_TEXELS as f32 / 1e8).sqrt() * 1.01;
    assert_eq!(field(&options(density)), "domain.texels_per_metre");
    assert_eq!(field(&options(f32::NAN)), "domain.texels_per_metre");
    assert_eq!(field(&options(0.0)), "domain.texels_per_metre");
    assert_eq!(
        field(&AtlasOptions {
            page_size: 8,
            ..options(1e-3)
        }),
        "domain.page_size"
    );
    assert_eq!(
        field(&AtlasOptions {
            padding: 65,
            ..options(1e-3)
        }),
        "domain.page_size"
    );
    let scene = mixed();
    for last in [0.0, 0.3, 0.9] {
        let result = unwrap(&scene, &options(10.0), &|f| f < last);
        assert!(matches!(result, Err(Error::Interrupted)));
    }
    assert!(
        unwrap(&empty(), &options(10.0), &|_| true)
            .unwrap()
            .pages
            .is_empty()
    );
}

#[test]
fn only_static_instances_and_real_triangles_receive_light() {
    let mut scene = mixed();
    scene.instances[0].role = Role::Dynamic;
    scene.instances[1].role = Role::Occluder;
    let last = scene.triangles.len() - 1;
    scene.triangles[last].vertices[1] = scene.triangles[last].vertices[0];
    let (uvs, points) = lay_out(&scene, &options(10.0));
    assert!(uvs.page_of[..4].iter().all(|&p| p == NO_PAGE));
    assert_eq!(uvs.page_of[last], NO_PAGE);
    assert!(
        points
            .iter()
            .all(|p| p.triangle >= 4 && p.triangle as usize != last)
    );
}

#[test]
fn normals_below_the_surface_are_turned_or_replaced() {
    let mut scene = empty();
    quad(&mut scene, "turned", Vec3::ZERO, Vec3::X, Vec3::Y, None);
    scene.normals.fill(Vec3::NEG_Z);
    let (_, points) = lay_out(&scene, &options(4.0));
    assert!(points.iter().all(|p| p.normal.distance(Vec3::Z) < 1e-6));
    scene.normals.fill(Vec3::ZERO);
    let (_, points) = lay_out(&scene, &options(4.0));
    assert!(points.iter().all(|p| p.normal == p.geometric_normal));
}
