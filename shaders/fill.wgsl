// Holes between the splats of one surface, closed from what surrounds them.
// Twin: kernel/fill.rs.

@group(0) @binding(5) var<storage, read_write> before: array<Surface>;
@group(0) @binding(6) var<storage, read_write> after: array<Surface>;

fn surface(x: i32, y: i32) -> Surface {
    if x < 0 || y < 0 || x >= i32(frame.width) || y >= i32(frame.height) {
        return EMPTY;
    }
    return before[u32(y) * frame.width + u32(x)];
}

fn covered(s: Surface) -> bool {
    return s.depth != NO_DEPTH;
}

fn near(depth: u32) -> u32 {
    return depth + u32(f32(depth) * frame.gap);
}

fn is_across(a: Surface, b: Surface) -> bool {
    return covered(a) && covered(b) && a.depth <= near(b.depth) && b.depth <= near(a.depth);
}

fn filled(here: Surface, x: i32, y: i32) -> Surface {
    var around = array<Surface, 8>(
        surface(x - 1, y), surface(x + 1, y),
        surface(x, y - 1), surface(x, y + 1),
        surface(x - 1, y - 1), surface(x + 1, y + 1),
        surface(x - 1, y + 1), surface(x + 1, y - 1)
    );
    var count = 0u;
    var front = NO_DEPTH;
    for (var i = 0u; i < 8u; i += 2u) {
        let a = around[i];
        let b = around[i + 1u];
        count += select(0u, 1u, covered(a)) + select(0u, 1u, covered(b));
        if is_across(a, b) {
            front = min(front, min(a.depth, b.depth));
        }
    }
    if front == NO_DEPTH {
        return here;
    }
    let bound = near(near(front));
    if covered(here) && here.depth <= bound {
        return here;
    }
    var pairs = 0u;
    var sums = vec3<u32>(0u);
    var depth = 0u;
    for (var i = 0u; i < 8u; i += 2u) {
        let a = around[i];
        let b = around[i + 1u];
        if is_across(a, b) && max(a.depth, b.depth) <= bound {
            pairs += 1u;
            sums += vec3<u32>(channel(a.color, 0u), channel(a.color, 1u), channel(a.color, 2u));
            sums += vec3<u32>(channel(b.color, 0u), channel(b.color, 1u), channel(b.color, 2u));
            depth += a.depth + b.depth;
        }
    }
    if select(pairs >= 1u && count >= 5u, pairs >= 3u, covered(here)) {
        let all = 2u * pairs;
        let mean = (sums + vec3<u32>(all / 2u)) / all;
        return Surface(mean.x | (mean.y << 8u) | (mean.z << 16u) | 0xff000000u, depth / all);
    }
    return here;
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) at: vec3<u32>) {
    if at.x >= frame.width || at.y >= frame.height {
        return;
    }
    let index = at.y * frame.width + at.x;
    after[index] = filled(before[index], i32(at.x), i32(at.y));
}
