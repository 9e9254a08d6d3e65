// What every kernel is given: src/render/frame.rs has the same in Rust, and
// src/render/kernel/ the same kernels. This file stands before each of the
// others when they are compiled.

struct Frame {
    right: vec3<f32>,
    focal: f32,
    up: vec3<f32>,
    near: f32,
    forward: vec3<f32>,
    depth_scale: f32,
    eye: vec3<f32>,
    smallest: f32,
    largest: f32,
    fringe: u32,
    blend: f32,
    edl: f32,
    width: u32,
    height: u32,
    reach: u32,
    blended: u32,
    steepness: f32,
    gap: f32,
    unused: vec2<u32>,
}

struct Splat {
    x: f32,
    y: f32,
    z: f32,
    paint: u32,
}

// Red, green, blue and coverage in `color`; NO_DEPTH in `depth` where only the
// fringe of a splat reaches.
struct Surface {
    color: u32,
    depth: u32,
}

const NO_DEPTH: u32 = 0xffffffffu;
const DEPTHS: f32 = 16777216.0;
const SUBPIXELS: f32 = 16.0;
const HEAVIEST: u32 = 64u;
const FRONT: u32 = 128u;
// Words of a pixel's sums: weight, red, green, blue, behind; each low, high.
const WORDS: u32 = 10u;
const EMPTY: Surface = Surface(0u, NO_DEPTH);

@group(0) @binding(0) var<uniform> frame: Frame;
// 256 radii as the bits of floats, then the background of each row.
@group(0) @binding(1) var<storage, read> tables: array<u32>;

fn channel(color: u32, number: u32) -> u32 {
    return (color >> (8u * number)) & 255u;
}
