//! How a command ends.

/// How a command ended; the numbers are what scripts rely on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Exit {
    Done = 0,
    Failed = 1,
    Usage = 2,
    /// Done, but points were set aside, or are missing from damaged inputs.
    SetAside = 3,
}
