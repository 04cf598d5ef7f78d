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

struct Surface {
    @builtin(position) clip: vec4f,
    @location(0) position: vec3f,
    @location(1) normal: vec3f,
    @location(2) lightmap: vec2f,
    @location(3) albedo: vec3f,
    @location(4) @interpolate(flat) page: f32,
}

@vertex
fn place(
    @location(0) position: vec3f,
    @location(1) normal: vec3f,
    @location(2) coordinates: vec2f,
    @location(3) albedo: vec3f,
    @location(4) page: f32,
) -> Surface {
    let clip = view.projection * vec4f(position, 1.0);
    return Surface(clip, position, normal, coordinates, albedo, page);
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
    let brdf = surface.albedo / 3.14159265;
    return Radiance(vec4f(brdf * direct, 1.0), vec4f(brdf * indirect, 1.0));
}
