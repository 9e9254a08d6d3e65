//! The integration tests: conversions, the daemon, its pages and readers, and what
//! users, operators and attackers broke. One binary, one module for each area.
//!
//! Files that cannot be made here come from the folder that `LODESTONE_CASES`
//! names; continuous integration sets it. Without it those tests pass by not
//! running, and say so.

#[path = "../common/mod.rs"]
mod common;
#[path = "../daemon_support/mod.rs"]
mod daemon_support;
#[path = "../engine_support/mod.rs"]
mod engine_support;

mod attacks;
mod conversion;
mod copc;
mod copc_readers;
mod daemon;
mod deploy;
mod drawing;
mod floor_plan;
mod formats;
mod inputs;
mod kernels;
mod laz;
mod messages;
mod needs;
mod page;
mod pictures;
mod report;
mod served;
mod sources;
mod view;
mod viewer;

use std::path::PathBuf;

/// The folder of inputs that failed once, where there is one.
#[allow(dead_code, reason = "modules are filled one after the other")]
fn cases() -> Option<PathBuf> {
    let folder = std::env::var_os("LODESTONE_CASES").map(PathBuf::from);
    if folder.is_none() {
        eprintln!("LODESTONE_CASES names no folder: its files are left out");
    }
    folder
}
