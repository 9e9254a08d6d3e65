//! The engine and the daemon as a whole: queue, folders, crashes, pictures.

mod control;
mod disk_full;
mod events;
mod many;
mod pending_previews;
mod previews;
mod prometheus;
mod queue;
mod resume;
mod serve;
mod slow_copy;
mod soak;
mod stalls;
