// Depth cubes: six layers of a depth array a lamp, addressed by hand, so that the texel which
// answers for a point is known exactly. Faces are +X, -X, +Y, -Y, +Z, -Z. Depth is reversed and
// has no far plane: near / z, with z along the face's axis, and 0 where nothing was drawn.

// Coordinates of an offset in a face's frame: two across, then along its axis.
fn face_coordinates(face: u32, offset: vec3f) -> vec3f {
    var turned = offset;
    if face < 2u {
        turned = offset.yzx;
    } else if face < 4u {
        turned = offset.zxy;
    }
    return vec3f(turned.xy, select(turned.z, -turned.z, (face & 1u) == 1u));
}

// The face an offset from the lamp passes through.
fn cube_face(offset: vec3f) -> u32 {
    let size = abs(offset);
    if size.x >= size.y && size.x >= size.z {
        return select(0u, 1u, offset.x < 0.0);
    }
    if size.y >= size.z {
        return select(2u, 3u, offset.y < 0.0);
    }
    return select(4u, 5u, offset.z < 0.0);
}

// Largest distance, in texels, between a point's projection and the sample that answers for it:
// half a texel, and a sixteenth for the snapping of vertices (Vulkan asks for 4 subpixel bits).
const SAMPLE_DISTANCE = 0.5 + 0.0625;

// Relative error of a stored depth: four roundings of 2^-24, for triangles whose own depths span
// up to a factor of 2^6.
const DEPTH_ROUNDING = 0x1p-16;

// How far, in metres, to lift a point off its surface so that the surface cannot shadow it.
//
// Let the lamp be the origin and the surface the plane n·x = -h. A lifted point y' = y + δn has
// depth z' along its face's axis; p = y'/z' and the direction c of the sample differ by at most
// SAMPLE_DISTANCE texels of 2/size across each of the two axes, so |n·(c - p)| <= ε with
// ε = √2 · SAMPLE_DISTANCE · 2/size. The plane's depth along c is h / (-n·c), and it is no less
// than z' if h >= z' (-n·p + ε) = h - δ + z' ε. With z' <= z + δ that is δ >= z ε / (1 - ε);
// a relative error of the stored depth adds its share of h.
fn cube_lift(size: f32, from_lamp: vec3f, normal: vec3f) -> f32 {
    let epsilon = sqrt(2.0) * SAMPLE_DISTANCE * 2.0 / size;
    let depth = max(max(abs(from_lamp.x), abs(from_lamp.y)), abs(from_lamp.z));
    let height = abs(dot(normal, from_lamp));
    return (depth * epsilon + DEPTH_ROUNDING * height) / (1.0 - epsilon);
}

// Whether a lamp sees a point of unit normal: 0 or 1. `from_lamp` leads from the lamp to the point.
fn cube_visibility(
    cubes: texture_depth_2d_array,
    near: f32,
    lamp: u32,
    from_lamp: vec3f,
    normal: vec3f,
) -> f32 {
    if dot(normal, from_lamp) >= 0.0 {
        return 0.0;
    }
    let size = f32(textureDimensions(cubes).x);
    let lifted = from_lamp + normal * cube_lift(size, from_lamp, normal);
    let face = cube_face(lifted);
    let seen = face_coordinates(face, lifted);
    let place = vec2f(0.5, -0.5) * (seen.xy / seen.z) + 0.5;
    let texel = clamp(vec2i(floor(place * size)), vec2i(0), vec2i(i32(size) - 1));
    let stored = textureLoad(cubes, texel, i32(lamp * 6u + face), 0);
    return select(1.0, 0.0, stored * seen.z > near);
}
