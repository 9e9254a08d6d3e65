//! What the program is worth, measured: scenes and clouds converted by the
//! program itself, each time as a process of its own, so that time and memory are
//! those of the conversion and of nothing else.
//!
//! One command a person runs, `lodestone report`, comes through here; so does
//! the benchmark of conversions.

pub mod chart;
pub mod compare;
pub mod flip;
pub mod process;
pub mod sampling;
pub mod settings;
pub mod stability;
pub mod synth;
