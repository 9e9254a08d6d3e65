// The finished pixels on a canvas, which may have more of them. For the viewer in the
// browser alone: it has no part in what a picture holds, and so no twin.

struct Shown {
    // Of the pixels, and of the canvas.
    picture: vec2<u32>,
    canvas: vec2<u32>,
}

@group(0) @binding(0) var<uniform> shown: Shown;
@group(0) @binding(1) var<storage, read> pixels: array<u32>;

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4<f32> {
    // One triangle over all of it.
    let x = f32(i32(index & 1u) * 4 - 1);
    let y = f32(i32(index >> 1u) * 4 - 1);
    return vec4<f32>(x, y, 0.0, 1.0);
}

fn pixel(x: i32, y: i32) -> vec4<f32> {
    let column = clamp(x, 0, i32(shown.picture.x) - 1);
    let row = clamp(y, 0, i32(shown.picture.y) - 1);
    return unpack4x8unorm(pixels[u32(row) * shown.picture.x + u32(column)]);
}

@fragment
fn fragment(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    if all(shown.picture == shown.canvas) {
        return vec4<f32>(pixel(i32(at.x), i32(at.y)).rgb, 1.0);
    }
    let scale = vec2<f32>(shown.picture) / vec2<f32>(shown.canvas);
    let place = at.xy * scale - vec2<f32>(0.5);
    let corner = vec2<i32>(floor(place));
    let part = place - floor(place);
    let upper = mix(pixel(corner.x, corner.y), pixel(corner.x + 1, corner.y), part.x);
    let lower = mix(pixel(corner.x, corner.y + 1), pixel(corner.x + 1, corner.y + 1), part.x);
    return vec4<f32>(mix(upper, lower, part.y).rgb, 1.0);
}
