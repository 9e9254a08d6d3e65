//! The engine: decides what is done next, and conducts it.

pub mod conduct;
