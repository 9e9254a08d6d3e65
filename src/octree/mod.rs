//! The octree, as pure values: what a record holds, where it is on the integer
//! lattice, which node it belongs to, the counting grid and the plan of chunks, one
//! chunk's local octree, the samples of coarse levels and their order.
//!
//! Nothing here opens a file, starts a thread or reads a clock, and no float
//! decides where a point belongs.

pub mod acquisition;
pub mod attribute;
pub mod attribute_names;
pub mod chunk_plan;
pub mod collapse;
pub mod color_average;
pub mod counting_grid;
pub mod cube;
pub mod lattice;
pub mod local_octree;
pub mod moments;
pub mod node;
pub mod node_limit;
pub mod node_order;
pub mod outliers;
pub mod record;
pub mod record_converter;
pub mod sampling;
pub mod standard_fields;
pub mod statistics;
