//! The steps of drawing, as plain functions over slices. Each has a twin of the
//! same name in `shaders/`, which computes the same with the same operations in
//! the same order; the tests hold them against each other.
//!
//! `project` puts a splat on the screen in whole numbers; from there on nothing
//! is a float until the lighting, and sums are of integers, so that neither the
//! order of the points nor the number of threads can be seen in a picture.
//!
//! The method is high-quality shading by compute shaders (Schütz'
//! dissertation, 5.1.2): a first pass finds the nearest depth of each pixel, a
//! second adds up the colours of all that lies within the blend depth behind
//! it, a third divides.

pub mod fill;
pub mod light;
pub mod project;
pub mod resolve;
pub mod splat;

pub use fill::fill;
pub use light::light;
pub use project::{Projected, project};
pub use resolve::{Surface, resolve};
pub use splat::{Sums, depth, shade};
