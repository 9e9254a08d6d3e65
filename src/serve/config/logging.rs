//! How the log is written.

use serde::Serialize;

use crate::deserialize_choice;

/// For whom the log is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum LogFormat {
    /// For people: in colors on a terminal
    #[default]
    Auto,
    /// For people, without colors
    Plain,
    /// A JSON object a line
    Json,
}

deserialize_choice!(LogFormat);

/// What is logged where nothing is said.
pub const DEFAULT_FILTER: &str = "info";
