//! Lodestone watches folders for LAS/LAZ point clouds and turns each into a
//! level-of-detail octree that existing viewers read, exact to the last point.
//!
//! # The floor plan
//!
//! The modules below stand in import order: a module imports only from modules
//! above it, and `tests/cases/floor_plan/` reads every path to hold them to this.
//! The way of a point cloud through them:
//!
//! ```text
//! serve: watch ──▶ queue ──▶ scheduler ──▶ convert: survey ──▶ distribute ──▶ index ──▶ merge ──▶ publish
//! ```
//!
//! A stage is a plain synchronous function from one value to the next, parallel
//! inside; it knows nothing of SQLite, HTTP or async. The scheduler runs jobs.

// An error is told to its owner and no panic reaches the daemon; what cannot
// happen says why not, by `expect` or `unreachable!`. Here and not in
// Cargo.toml, because integration tests may do as they like.
#![warn(clippy::unwrap_used, clippy::panic)]

// Values as people write them, numbers and text as people read them.
pub mod words;

// Pure: no files, no clock, no threads.
pub mod octree;

// The machine.
pub mod platform;

// Other people's file formats.
pub mod format;

// Pictures of octrees.
pub mod render;

// One conversion.
pub mod convert;

// What is done with its files, and what checks them.
pub mod export;
pub mod verify;

// The laboratory: synthetic clouds, measurements, charts.
pub mod lab;

// The daemon.
pub mod serve;

// What a person touches.
pub mod cli;
