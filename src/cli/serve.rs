//! `lodestone serve`.

use std::path::PathBuf;
use std::sync::Arc;

use super::{Exit, failed};
use crate::config::{Config, ConfigError, Layer};
use crate::daemon;
use crate::engine::converter::Conduct;

/// Watch folders and convert what is dropped into them.
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// A TOML file of the settings below, with underscores for hyphens.
    #[arg(long, env = "LODESTONE_CONFIG", value_name = "FILE")]
    config: Option<PathBuf>,
    #[command(flatten)]
    layer: Layer,
}

impl Arguments {
    /// The flags and the environment over the file over the defaults, checked.
    pub(super) fn effective(self) -> Result<Config, ConfigError> {
        let file = self.config.as_deref().map(Layer::read).transpose()?.unwrap_or_default();
        Config::from_layer(self.layer.over(file))
    }
}

pub fn run(arguments: Arguments) -> Exit {
    let config = match arguments.effective() {
        Ok(config) => config,
        Err(error) => {
            failed(&error);
            return Exit::Usage;
        }
    };
    match daemon::run(config, Arc::new(Conduct)) {
        Ok(()) => Exit::Done,
        Err(error) => failed(&error),
    }
}
