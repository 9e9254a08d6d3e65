// Eye-dome lighting, and the surface laid over its background. Twin:
// kernel/light.rs.

@group(0) @binding(5) var<storage, read_write> before: array<Surface>;
@group(0) @binding(7) var<storage, read_write> pixels: array<u32>;

const STEEPEST: f32 = 6.0;
const DIAGONAL: f32 = 0.70710678;

fn rise(depth: f32, x: i32, y: i32, closeness: f32) -> f32 {
    if x < 0 || y < 0 || x >= i32(frame.width) || y >= i32(frame.height) {
        return 0.0;
    }
    let there = before[u32(y) * frame.width + u32(x)];
    if there.depth == NO_DEPTH {
        return 0.0;
    }
    let up = (depth - f32(there.depth)) / depth * frame.focal;
    return min(max(up * closeness / f32(frame.reach), 0.0), STEEPEST);
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) at: vec3<u32>) {
    if at.x >= frame.width || at.y >= frame.height {
        return;
    }
    let index = at.y * frame.width + at.x;
    let here = before[index];
    var shadow = 0.0;
    if here.depth != NO_DEPTH {
        let depth = f32(here.depth);
        let x = i32(at.x);
        let y = i32(at.y);
        let r = i32(frame.reach);
        shadow += rise(depth, x - r, y, 1.0);
        shadow += rise(depth, x + r, y, 1.0);
        shadow += rise(depth, x, y - r, 1.0);
        shadow += rise(depth, x, y + r, 1.0);
        shadow += rise(depth, x - r, y - r, DIAGONAL);
        shadow += rise(depth, x - r, y + r, DIAGONAL);
        shadow += rise(depth, x + r, y - r, DIAGONAL);
        shadow += rise(depth, x + r, y + r, DIAGONAL);
    }
    let lit = exp(-frame.edl * shadow / 8.0);
    let alpha = here.color >> 24u;
    let behind = tables[256u + at.y];
    var color = vec3<u32>(
        u32(f32(channel(here.color, 0u)) * lit + 0.5),
        u32(f32(channel(here.color, 1u)) * lit + 0.5),
        u32(f32(channel(here.color, 2u)) * lit + 0.5)
    );
    if (behind >> 24u) == 0u {
        pixels[index] = color.x | (color.y << 8u) | (color.z << 16u) | (alpha << 24u);
        return;
    }
    let under = vec3<u32>(channel(behind, 0u), channel(behind, 1u), channel(behind, 2u));
    color = (color * alpha + under * (255u - alpha) + vec3<u32>(127u)) / 255u;
    pixels[index] = color.x | (color.y << 8u) | (color.z << 16u) | 0xff000000u;
}
