//! Levels of detail: which points a coarse node shows, and in which order.
//!
//! Pure and single-threaded: one chunk's points in, its nodes out. Two threads
//! never share a tree, so no result depends on their timing.

pub mod acquisition;
pub mod average;
pub mod collapse;
pub mod grid;
pub mod nearest;
pub mod order;
pub mod poisson;
pub mod random;
pub mod sampler;
pub mod shells;
pub mod thin;
pub mod tree;
