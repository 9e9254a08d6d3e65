//! Pictures as files: PNG for one, animated WebP for a turntable, MP4 on request.

mod mp4;
mod png;
mod webp;

pub use mp4::Film;
pub use png::png;
pub use webp::Animation;
