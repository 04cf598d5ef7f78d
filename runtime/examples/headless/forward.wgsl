// Forward pass: direct light with depth-cube shadows, and the lightmap, into two targets of
// radiance. After shared/lamp.wgsl and shared/cube.wgsl.

struct View {
    projection: mat4x4f,
    eye: vec3f,
    lamps: u32,
}

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> lamps: array<Lamp>;
@group(0) @binding(2) var cubes: texture_depth_2d_array;
@group(0) @binding(3) var<uniform> near: f32;
@group(0) @binding(4) var lightmap: texture_2d_array<f32>;
@group(0) @binding(5) var bilinear: sampler;
// Of each texture: first texel, width, height, wrapping (two bits each; repeat, mirror, clamp).
@group(0) @binding(6) var<storage, read> headers: array<vec4u>;
@group(0) @binding(7) var<storage, read> texels: array<u32>;

struct Surface {
    @builtin(position) clip: vec4f,
    @location(0) position: vec3f,
    @location(1) normal: vec3f,
    @location(2) lightmap: vec2f,
    @location(3) albedo: vec3f,
    @location(4) @interpolate(flat) page: f32,
    @location(5) uv: vec2f,
    @location(6) @interpolate(flat) number: f32,
}

@vertex
fn place(
    @location(0) position: vec3f,
    @location(1) normal: vec3f,
    @location(2) coordinates: vec2f,
    @location(3) albedo: vec3f,
    @location(4) page: f32,
    @location(5) uv: vec2f,
    @location(6) number: f32,
) -> Surface {
    let clip = view.projection * vec4f(position, 1.0);
    return Surface(clip, position, normal, coordinates, albedo, page, uv, number);
}

fn wrap(i: i32, n: i32, mode: u32) -> i32 {
    let m = select(n, 2 * n, mode == 1u);
    let j = (i % m + m) % m;
    let folded = select(j, 2 * n - 1 - j, j >= n);
    return select(folded, clamp(i, 0, n - 1), mode == 2u);
}

// Linear colour of one texel.
fn texel(header: vec4u, at: vec2i) -> vec3f {
    let size = vec2i(header.yz);
    let x = wrap(at.x, size.x, header.w & 3u);
    let y = wrap(at.y, size.y, header.w >> 2u);
    let c = unpack4x8unorm(texels[header.x + u32(y * size.x + x)]).xyz;
    return select(pow((c + 0.055) / 1.055, vec3f(2.4)), c / 12.92, c <= vec3f(0.04045));
}

// Bilinear, without mipmaps: the picture has several samples a pixel.
fn base_colour(number: f32, uv: vec2f) -> vec3f {
    if number < 0.0 {
        return vec3f(1.0);
    }
    let header = headers[u32(number)];
    let at = uv * vec2f(header.yz) - 0.5;
    let corner = vec2i(floor(at));
    let f = fract(at);
    let top = mix(texel(header, corner), texel(header, corner + vec2i(1, 0)), f.x);
    let low = mix(texel(header, corner + vec2i(0, 1)), texel(header, corner + vec2i(1, 1)), f.x);
    return mix(top, low, f.y);
}

struct Radiance {
    @location(0) direct: vec4f,
    @location(1) indirect: vec4f,
}

@fragment
fn shade(surface: Surface) -> Radiance {
    let page = max(i32(surface.page), 0);
    var indirect = textureSample(lightmap, bilinear, surface.lightmap, page).xyz;
    if surface.page < 0.0 {
        indirect = vec3f();
    }
    // A double-sided surface shows the side that faces the eye.
    let facing = dot(surface.normal, view.eye - surface.position);
    let normal = normalize(surface.normal) * select(1.0, -1.0, facing < 0.0);
    var direct = vec3f();
    for (var i = 0u; i < view.lamps; i++) {
        let from_lamp = surface.position - lamps[i].position;
        let visible = cube_visibility(cubes, near, i, from_lamp, normal);
        direct += irradiance(lamps[i], surface.position, normal) * visible;
    }
    let brdf = surface.albedo * base_colour(surface.number, surface.uv) / 3.14159265;
    return Radiance(vec4f(brdf * direct, 1.0), vec4f(brdf * indirect, 1.0));
}
