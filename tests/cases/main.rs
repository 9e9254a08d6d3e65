//! Faults that users, operators and attackers found, each with its right value.
//! One binary, one module for each area.
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
mod formats;
mod inputs;
mod laz;
mod messages;
mod page;
mod served;
mod sources;

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
