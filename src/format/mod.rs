//! Bytes of other people's formats, read and written; no policy.

pub mod las;
pub mod potree;
