//! `lodestone info`.

use super::Exit;

/// Describe an octree or a LAS/LAZ file.
#[derive(Debug, clap::Args)]
pub struct Arguments {}

pub fn run(_arguments: Arguments) -> Exit {
    Exit::Failed
}
