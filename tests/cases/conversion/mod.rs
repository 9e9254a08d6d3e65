//! Conversions as a whole: what comes out is what went in, whatever happens on the way.

mod convert;
mod damaged;
mod disk_faults;
mod evenness;
mod lod_color;
mod malformed;
mod real_clouds;
mod resume;
mod set_aside;
mod source_changes;
