// Adds up the colours of what is not behind the front by more than the blend
// depth. Twin: kernel/splat.rs.

@group(0) @binding(3) var<storage, read_write> depths: array<u32>;
@group(0) @binding(4) var<storage, read_write> sums: array<atomic<u32>>;

// A sum of 64 bits in two words: what overflows the low one is carried, and
// whoever does it, the total is the same.
fn add(word: u32, value: u32) {
    let before = atomicAdd(&sums[word], value);
    if before > 0xffffffffu - value {
        atomicAdd(&sums[word + 1u], 1u);
    }
}

// How far behind the front, in sixteenths of a pixel from FRONT.
fn behind(splat: Projected, front: u32) -> u32 {
    if front == NO_DEPTH {
        return FRONT;
    }
    let depths_between = f32(i32(splat.depth) - i32(front));
    let pixels = min(max(depths_between * splat.steepness, -f32(FRONT)), f32(FRONT));
    return u32(i32(FRONT) + i32(pixels));
}

@compute @workgroup_size(256)
fn main(@builtin(global_invocation_id) at: vec3<u32>) {
    let splat = splat_at(at.x);
    if !splat.shown {
        return;
    }
    let reach = splat.core + i32(frame.fringe);
    let columns = span(splat.x, reach, frame.width);
    let rows = span(splat.y, reach, frame.height);
    let limit = reach * reach;
    let slope = (HEAVIEST << 16u) / u32(max(limit, 1));
    for (var y = rows.x; y <= rows.y; y++) {
        for (var x = columns.x; x <= columns.y; x++) {
            let distance = square(splat, x, y);
            if distance > limit {
                continue;
            }
            let index = u32(y) * frame.width + u32(x);
            let front = depths[index];
            // Without overflow: depths stay below 2^25, but NO_DEPTH is the last.
            let shown = select(
                splat.depth == front,
                front == NO_DEPTH || splat.depth <= front + splat.blend,
                frame.blended == 1u
            );
            if !shown {
                continue;
            }
            let weight = max((u32(limit - distance) * slope) >> 16u, 1u);
            let word = index * WORDS;
            add(word, weight);
            add(word + 2u, weight * channel(splat.color, 0u));
            add(word + 4u, weight * channel(splat.color, 1u));
            add(word + 6u, weight * channel(splat.color, 2u));
            add(word + 8u, weight * behind(splat, front));
        }
    }
}
