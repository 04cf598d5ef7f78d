//! Vertex normals where a file has none, or bad ones.
//!
//! A missing normal is the area-weighted mean of the faces that meet at the vertex's position and
//! turn from the corner's own face by less than 45 degrees; a corner without such neighbours gets
//! its face's normal. Vertices whose corners differ are split.

use super::loaded::Part;
use glam::{DVec3, Vec3};
use std::collections::HashMap;

/// Cosine of the angle between faces from which an edge is sharp: 45 degrees.
const SHARP_COSINE: f64 = std::f64::consts::FRAC_1_SQRT_2;
/// Most faces at one position that are smoothed; the work grows with the square.
const MAX_FACES: usize = 256;

/// Fills in missing, non-finite and zero normals of the vertices in use, and makes all unit length.
/// Triangles must be valid. Returns how many vertices were without a usable normal.
pub(super) fn complete(part: &mut Part) -> u64 {
    for n in &mut part.normals {
        *n = n.try_normalize().unwrap_or(Vec3::NAN);
    }
    let mut lacking = vec![false; part.positions.len()];
    let mut count = 0;
    for &v in part.triangles.iter().flatten() {
        let v = v as usize;
        if part.normals[v].is_nan() && !lacking[v] {
            lacking[v] = true;
            count += 1;
        }
    }
    if count == 0 {
        return 0;
    }

    let faces: Vec<DVec3> = part
        .triangles
        .iter()
        .map(|t| {
            let [a, b, c] = t.map(|v| part.positions[v as usize]);
            (b - a).cross(c - a)
        })
        .collect();
    let around = Around::new(part);
    let mut split: HashMap<(u32, [u32; 3]), u32> = HashMap::new();
    for t in 0..part.triangles.len() {
        for corner in 0..3 {
            let v = part.triangles[t][corner];
            if !lacking[v as usize] {
                continue;
            }
            let normal = corner_normal(t, around.faces(v), &faces);
            let key = (v, normal.to_array().map(f32::to_bits));
            let vertex = *split.entry(key).or_insert_with(|| {
                if part.normals[v as usize].is_nan() {
                    part.normals[v as usize] = normal;
                    return v;
                }
                part.positions.push(part.positions[v as usize]);
                part.normals.push(normal);
                part.uvs.push(part.uvs[v as usize]);
                part.lightmap_uvs.push(part.lightmap_uvs[v as usize]);
                part.positions.len() as u32 - 1
            });
            part.triangles[t][corner] = vertex;
        }
    }
    count
}

fn corner_normal(own: usize, around: &[u32], faces: &[DVec3]) -> Vec3 {
    let flat = faces[own].normalize_or(DVec3::Y);
    let smooth: DVec3 = if around.len() > MAX_FACES {
        flat
    } else {
        let near = |f: &&DVec3| f.normalize_or_zero().dot(flat) > SHARP_COSINE;
        around
            .iter()
            .map(|&t| &faces[t as usize])
            .filter(near)
            .sum()
    };
    smooth.try_normalize().unwrap_or(flat).as_vec3().normalize()
}

/// The triangles at each position, in order of their number.
struct Around {
    position_of: Vec<u32>,
    start: Vec<u32>,
    triangles: Vec<u32>,
}

impl Around {
    fn new(part: &Part) -> Self {
        let mut known: HashMap<[u64; 3], u32> = HashMap::new();
        let position_of: Vec<u32> = part
            .positions
            .iter()
            .map(|&p| {
                // Adding zero makes the two zeros equal.
                let key = (p + 0.0).to_array().map(f64::to_bits);
                let next = known.len() as u32;
                *known.entry(key).or_insert(next)
            })
            .collect();
        let mut start = vec![0u32; known.len() + 1];
        for &v in part.triangles.iter().flatten() {
            start[position_of[v as usize] as usize + 1] += 1;
        }
        for i in 1..start.len() {
            start[i] += start[i - 1];
        }
        let mut next = start.clone();
        let mut triangles = vec![0; 3 * part.triangles.len()];
        for (t, triangle) in part.triangles.iter().enumerate() {
            for &v in triangle {
                let slot = &mut next[position_of[v as usize] as usize];
                triangles[*slot as usize] = t as u32;
                *slot += 1;
            }
        }
        Self {
            position_of,
            start,
            triangles,
        }
    }

    fn faces(&self, vertex: u32) -> &[u32] {
        // Vertices added while splitting lie behind those known here and are never asked for.
        let p = self.position_of[vertex as usize] as usize;
        &self.triangles[self.start[p] as usize..self.start[p + 1] as usize]
    }
}
