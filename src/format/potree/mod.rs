//! Potree 2.0 octrees: metadata.json, hierarchy.bin, octree.bin, as FORMATS.md
//! gives them and as the viewers' loaders read them.
//!
//! Here live the bytes, both ways. What goes into a node, how points are
//! sampled and whether an octree is right is decided elsewhere.

pub mod encoding;
mod error;
pub mod files;
pub mod hierarchy;
mod json;
pub mod metadata;
pub mod morton;
pub mod name;

pub use encoding::{decode_node, encode_brotli};
pub use error::{PotreeError, Result};
pub use hierarchy::{Hierarchy, Node, Proxy, read_chunk, read_hierarchy, write_hierarchy};
pub use metadata::{Generator, Metadata, MetadataAttribute, PotreeEncoding, ScalarKind, attribute_entry};
pub use name::NodeName;

/// The names of an octree's three files.
pub const METADATA: &str = "metadata.json";
pub const HIERARCHY: &str = "hierarchy.bin";
pub const OCTREE: &str = "octree.bin";
