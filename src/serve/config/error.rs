//! What is wrong with a configuration, by the names that its keys have everywhere.

use std::path::PathBuf;

#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    #[error("could not read the configuration {}: {source}", path.display())]
    Read {
        path: PathBuf,
        #[source]
        source: std::io::Error,
    },
    #[error("the configuration {} is wrong: {message}", path.display())]
    Parse { path: PathBuf, message: String },
    #[error("`{key}` (flag --{}, environment LODESTONE_{}): {message}", key.replace('_', "-"), key.to_uppercase())]
    Value { key: &'static str, message: String },
}

/// Something is wrong with a key.
pub(super) fn wrong(key: &'static str, message: impl Into<String>) -> ConfigError {
    ConfigError::Value { key, message: message.into() }
}
