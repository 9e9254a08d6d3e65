//! Pictures as files: PNG for one, animated WebP for a turntable.

mod png;
mod webp;

pub use png::png;
pub use webp::Animation;
