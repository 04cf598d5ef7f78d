// Draws scene geometry into one face of a depth cube. After shared/cube.wgsl.

struct Face {
    lamp: vec3f,
    near: f32,
    face: u32,
}

@group(0) @binding(0) var<uniform> face: Face;

@vertex
fn draw_face(@location(0) position: vec3f) -> @builtin(position) vec4f {
    let seen = face_coordinates(face.face, position - face.lamp);
    return vec4f(seen.xy, face.near, seen.z);
}
