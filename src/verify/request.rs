//! What is to be verified, and how strictly.

use std::path::PathBuf;

/// What is to be verified.
#[derive(Debug, Clone)]
pub struct VerifyRequest {
    /// The octree's folder, or a COPC file.
    pub octree: PathBuf,
    /// The files that it was made of, folders of them, or lists (`@list`); none:
    /// the octree is checked on its own.
    pub against: Vec<PathBuf>,
    /// Whether they may be cut or damaged: then what can be read of them counts.
    pub damaged: bool,
    /// Bytes of memory that the comparison may take.
    pub memory_limit: u64,
    pub spacing: SpacingRule,
}

/// Whether the rule of sampling is a must.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
pub enum SpacingRule {
    /// A must for octrees that Lodestone made.
    #[default]
    Auto,
    /// A must.
    Require,
    /// Only told.
    Report,
}
