// The nearest depth of every pixel, by the cores of the splats. Thirty-two bits
// are enough, since colours come in a pass of their own. Twin: kernel/splat.rs.

@group(0) @binding(3) var<storage, read_write> depths: array<atomic<u32>>;

@compute @workgroup_size(256)
fn main(@builtin(global_invocation_id) at: vec3<u32>) {
    let splat = splat_at(at.x);
    if !splat.shown {
        return;
    }
    let columns = span(splat.x, splat.core, frame.width);
    let rows = span(splat.y, splat.core, frame.height);
    let limit = splat.core * splat.core;
    for (var y = rows.x; y <= rows.y; y++) {
        for (var x = columns.x; x <= columns.y; x++) {
            if square(splat, x, y) <= limit {
                atomicMin(&depths[u32(y) * frame.width + u32(x)], splat.depth);
            }
        }
    }
}
