//! Why a run was stopped, and what its end is called then.

use crate::serve::job::ControlRequest;
use crate::serve::job::retry_policy::AttemptEnd;

/// Why the engine stopped a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum StopReason {
    Wish(ControlRequest),
    /// It is to go on later: the daemon stops, or everything is paused.
    Shutdown,
    /// It stood still.
    Stalled,
}

/// The end of a run that an operator stopped.
pub(super) fn wish_end(wish: ControlRequest) -> AttemptEnd {
    match wish {
        ControlRequest::Cancel => AttemptEnd::Cancelled,
        ControlRequest::Pause => AttemptEnd::Paused,
    }
}
