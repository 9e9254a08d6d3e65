//! `lodestone config`.

use super::exit::Exit;
use super::output::{self, failed};
use super::serve;

/// Print the configuration that `serve` would run with, as TOML.
#[derive(Debug, clap::Args)]
#[group(skip)] // the one of `serve`, flattened in, has the name already
pub struct Arguments {
    #[command(flatten)]
    pub(super) serve: serve::Arguments,
}

pub fn run(arguments: Arguments) -> Exit {
    let config = match arguments.serve.effective() {
        Ok(config) => config,
        Err(error) => {
            return output::misused(&error);
        }
    };
    match toml::to_string(&config.to_layer()) {
        Ok(text) => output::print(&text, Exit::Done),
        Err(error) => failed(&error),
    }
}
