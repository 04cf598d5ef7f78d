//! Small scenes built in memory.

use glam::{Vec2, Vec3};
use lightkiln::scene::material::Material;
use lightkiln::scene::{Instance, Role, Scene, Triangle};
use std::collections::HashMap;

/// An empty scene with one material.
pub fn empty() -> Scene {
    Scene {
        name: "test".into(),
        materials: vec![Material::default()],
        ..Scene::default()
    }
}

/// Adds an instance; vertices are shared, normals are the means of their faces'.
pub fn add(
    scene: &mut Scene,
    name: &str,
    points: &[Vec3],
    faces: &[[u32; 3]],
    uv1: Option<&[Vec2]>,
) {
    let base = scene.positions.len() as u32;
    let mut normals = vec![Vec3::ZERO; points.len()];
    for f in faces {
        let [a, b, c] = f.map(|i| points[i as usize]);
        f.iter()
            .for_each(|&i| normals[i as usize] += (b - a).cross(c - a));
    }
    scene.positions.extend(points);
    scene
        .normals
        .extend(normals.iter().map(|n| n.normalize_or(Vec3::Y)));
    scene.uvs.extend(points.iter().map(|_| Vec2::ZERO));
    let none = vec![Vec2::NAN; points.len()];
    scene.lightmap_uvs.extend(uv1.unwrap_or(&none));
    let first = scene.triangles.len() as u32;
    let instance = scene.instances.len() as u32;
    scene.triangles.extend(faces.iter().map(|f| Triangle {
        vertices: f.map(|i| i + base),
        material: 0,
        instance,
    }));
    scene.instances.push(Instance {
        node: name.into(),
        mesh: format!("{name} mesh"),
        role: Role::Static,
        triangles: first..scene.triangles.len() as u32,
    });
}

pub fn quad(scene: &mut Scene, name: &str, corner: Vec3, u: Vec3, v: Vec3, uv1: Option<&[Vec2]>) {
    let points = [corner, corner + u, corner + u + v, corner + v];
    add(scene, name, &points, &[[0, 1, 2], [0, 2, 3]], uv1);
}

pub const UNIT_SQUARE: [Vec2; 4] = [Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y];

/// A cube whose eight vertices are shared by its faces.
pub fn cube(scene: &mut Scene, corner: Vec3, side: f32) {
    let points: Vec<Vec3> = (0..8u32)
        .map(|i| corner + side * Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32))
        .collect();
    let sides = [
        [0, 2, 3, 1],
        [4, 5, 7, 6],
        [0, 1, 5, 4],
        [2, 6, 7, 3],
        [0, 4, 6, 2],
        [1, 3, 7, 5],
    ];
    let faces: Vec<_> = sides
        .iter()
        .flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]])
        .collect();
    add(scene, "cube", &points, &faces, None);
}

/// A sphere from an icosahedron, each triangle cut in four `levels` times.
pub fn icosphere(scene: &mut Scene, centre: Vec3, radius: f32, levels: u32) {
    let g = (1.0 + 5f32.sqrt()) / 2.0;
    let mut points: Vec<Vec3> = Vec::new();
    for (a, b) in [(-1.0, g), (1.0, g), (-1.0, -g), (1.0, -g)] {
        points.push(Vec3::new(a, b, 0.0));
        points.push(Vec3::new(0.0, a, b));
        points.push(Vec3::new(b, 0.0, a));
    }
    // The twenty triples of mutually nearest points, turned outwards.
    let near = |p: Vec3, q: Vec3| (p.distance(q) - 2.0).abs() < 1e-3;
    let mut faces = Vec::new();
    for a in 0..12 {
        for b in a + 1..12 {
            for c in b + 1..12 {
                let [p, q, r] = [points[a], points[b], points[c]];
                if near(p, q) && near(q, r) && near(r, p) {
                    let outward = (q - p).cross(r - p).dot(p) > 0.0;
                    let face = if outward { [a, b, c] } else { [a, c, b] };
                    faces.push(face.map(|i| i as u32));
                }
            }
        }
    }
    for _ in 0..levels {
        let mut middle: HashMap<(u32, u32), u32> = HashMap::new();
        let mut finer = Vec::new();
        for [a, b, c] in faces {
            let mut between = |p: u32, q: u32| {
                *middle.entry((p.min(q), p.max(q))).or_insert_with(|| {
                    points.push(0.5 * (points[p as usize] + points[q as usize]));
                    points.len() as u32 - 1
                })
            };
            let (ab, bc, ca) = (between(a, b), between(b, c), between(c, a));
            finer.extend([[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]);
        }
        faces = finer;
    }
    for p in &mut points {
        *p = centre + radius * p.normalize();
    }
    add(scene, "sphere", &points, &faces, None);
}

/// Everything at once, away from the origin: quads, a cube, a sphere, slivers, crumbs, authored
/// coordinates that can be kept and some that cannot.
pub fn mixed() -> Scene {
    let mut scene = empty();
    let o = Vec3::new(3.0, -2.0, 7.0);
    quad(&mut scene, "floor", o, Vec3::Z * 3.0, Vec3::X * 2.0, None);
    quad(&mut scene, "wall", o, Vec3::X * 2.0, Vec3::Y * 1.7, None);
    cube(&mut scene, o + Vec3::ONE, 0.6);
    icosphere(&mut scene, o + Vec3::new(1.0, 3.0, 1.0), 0.5, 3);
    for i in 0..4 {
        let thin = 10f32.powi(-i - 1);
        let p = o + Vec3::Y * (4.0 + i as f32);
        add(
            &mut scene,
            "sliver",
            &[p, p + Vec3::X, p + Vec3::new(0.4, 0.0, -thin)],
            &[[0, 1, 2]],
            None,
        );
    }
    for i in 0..5 {
        let p = o + Vec3::new(-1.0, i as f32, 0.3);
        let side = 0.003 * (i + 1) as f32;
        quad(&mut scene, "crumb", p, Vec3::X * side, Vec3::Y * side, None);
    }
    quad(
        &mut scene,
        "kept",
        o - Vec3::X * 4.0,
        Vec3::X * 1.5,
        Vec3::Y,
        Some(&UNIT_SQUARE),
    );
    let folded = [Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::new(0.8, 0.1)];
    quad(
        &mut scene,
        "folded",
        o - Vec3::X * 6.0,
        Vec3::X,
        Vec3::Y,
        Some(&folded),
    );
    scene
}
