//! The stages of a conversion: plain synchronous functions from one value to
//! the next, parallel inside. No SQLite, no HTTP, no async. Stages do not know
//! each other's insides; they hand over values, and `convert::run` puts them
//! in a row.

pub mod borders;
pub mod checkpoint;
mod color_averages;
pub mod context;
pub mod copc;
pub mod counting;
pub mod distribute;
pub mod error;
pub mod folder_names;
pub mod formats;
mod free_space;
mod gps_times;
pub mod guards;
pub mod index;
mod memory_estimate;
pub mod merge;
pub mod node_writer;
mod notes;
pub mod octree_writer;
pub mod options;
pub mod outcome;
mod pending_root;
pub mod preview;
pub mod publish;
mod reference;
pub mod report;
pub mod request;
pub mod run;
pub mod set_aside;
pub mod staging;
pub mod survey;
pub mod values;
pub mod workers;
