//! `lodestone serve`.

use std::path::PathBuf;
use std::sync::Arc;

use super::exit::Exit;
use super::output::{self, failed};
use crate::serve;
use crate::serve::config::logging::LogFormat;
use crate::serve::config::{Config, ConfigError, Layer};
use crate::serve::scheduler::converter::Conduct;

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
        let flags = self.layer.split_watched(std::env::var_os("LODESTONE_WATCH").as_deref());
        Config::from_layer(flags.over(file))
    }

    /// What to log, by the flags of all commands, and where they are silent by the
    /// file. One that cannot be read is told of once its configuration is needed.
    pub(super) fn logging(
        &mut self,
        log: Option<String>,
        format: Option<LogFormat>,
    ) -> (Option<String>, Option<LogFormat>) {
        let flags = Layer { log, log_format: format, ..Layer::default() };
        let file = self.config.as_deref().and_then(|path| Layer::read(path).ok()).unwrap_or_default();
        let Layer { log, log_format, .. } = flags.over(file);
        (self.layer.log, self.layer.log_format) = (log.clone(), log_format);
        (log, log_format)
    }
}

pub fn run(arguments: Arguments) -> Exit {
    let config = match arguments.effective() {
        Ok(config) => config,
        Err(error) => {
            return output::misused(&error);
        }
    };
    match serve::run(config, Arc::new(Conduct)) {
        Ok(()) => Exit::Done,
        Err(error) => failed(&error),
    }
}
