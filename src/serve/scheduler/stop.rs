//! Why a run was stopped, and what its end is called then.

use crate::serve::job::Wish;
use crate::serve::job::retry_policy::End;

/// Why the engine stopped a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Stop {
    Wish(Wish),
    /// It is to go on later: the daemon stops, or everything is paused.
    Shutdown,
    /// It stood still.
    Stalled,
}

/// The end of a run that an operator stopped.
pub(super) fn wish_end(wish: Wish) -> End {
    match wish {
        Wish::Cancel => End::Cancelled,
        Wish::Pause => End::Paused,
    }
}
