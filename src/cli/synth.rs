//! `lodestone synth`.

use super::Exit;

/// Make a synthetic cloud.
#[derive(Debug, clap::Args)]
pub struct Arguments {}

pub fn run(_arguments: Arguments) -> Exit {
    Exit::Failed
}
