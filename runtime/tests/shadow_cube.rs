//! Visibility by depth cubes against analytic occlusion: a room with a slab across half of it.

use crate::gpu;
use crate::random::Random;
use glam::DVec3;
use lightkiln_format::lighting::Light;
use lightkiln_format::prm::Prm;
use lightkiln_runtime::prm::PrmRuntime;
use lightkiln_runtime::shadow_cube::{SceneMesh, ShadowCubes};

const ROOM: [DVec3; 2] = [DVec3::new(-2.0, 0.0, -2.5), DVec3::new(2.0, 3.0, 2.5)];
const SLAB: [DVec3; 2] = [DVec3::new(-2.0, 1.0, -2.5), DVec3::new(0.1, 1.1, 2.5)];

/// Both boxes as triangles.
fn mesh() -> (Vec<[f32; 3]>, Vec<u32>) {
    let (mut positions, mut indices) = (Vec::new(), Vec::new());
    for bounds in [ROOM, SLAB] {
        let base = positions.len() as u32;
        for i in 0..8 {
            let pick = |axis: usize| bounds[i >> axis & 1][axis] as f32;
            positions.push([pick(0), pick(1), pick(2)]);
        }
        let faces = [
            [0, 2, 6, 4],
            [1, 3, 7, 5],
            [0, 1, 5, 4],
            [2, 3, 7, 6],
            [0, 1, 3, 2],
            [4, 5, 7, 6],
        ];
        for [a, b, c, d] in faces {
            indices.extend([a, b, c, a, c, d].map(|i: u32| base + i));
        }
    }
    (positions, indices)
}

/// Entry points on all walls: position, inward normal, wall.
fn entries(count: usize) -> Vec<(DVec3, DVec3, usize)> {
    let random = &mut Random(1);
    let entry = |i: usize| {
        let wall = i % 6;
        let (axis, side) = (wall / 2, wall % 2);
        let mut position = DVec3::ZERO;
        for k in 0..3 {
            position[k] = f64::from(random.uniform(ROOM[0][k] as f32, ROOM[1][k] as f32));
        }
        position[axis] = ROOM[side][axis];
        let mut normal = DVec3::ZERO;
        normal[axis] = 1.0 - 2.0 * side as f64;
        (position, normal, wall)
    };
    (0..count).map(entry).collect()
}

/// Whether the segment from the lamp along `ray`, up to parameter 1, meets the slab.
fn slab_blocks(lamp: DVec3, ray: DVec3) -> bool {
    let (a, b) = ((SLAB[0] - lamp) / ray, (SLAB[1] - lamp) / ray);
    let enter = a.min(b).max_element().max(0.0);
    let leave = a.max(b).min_element().min(1.0);
    enter < leave
}

/// Whether anything but `wall` is in the way along `ray` up to parameter 1.
fn blocked(lamp: DVec3, ray: DVec3, wall: usize) -> bool {
    let crosses = |other: usize| {
        let (axis, side) = (other / 2, other % 2);
        let t = (ROOM[side][axis] - lamp[axis]) / ray[axis];
        other != wall && t > 0.0 && t < 1.0
    };
    slab_blocks(lamp, ray) || (0..6).any(crosses)
}

/// Whether the sample that answers for a point may see something else than the point does.
///
/// The sample's direction lies within `SAMPLE_DISTANCE` texels of the lifted point's projection,
/// and the lift (see `cube_lift`) moves the point itself by at most that footprint: if all rays to
/// the corners and the middle of that square, at the depth of the lifted point, agree with the
/// true ray, the lookup has no excuse. Slab and room are convex, so corners suffice where the
/// square is smaller than they are.
fn ambiguous(lamp: DVec3, (position, normal, wall): (DVec3, DVec3, usize), size: f64) -> bool {
    let footprint = 2.0 * (0.5 + 0.0625) / size;
    let from_lamp = position - lamp;
    let epsilon = 2.0_f64.sqrt() * footprint;
    let height = normal.dot(from_lamp).abs();
    let lift = (from_lamp.abs().max_element() * epsilon + height / 65536.0) / (1.0 - epsilon);
    let lifted = from_lamp + normal * lift;
    let depth = lifted.abs().max_element();
    let main = (0..3).find(|&k| lifted[k].abs() == depth).unwrap();
    let truth = blocked(lamp, from_lamp, wall);
    let corner = |i: usize, j: usize| {
        let mut ray = lifted;
        ray[(main + 1) % 3] += depth * footprint * (i as f64 - 1.0);
        ray[(main + 2) % 3] += depth * footprint * (j as f64 - 1.0);
        blocked(lamp, ray, wall) != truth
    };
    (0..9).any(|k| corner(k % 3, k / 3))
}

#[test]
fn cubes_agree_with_analytic_occlusion_up_to_the_footprint() {
    let Some(gpu) = gpu::open() else { return };
    let entries = entries(30_000);
    let origin = DVec3::new(500.0, -20.0, 3000.0);
    let prm = Prm {
        origin: origin.into(),
        entry_position: entries.iter().map(|e| e.0.as_vec3().into()).collect(),
        entry_normal: entries.iter().map(|e| e.1.as_vec3().into()).collect(),
        cell_entries: vec![0, entries.len() as u32],
        block_rows: vec![0],
        ..Prm::default()
    };
    let (positions, indices) = mesh();
    let mesh = SceneMesh {
        positions: &positions,
        indices: &indices,
    };
    // Above and below the slab, across its edge, and 2 cm from a wall.
    let lamps = [
        [0.3, 2.0, -0.2],
        [-1.0, 0.5, 1.0],
        [1.2, 1.05, 0.0],
        [1.98, 1.6, -1.0],
    ];
    let light = |p: &[f64; 3]| Light::Point {
        position: origin + DVec3::from(*p),
        intensity: glam::Vec3::ONE,
        radius: 0.0,
    };
    let lights: Vec<_> = lamps.iter().map(light).collect();
    let mut runtime = PrmRuntime::new(&gpu.0, &gpu.1, &prm).unwrap();
    runtime.set_lights(&lights).unwrap();
    let mut shares = Vec::new();
    for size in [128, 512, 2048] {
        let mut cubes = ShadowCubes::new(&gpu.0, &gpu.1, &mesh, size).unwrap();
        gpu::submit(&gpu, |encoder| runtime.see_entries(encoder, &mut cubes)).unwrap();
        let seen: Vec<f32> = gpu::read(&gpu, runtime.visibility());
        let (mut differing, mut excused, mut wrong, mut hidden) = (0, 0, 0, 0);
        for (i, &lamp) in lamps.iter().enumerate() {
            let lamp = DVec3::from(lamp);
            for (k, &entry) in entries.iter().enumerate() {
                let truth = !blocked(lamp, entry.0 - lamp, entry.2);
                let differs = (seen[i * entries.len() + k] != 0.0) != truth;
                let ambiguous = ambiguous(lamp, entry, f64::from(size));
                hidden += usize::from(!truth);
                differing += usize::from(differs);
                excused += usize::from(ambiguous);
                wrong += usize::from(differs && !ambiguous);
            }
        }
        let share = |n: usize| 100.0 * n as f64 / (lamps.len() * entries.len()) as f64;
        println!(
            "{size} texels: {:.3} % of entries differ, {:.3} % lie within the footprint of an \
             edge, {wrong} differ elsewhere; {:.1} % are hidden",
            share(differing),
            share(excused),
            share(hidden)
        );
        assert_eq!(wrong, 0, "entries differ away from every edge");
        assert!((20.0..80.0).contains(&share(hidden)));
        shares.push(share(differing));
    }
    // The footprint shrinks with the texel: four times the texels, a fourth of the error.
    assert!(
        shares[1] < 0.4 * shares[0] && shares[2] < 0.4 * shares[1],
        "{shares:?}"
    );
}

#[test]
fn broken_meshes_are_errors() {
    let Some(gpu) = gpu::open() else { return };
    let new = |positions: &[[f32; 3]], indices: &[u32], size| {
        ShadowCubes::new(&gpu.0, &gpu.1, &SceneMesh { positions, indices }, size)
    };
    let message = |result: Result<ShadowCubes, _>| result.err().map(|e| format!("{e}")).unwrap();
    assert!(message(new(&[[0.0; 3]], &[0, 0, 1], 64)).contains("`indices`, element 2"));
    assert!(message(new(&[[0.0; 3]], &[0, 0], 64)).contains("`indices`"));
    assert!(message(new(&[[f32::NAN; 3]], &[0, 0, 0], 64)).contains("`positions`, element 0"));
    assert!(message(new(&[], &[], 1 << 30)).contains("max_texture_dimension_2d"));
    assert!(message(new(&[], &[], 0)).contains("resolution"));
    new(&[], &[], 64).unwrap();
}
