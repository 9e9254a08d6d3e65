//! `lodestone convert`.

use super::Exit;

/// Convert LAS/LAZ files or folders into one Potree 2.0 octree.
#[derive(Debug, clap::Args)]
pub struct Arguments {}

pub fn run(_arguments: Arguments) -> Exit {
    Exit::Failed
}
