//! Lodestone watches folders for LAS/LAZ point clouds and turns each into a
//! level-of-detail octree that existing viewers read, exact to the last point.
//!
//! # The floor plan
//!
//! The modules below stand in import order: a room imports only from rooms
//! above it, and `tests/cases/floor_plan/` reads every `use crate::` to hold them
//! to this. The way of a point cloud through the house:
//!
//! ```text
//! watch ──▶ store ──▶ engine ──▶ survey ──▶ distribute ──▶ index ──▶ merge ──▶ publish
//! ```
//!
//! A stage is a plain synchronous function from one value to the next, parallel
//! inside; it knows nothing of SQLite, HTTP or async. The engine conducts.

// An error is told to its owner and no panic reaches the daemon; what cannot
// happen says why not, by `expect` or `unreachable!`. Here and not in
// Cargo.toml, because integration tests may do as they like.
#![warn(clippy::unwrap_used, clippy::panic)]

// What people write for values.
pub mod words;

// Pure rooms: no files, no clock, no threads of their own.
pub mod cloud;
pub mod job;
pub mod lod;

// The ground: what touches the machine, so that tests can make it fail.
pub mod clock;
pub mod disk;
pub mod log;
pub mod memory;
pub mod metrics;

// Bytes of other people's formats.
pub mod format;

// Pictures of what came out.
pub mod render;

// Work on whole clouds.
pub mod export;
pub mod stage;
pub mod synth;
pub mod verify;

// What the program is worth: conversions of scenes as processes of their own.
pub mod measure;

// The durable half. Empty lines keep rustfmt from sorting it by the alphabet.
pub mod config;

pub mod store;

pub mod watch;

pub mod engine;

pub mod web;

// What a person touches.
pub mod daemon;

pub mod cli;
