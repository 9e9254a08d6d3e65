//! The stages of a conversion: plain synchronous functions from one value to
//! the next, parallel inside. No SQLite, no HTTP, no async. Stages do not know
//! each other's insides; they hand over values, and `engine::conduct` puts them
//! in a row.

mod averages;
pub mod context;
pub mod copc;
pub mod counting;
mod crowd;
pub mod damage;
pub mod distribute;
pub mod error;
pub mod formats;
mod gps_times;
pub mod halos;
pub mod index;
pub mod journal;
pub mod machine;
pub mod merge;
pub mod nodes;
pub mod options;
pub mod output;
pub mod preview;
pub mod publish;
pub mod receipt;
mod reference;
pub mod region;
pub mod scratch;
pub mod set_aside;
pub mod staging;
pub mod survey;
mod twins;
pub mod workers;
