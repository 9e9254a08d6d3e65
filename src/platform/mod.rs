//! The machine, as parts that tests can make fail: files and locks, the clock, limits of
//! memory and processors, the allocator.

pub mod allocator;
pub mod clock;
pub mod disk;
pub mod limits;
