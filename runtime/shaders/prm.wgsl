// Precomputed radiance maps: the GPU twin of `format/src/prm.rs`. After shared/lamp.wgsl and
// shared/cube.wgsl.
//
// see_entries (optional) -> weigh_entries -> average_cells -> combine -> write_texels

struct Counts {
    lamps: u32,
    entries: u32,
    cells: u32,
    texels: u32,
}

struct Entry {
    position: vec3f,
    normal: vec3f,
}

// A lightmap texel and the reference point it shows.
struct Texel {
    page: u32,
    x: u32,
    y: u32,
    point: u32,
}

// The blocks and rows whose responses are in one buffer.
struct Chunk {
    first_block: u32,
    blocks: u32,
    first_row: u32,
}

const LANES = 64u;

// Dispatches are two-dimensional, for counts above the limit of one dimension.
fn flat_index(group: vec3u, groups: vec3u, lane: u32) -> u32 {
    return (group.y * groups.x + group.x) * LANES + lane;
}

@group(0) @binding(0) var<uniform> counts: Counts;
@group(0) @binding(1) var<storage, read> lamps: array<Lamp>;
@group(0) @binding(2) var<storage, read> entries: array<Entry>;

// Visibility of the entry points from each lamp that has a depth cube.
@group(0) @binding(3) var<storage, read_write> seen: array<f32>;
@group(0) @binding(4) var cubes: texture_depth_2d_array;
@group(0) @binding(5) var<uniform> near: f32;

@compute @workgroup_size(LANES)
fn see_entries(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let i = flat_index(group, groups, lane);
    if i >= counts.lamps * counts.entries {
        return;
    }
    let lamp = i / counts.entries;
    let entry = entries[i % counts.entries];
    if lamps[lamp].kind != DIRECTIONAL {
        let from_lamp = entry.position - lamps[lamp].position;
        seen[i] = cube_visibility(cubes, near, lamp, from_lamp, entry.normal);
    }
}

// Irradiance of each entry point: the sum over lamps.
@group(0) @binding(3) var<storage, read> visibility: array<f32>;
@group(0) @binding(4) var<storage, read_write> weighed: array<vec4f>;

@compute @workgroup_size(LANES)
fn weigh_entries(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let i = flat_index(group, groups, lane);
    if i >= counts.entries {
        return;
    }
    let entry = entries[i];
    var sum = vec3f();
    for (var lamp = 0u; lamp < counts.lamps; lamp++) {
        let of_lamp = irradiance(lamps[lamp], entry.position, entry.normal);
        sum += of_lamp * visibility[lamp * counts.entries + i];
    }
    weighed[i] = vec4f(sum, 0.0);
}

// Irradiance of each cell: the mean over its entry points (section 5.1 of the paper).
@group(0) @binding(1) var<storage, read> entry_irradiance: array<vec4f>;
@group(0) @binding(2) var<storage, read> cell_entries: array<u32>;
@group(0) @binding(3) var<storage, read_write> averaged: array<vec4f>;

@compute @workgroup_size(LANES)
fn average_cells(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let i = flat_index(group, groups, lane);
    if i >= counts.cells {
        return;
    }
    let first = cell_entries[i];
    let end = cell_entries[i + 1u];
    var sum = vec3f();
    for (var entry = first; entry < end; entry++) {
        sum += entry_irradiance[entry].xyz;
    }
    averaged[i] = vec4f(sum / f32(end - first), 0.0);
}

// Irradiance of each reference point: equation (4), one workgroup a block, one lane a point.
@group(0) @binding(0) var<uniform> chunk: Chunk;
@group(0) @binding(1) var<storage, read> block_rows: array<u32>;
@group(0) @binding(2) var<storage, read> row_cell: array<u32>;
@group(0) @binding(3) var<storage, read> row_response: array<u32>;
@group(0) @binding(4) var<storage, read> cell_irradiance: array<vec4f>;
@group(0) @binding(5) var<storage, read_write> combined: array<vec4f>;

// Two half floats a word; lanes 2k and 2k+1 share word k.
const ROW_WORDS = 3u * LANES / 2u;

fn response(word: u32, lane: u32) -> f32 {
    return unpack2x16float(row_response[word])[lane & 1u];
}

@compute @workgroup_size(LANES)
fn combine(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let local_block = group.y * groups.x + group.x;
    if local_block >= chunk.blocks {
        return;
    }
    let block = chunk.first_block + local_block;
    var sum = vec3f();
    let end = block_rows[block + 1u];
    for (var row = block_rows[block]; row < end; row++) {
        let e = cell_irradiance[row_cell[row]].xyz;
        // A dark cell adds nothing: the whole workgroup spares its reads (section 5.2).
        if all(e == vec3f()) {
            continue;
        }
        let word = (row - chunk.first_row) * ROW_WORDS + lane / 2u;
        let red = response(word, lane);
        let green = response(word + LANES / 2u, lane);
        let blue = response(word + LANES, lane);
        sum += vec3f(red, green, blue) * e;
    }
    combined[block * LANES + lane] = vec4f(sum, 0.0);
}

// Lightmap texels: of the points themselves, and fills.
@group(0) @binding(1) var<storage, read> texels: array<Texel>;
@group(0) @binding(2) var<storage, read> points: array<vec4f>;
@group(0) @binding(3) var lightmap: texture_storage_2d_array<rgba16float, write>;

// The largest half float; brighter irradiance, W/m², is stored as this.
const HALF_MAX = 65504.0;

@compute @workgroup_size(LANES)
fn write_texels(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    let i = flat_index(group, groups, lane);
    if i >= counts.texels {
        return;
    }
    let texel = texels[i];
    let value = min(points[texel.point].xyz, vec3f(HALF_MAX));
    textureStore(lightmap, vec2u(texel.x, texel.y), texel.page, vec4f(value, 1.0));
}
