//! The engine works the queue. [`Engine::tick`] is all it does, as numbered
//! steps; [`enqueue`] fills the queue from what the watcher found.
//!
//! A conversion runs on a thread of its own, for it is synchronous and takes as
//! long as it takes; the engine only starts it, watches its progress, and records
//! its end. Whatever a conversion does, be it a panic, the engine goes on.

pub mod cleanup;
pub mod converter;
mod engine;
pub mod enqueue;
mod finish_run;
mod folders;
mod follow_ups;
mod hook;
mod orders;
mod preflight;
mod preview;
mod publish;
mod sources;
mod stall_detection;
mod standstill;
mod starting;
mod stop;
mod tick;
mod tools;
mod verification;
mod virtual_cloud;
mod worker;

pub use engine::{Engine, TickSummary};
pub use tools::EngineContext;
