//! Which points a coarse node takes from its children: the default, and the methods it
//! is compared with.
//!
//! Pure and single-threaded: two threads never share a tree, so no result depends on
//! their timing.

pub mod nearest_to_center;
pub mod one_per_cell;
pub mod poisson;
pub mod poisson_shells;
pub mod random_in_grid;
pub mod sampler;
