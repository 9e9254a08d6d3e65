// Nothing is drawn yet. Twin: Cpu::clear.

@group(0) @binding(3) var<storage, read_write> depths: array<u32>;
@group(0) @binding(4) var<storage, read_write> sums: array<u32>;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) at: vec3<u32>) {
    if at.x >= frame.width || at.y >= frame.height {
        return;
    }
    let index = at.y * frame.width + at.x;
    depths[index] = NO_DEPTH;
    for (var word = 0u; word < WORDS; word++) {
        sums[index * WORDS + word] = 0u;
    }
}
