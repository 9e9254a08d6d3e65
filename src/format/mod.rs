//! Bytes of other people's formats, read and written; no policy.

pub mod copc;
pub mod crs;
pub mod finished;
pub mod inputs;
pub mod las;
pub mod laz;
pub mod potree;
