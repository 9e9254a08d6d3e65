// A splat on the screen, in whole numbers. Twin: kernel/project.rs.

@group(0) @binding(2) var<storage, read> splats: array<Splat>;

struct Projected {
    shown: bool,
    x: i32,
    y: i32,
    depth: u32,
    blend: u32,
    core: i32,
    steepness: f32,
    color: u32,
}

fn along(axis: vec3<f32>, d: vec3<f32>) -> f32 {
    return axis.x * d.x + axis.y * d.y + axis.z * d.z;
}

fn project(splat: Splat) -> Projected {
    var projected: Projected;
    let d = vec3<f32>(splat.x - frame.eye.x, splat.y - frame.eye.y, splat.z - frame.eye.z);
    let away = along(frame.forward, d);
    if !(away > frame.near) {
        return projected;
    }
    let pixels = frame.focal / away;
    let x = along(frame.right, d) * pixels + f32(frame.width) * 0.5;
    let y = f32(frame.height) * 0.5 - along(frame.up, d) * pixels;
    let radius = bitcast<f32>(tables[splat.paint >> 24u]);
    let core = min(max(radius * pixels, frame.smallest), frame.largest);
    let reach = core + f32(frame.fringe) / SUBPIXELS;
    if !(x > -reach && y > -reach && x < f32(frame.width) + reach && y < f32(frame.height) + reach) {
        return projected;
    }
    projected.shown = true;
    projected.x = i32(floor(x * SUBPIXELS));
    projected.y = i32(floor(y * SUBPIXELS));
    projected.depth = u32(min(away * frame.depth_scale, DEPTHS));
    projected.blend = u32(min((radius + radius + frame.blend * away) * frame.depth_scale, DEPTHS));
    projected.core = i32(core * SUBPIXELS);
    projected.steepness = pixels * frame.steepness;
    projected.color = splat.paint & 0xffffffu;
    return projected;
}

// The splat of a number, not shown where there are fewer.
fn splat_at(number: u32) -> Projected {
    if number >= arrayLength(&splats) {
        return Projected();
    }
    return project(splats[number]);
}

// First and last pixel, of one axis, whose centre may lie within reach.
fn span(at: i32, reach: i32, size: u32) -> vec2<i32> {
    return vec2<i32>(max((at - reach + 7) >> 4u, 0), min((at + reach - 8) >> 4u, i32(size) - 1));
}

// Square of the distance between a pixel's centre and a splat's, in sixteenths.
fn square(splat: Projected, x: i32, y: i32) -> i32 {
    let dx = (x << 4u) + 8 - splat.x;
    let dy = (y << 4u) + 8 - splat.y;
    return dx * dx + dy * dy;
}
