//! A small room with a block in it: its radiance map, gathered plainly, and its glTF.
//!
//! The gather is the definition: from each reference point cosine rays, a walk of [`BOUNCES`]
//! hits without Russian roulette, the product of albedos added to the cell that was hit.

use crate::random::{self, Random};
use glam::{DVec3, Vec3};
use half::f16;
use lightkiln_format::prm::{LANES, Prm, ROW};
use serde_json::json;
use std::path::Path;

/// World position of the room's corner, metres.
pub const ORIGIN: [f64; 3] = [1200.0, -8.0, 340.5];
/// Where lamps may be, world metres.
pub const LAMP_VOLUME: [[f64; 3]; 2] = [[1200.1, -7.9, 340.6], [1203.9, -5.4, 345.4]];

const ROOM: Vec3 = Vec3::new(4.0, 2.7, 5.0);
const BLOCK: [Vec3; 2] = [Vec3::new(2.2, 0.0, 2.4), Vec3::new(3.1, 1.2, 3.3)];
/// The first directions of a point are stratified: this many strata each way.
const STRATA: usize = 24;
const BOUNCES: usize = 4;
const TEXELS_PER_METRE: f32 = 6.0;
/// Metres from a surface to its reference and entry points.
const LIFT: f32 = 1e-3;

/// A rectangle `corner + s u + t v`, seen from the side of `u × v`.
pub struct Wall {
    corner: Vec3,
    u: Vec3,
    v: Vec3,
    albedo: Vec3,
    page: usize,
    /// First texel and size of the chart, texels.
    chart: [u32; 4],
    first_cell: usize,
    cells: [usize; 2],
}

impl Wall {
    fn normal(&self) -> Vec3 {
        self.u.cross(self.v).normalize()
    }

    fn at(&self, s: f32, t: f32) -> Vec3 {
        self.corner + self.u * s + self.v * t
    }
}

/// The room's walls on page 0, the block's on page 1, with charts and cells laid out.
pub fn walls() -> (Vec<Wall>, Vec<[u32; 2]>) {
    let grey = Vec3::splat(0.7);
    let (red, green) = (Vec3::new(0.7, 0.08, 0.06), Vec3::new(0.1, 0.5, 0.12));
    let mut walls = Vec::new();
    let mut box_walls = |low: Vec3, size: Vec3, inward: bool, colours: [Vec3; 6], page| {
        for (face, albedo) in colours.into_iter().enumerate() {
            let axis = face / 2;
            let edge = |k: usize| Vec3::AXES[(axis + k) % 3] * size[(axis + k) % 3];
            let corner = low + edge(0) * (face % 2) as f32;
            // u × v points along the axis; turned when it has to point the other way.
            let along = (face % 2 == 1) != inward;
            let (u, v) = if along {
                (edge(1), edge(2))
            } else {
                (edge(2), edge(1))
            };
            let (first_cell, cells, chart) = (0, [0; 2], [0; 4]);
            walls.push(Wall {
                corner,
                u,
                v,
                albedo,
                page,
                chart,
                first_cell,
                cells,
            });
        }
    };
    box_walls(
        Vec3::ZERO,
        ROOM,
        true,
        [red, green, grey, grey, grey, grey],
        0,
    );
    box_walls(
        BLOCK[0],
        BLOCK[1] - BLOCK[0],
        false,
        [Vec3::new(0.75, 0.72, 0.6); 6],
        1,
    );
    // The block's underside lies on the floor.
    walls.remove(8);
    let mut pages = vec![[0, 0]; 2];
    let mut first_cell = 0;
    for wall in &mut walls {
        let texels = |edge: Vec3| (edge.length() * TEXELS_PER_METRE).ceil() as u32;
        let (width, height) = (texels(wall.u), texels(wall.v));
        // One column of charts a page, a texel of gutter around each.
        let page = &mut pages[wall.page];
        wall.chart = [1, page[1] + 1, width, height];
        *page = [page[0].max(width + 2), page[1] + height + 2];
        wall.cells = [wall.u, wall.v].map(|e| (e.length() / 0.5).ceil() as usize);
        wall.first_cell = first_cell;
        first_cell += wall.cells[0] * wall.cells[1];
    }
    (walls, pages)
}

/// Nearest wall in front along a ray: its number and the place on it.
fn hit(walls: &[Wall], from: Vec3, ray: Vec3) -> Option<(usize, f32, f32)> {
    let crossing = |(i, wall): (usize, &Wall)| {
        let normal = wall.normal();
        let slope = normal.dot(ray);
        let distance = normal.dot(wall.corner - from) / slope;
        let place = from + ray * distance - wall.corner;
        let s = place.dot(wall.u) / wall.u.length_squared();
        let t = place.dot(wall.v) / wall.v.length_squared();
        let inside = (0.0..1.0).contains(&s) && (0.0..1.0).contains(&t);
        (slope < 0.0 && distance > 0.0 && inside).then_some((distance, (i, s, t)))
    };
    let hits = walls.iter().enumerate().filter_map(crossing);
    hits.min_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, place)| place)
}

/// Responses of all cells at a point.
fn gather(
    walls: &[Wall],
    cells: usize,
    point: Vec3,
    normal: Vec3,
    random: &mut Random,
) -> Vec<Vec3> {
    let mut responses = vec![Vec3::ZERO; cells];
    let weight_of_ray = 1.0 / (STRATA * STRATA) as f32;
    for ray in 0..STRATA * STRATA {
        let stratum = [ray % STRATA, ray / STRATA];
        let mut place = stratum.map(|i| (i as f32 + random.uniform(0.0, 1.0)) / STRATA as f32);
        let (mut from, mut normal, mut weight) = (point, normal, Vec3::ONE);
        for _ in 0..BOUNCES {
            // A point on the unit sphere about the normal's tip is cosine-distributed.
            let ray = (normal + Vec3::from(random::on_sphere(place))).normalize_or(normal);
            place = [random.uniform(0.0, 1.0), random.uniform(0.0, 1.0)];
            let Some((i, s, t)) = hit(walls, from, ray) else {
                break;
            };
            let wall = &walls[i];
            weight *= wall.albedo;
            let [columns, rows] = wall.cells;
            let column = ((s * columns as f32) as usize).min(columns - 1);
            let row = ((t * rows as f32) as usize).min(rows - 1);
            responses[wall.first_cell + row * columns + column] += weight * weight_of_ray;
            normal = wall.normal();
            from = wall.at(s, t) + normal * LIFT;
        }
    }
    responses
}

/// The room's radiance map.
pub fn prm() -> Prm {
    let (walls, pages) = walls();
    let random = &mut Random(42);
    let mut prm = Prm {
        origin: ORIGIN,
        pages,
        cell_entries: vec![0],
        ..Prm::default()
    };
    let mut points = Vec::new();
    for wall in &walls {
        let normal = wall.normal();
        let [columns, rows] = wall.cells;
        for cell in 0..columns * rows {
            for part in 0..9 {
                let place = |index: usize, part: usize, count: usize, jitter: f32| {
                    (index as f32 + (part as f32 + jitter) / 3.0) / count as f32
                };
                let s = place(cell % columns, part % 3, columns, random.uniform(0.0, 1.0));
                let t = place(cell / columns, part / 3, rows, random.uniform(0.0, 1.0));
                prm.entry_position
                    .push((wall.at(s, t) + normal * LIFT).into());
                prm.entry_normal.push(normal.into());
            }
            prm.cell_entries.push(prm.entry_position.len() as u32);
        }
        let [x0, y0, width, height] = wall.chart;
        let first = points.len();
        for i in 0..width * height {
            let (x, y) = (i % width, i / width);
            let s = (x as f32 + 0.5) / width as f32;
            let t = (y as f32 + 0.5) / height as f32;
            let point = wall.at(s, t) + normal * LIFT;
            let hidden = (point.cmpgt(BLOCK[0]) & point.cmplt(BLOCK[1])).all();
            if !hidden {
                prm.point_texel
                    .push([wall.page as u16, (x0 + x) as u16, (y0 + y) as u16, 0]);
                points.push((point, normal));
            }
        }
        // Gutter and hidden texels copy the nearest point of the chart.
        for i in 0..(width + 2) * (height + 2) {
            let (x, y) = (x0 - 1 + i % (width + 2), y0 - 1 + i / (width + 2));
            let distance = |p: usize| {
                let [_, px, py, _] = prm.point_texel[p].map(u32::from);
                px.abs_diff(x).pow(2) + py.abs_diff(y).pow(2)
            };
            let nearest = (first..points.len()).min_by_key(|&p| distance(p)).unwrap();
            if distance(nearest) > 0 {
                prm.fill.push([wall.page as u32, x, y, nearest as u32]);
            }
        }
    }
    prm.block_rows.push(0);
    for block in points.chunks(LANES) {
        let gathered: Vec<_> = block
            .iter()
            .map(|&(p, n)| gather(&walls, prm.cells(), p, n, random))
            .collect();
        for cell in 0..prm.cells() {
            if gathered
                .iter()
                .all(|responses| responses[cell] == Vec3::ZERO)
            {
                continue;
            }
            let mut row = [f16::ZERO; ROW];
            for (lane, responses) in gathered.iter().enumerate() {
                (0..3).for_each(|c| row[c * LANES + lane] = f16::from_f32(responses[cell][c]));
            }
            prm.row_cell.push(cell as u16);
            prm.row_response.extend(row);
        }
        prm.block_rows.push(prm.row_cell.len() as u32);
    }
    prm
}

/// Writes the room as `scene.lit.glb`, with a lid-less portal node that must not be drawn.
pub fn write_glb(path: &Path) {
    let (walls, pages) = walls();
    let (mut binary, mut views, mut accessors) = (Vec::new(), Vec::new(), Vec::new());
    let mut push = |data: &[f32], kind: &str, bounds: Option<[Vec3; 2]>| {
        let bytes: &[u8] = bytemuck::cast_slice(data);
        views.push(json!({ "buffer": 0, "byteOffset": binary.len(), "byteLength": bytes.len() }));
        binary.extend_from_slice(bytes);
        let mut accessor = json!({ "bufferView": views.len() - 1, "componentType": 5126, "count": 6, "type": kind });
        if let Some([low, high]) = bounds {
            accessor["min"] = json!(low.to_array());
            accessor["max"] = json!(high.to_array());
        }
        accessors.push(accessor);
        accessors.len() - 1
    };
    let (mut primitives, mut materials) = (Vec::new(), Vec::new());
    for wall in &walls {
        let [x0, y0, width, height] = wall.chart;
        let [page_width, page_height] = pages[wall.page];
        let (mut positions, mut normals, mut uv) = (Vec::new(), Vec::new(), Vec::new());
        for (s, t) in [(0, 0), (1, 0), (1, 1), (0, 0), (1, 1), (0, 1)] {
            positions.extend(wall.at(s as f32, t as f32).to_array());
            normals.extend(wall.normal().to_array());
            uv.push((x0 + s * width) as f32 / page_width as f32);
            uv.push((y0 + t * height) as f32 / page_height as f32);
        }
        let ends = [wall.at(0.0, 0.0), wall.at(1.0, 1.0)];
        let bounds = [ends[0].min(ends[1]), ends[0].max(ends[1])];
        materials.push(json!({ "pbrMetallicRoughness": {
            "baseColorFactor": wall.albedo.extend(1.0).to_array(), "metallicFactor": 0.0 } }));
        primitives.push(json!({
            "attributes": {
                "POSITION": push(&positions, "VEC3", Some(bounds)),
                "NORMAL": push(&normals, "VEC3", None),
                "TEXCOORD_1": push(&uv, "VEC2", None),
                // glTF wants TEXCOORD_0 where there is TEXCOORD_1.
                "TEXCOORD_0": push(&uv, "VEC2", None),
            },
            "material": materials.len() - 1,
            "extras": { "lightkiln": { "page": wall.page } },
        }));
    }
    let block = primitives.split_off(6);
    let document = json!({
        "asset": { "version": "2.0" },
        "scene": 0,
        "scenes": [{ "nodes": [0], "extras": { "lightkiln": { "lamp_volumes": [
            { "min": LAMP_VOLUME[0], "max": LAMP_VOLUME[1] }
        ] } } }],
        "nodes": [
            { "name": "root", "translation": ORIGIN, "children": [1, 2, 3] },
            { "name": "room", "mesh": 0, "extras": { "lightkiln": { "role": "static" } } },
            { "name": "block", "mesh": 1 },
            { "name": "window", "mesh": 0, "translation": [1.0, 0.0, 1.0],
              "extras": { "lightkiln": { "role": "portal" } } },
        ],
        "meshes": [{ "primitives": primitives }, { "primitives": block }],
        "materials": materials,
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{ "byteLength": binary.len() }],
    });
    let mut text = document.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut file = b"glTF".to_vec();
    let total = 28 + text.len() + binary.len();
    file.extend(
        [2, total as u32, text.len() as u32]
            .map(u32::to_le_bytes)
            .concat(),
    );
    file.extend(b"JSON");
    file.extend(text);
    file.extend((binary.len() as u32).to_le_bytes());
    file.extend(b"BIN\0");
    file.extend(binary);
    std::fs::write(path, file).unwrap();
}

/// A point of the room, as shares of its size, in world metres.
pub fn world(share: [f64; 3]) -> DVec3 {
    DVec3::from(ORIGIN) + DVec3::from(share) * ROOM.as_dvec3()
}
