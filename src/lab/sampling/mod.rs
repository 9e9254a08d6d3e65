//! How good samples are: spacing and coverage of a finished octree, and the
//! spectrum of a pattern ("Fast Out-of-Core Octree Generation", section 5,
//! figures 7 and 11).

pub mod evenness;
pub mod neighbors;
pub mod plane;
pub mod spectrum;
