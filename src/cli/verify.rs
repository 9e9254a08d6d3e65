//! `lodestone verify`.

use super::Exit;

/// Check an octree, alone or against its inputs.
#[derive(Debug, clap::Args)]
pub struct Arguments {}

pub fn run(_arguments: Arguments) -> Exit {
    Exit::Failed
}
