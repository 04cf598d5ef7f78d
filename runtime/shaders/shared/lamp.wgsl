// Direct irradiance of a lamp: the GPU twin of `format/src/direct.rs`, operation by operation.

const SPOT = 1u;
const DIRECTIONAL = 2u;

struct Lamp {
    position: vec3f,
    kind: u32,
    direction: vec3f,
    radius_squared: f32,
    power: vec3f,
    cone_scale: f32,
    cone_offset: f32,
}

// Unoccluded irradiance, W/m², at a position (local, metres) on a surface of unit normal.
fn irradiance(lamp: Lamp, position: vec3f, normal: vec3f) -> vec3f {
    if lamp.kind == DIRECTIONAL {
        return lamp.power * max(dot(normal, -lamp.direction), 0.0);
    }
    let offset = lamp.position - position;
    let squared = dot(offset, offset);
    if squared == 0.0 {
        return vec3f();
    }
    let to_lamp = offset / sqrt(squared);
    var factor = max(dot(normal, to_lamp), 0.0) / max(squared, lamp.radius_squared);
    if lamp.kind == SPOT {
        let cosine = dot(lamp.direction, -to_lamp);
        let falloff = clamp(cosine * lamp.cone_scale + lamp.cone_offset, 0.0, 1.0);
        factor *= falloff * falloff;
    }
    return lamp.power * factor;
}
