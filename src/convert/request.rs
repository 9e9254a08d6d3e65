//! What is to be converted.

use std::collections::HashMap;
use std::path::PathBuf;

use super::options::Options;

/// What is to be converted into which folder.
#[derive(Debug, Clone)]
pub struct ConversionRequest {
    /// Files, folders or `@list` files.
    pub inputs: Vec<PathBuf>,
    /// The octree's folder; made, or replaced in one step.
    pub output: PathBuf,
    pub overwrite: bool,
    /// Whether receipts and intermediate files stay when all went well, because
    /// the caller has yet to note that; asked again, it gets the same outcome.
    pub keep_scratch: bool,
    pub options: Options,
    /// BLAKE3 of the inputs' content, by path, for the report; of those that
    /// somebody has read for it anyhow.
    pub hashes: HashMap<PathBuf, String>,
}
