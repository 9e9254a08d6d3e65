//! `lodestone serve`.

use super::Exit;

/// Watch folders and convert what is dropped into them.
#[derive(Debug, clap::Args)]
pub struct Arguments {}

pub fn run(_arguments: Arguments) -> Exit {
    Exit::Failed
}
