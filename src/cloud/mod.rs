//! The point cloud itself, as pure values: what a record holds, where it lies
//! on the integer lattice, which node it belongs to, how many there are where.
//!
//! Nothing here opens a file, starts a thread or reads a clock, and no float
//! decides where a point belongs (DESIGN.md, decision 1).

pub mod attribute;
pub mod census;
pub mod cube;
pub mod lattice;
pub mod moments;
pub mod mover;
pub mod naming;
pub mod node;
pub mod outliers;
pub mod plan;
pub mod record;
pub mod statistics;
