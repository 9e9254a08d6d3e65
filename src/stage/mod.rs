//! The stages of a conversion: plain synchronous functions from one value to
//! the next, parallel inside. No SQLite, no HTTP, no async.

pub mod context;
pub mod options;
