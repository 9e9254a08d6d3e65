//! Why nothing could be verified.

use crate::format::copc::CopcError;
use crate::format::inputs::InputsError;
use crate::format::las::LasError;
use crate::format::potree::PotreeError;

/// Why nothing could be verified. What is wrong with the octree is in the
/// report.
#[derive(Debug, thiserror::Error)]
pub enum VerifyError {
    #[error(transparent)]
    Octree(#[from] PotreeError),
    #[error(transparent)]
    Las(#[from] LasError),
    #[error(transparent)]
    Inputs(#[from] InputsError),
    #[error(transparent)]
    Copc(#[from] CopcError),
}
