//! Pictures of finished octrees, without a display and without a driver.
//!
//! ```text
//! octree ──▶ sample ──▶ framing, colour ──▶ select ──▶ scene ──▶ cpu or gpu ──▶ encode
//! ```
//!
//! A first look at the coarsest nodes decides where to stand and what to colour
//! by; then the nodes that the picture can show are chosen and read, and either
//! of two twins draws them: Rust kernels over tiles (`kernel`, `cpu`) or compute
//! shaders of the same names (`shaders/`, `gpu`). A frame is data before either
//! is asked. Nothing of conversion, queue or web is known here.
//!
//! The papers: priority traversal, adaptive sizes, blend depth and intensity
//! after UnityPIC (4, 5); high-quality shading and eye-dome lighting after
//! Schütz' dissertation (5.1.2, 1.2.2); selection by benefit and prefixes of
//! nodes after Scheiblauer's thesis.

pub mod camera;
pub mod ceiling;
pub mod color;
mod copc;
pub mod cpu;
pub mod encode;
mod error;
pub mod frame;
pub mod framing;
pub mod gpu;
pub mod kernel;
mod lone_points;
pub mod node_selection;
pub mod octree;
pub mod octree_renderer;
pub mod palette;
mod plane;
pub mod renderer;
pub mod sample;
pub mod scene;
pub mod viewer;

pub use error::{RenderError, Result};
