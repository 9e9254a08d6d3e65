// From sums to a surface: one colour and one depth a pixel. Twin:
// kernel/resolve.rs.

@group(0) @binding(3) var<storage, read_write> depths: array<u32>;
@group(0) @binding(4) var<storage, read_write> sums: array<u32>;
@group(0) @binding(6) var<storage, read_write> after: array<Surface>;

// A sum cut by so many bits.
fn cut(word: u32, shift: u32) -> u32 {
    let low = sums[word];
    let high = sums[word + 1u];
    if shift == 0u {
        return low;
    }
    if shift < 32u {
        return (high << (32u - shift)) | (low >> shift);
    }
    return high >> (shift - 32u);
}

// How many bits all sums must lose to fit into 31.
fn excess(word: u32) -> u32 {
    var low = 0u;
    var high = 0u;
    for (var sum = 0u; sum < WORDS; sum += 2u) {
        low |= sums[word + sum];
        high |= sums[word + sum + 1u];
    }
    var bits = 32u - countLeadingZeros(low);
    if high != 0u {
        bits = 64u - countLeadingZeros(high);
    }
    return max(bits, 31u) - 31u;
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) at: vec3<u32>) {
    if at.x >= frame.width || at.y >= frame.height {
        return;
    }
    let index = at.y * frame.width + at.x;
    let word = index * WORDS;
    if (sums[word] | sums[word + 1u]) == 0u {
        after[index] = EMPTY;
        return;
    }
    let front = depths[index];
    let shift = excess(word);
    let weight = max(cut(word, shift), 1u);
    let half = weight / 2u;
    let r = (cut(word + 2u, shift) + half) / weight;
    let g = (cut(word + 4u, shift) + half) / weight;
    let b = (cut(word + 6u, shift) + half) / weight;
    var coverage = 255u;
    var depth = NO_DEPTH;
    if front == NO_DEPTH {
        coverage = min(min(weight, HEAVIEST) * 255u / (HEAVIEST * 3u / 4u), 255u);
    } else {
        let sixteenths = i32((cut(word + 8u, shift) + half) / weight) - i32(FRONT);
        let offset = f32(front) * (f32(sixteenths) / (16.0 * frame.focal));
        depth = u32(max(i32(front) + i32(offset), 0));
    }
    after[index] = Surface(r | (g << 8u) | (b << 16u) | (coverage << 24u), depth);
}
