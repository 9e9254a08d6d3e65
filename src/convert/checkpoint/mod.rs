//! Checkpoints of an out-of-core conversion: a journal of receipts beside the data that
//! they vouch for.

pub mod journal;
pub mod receipt;
pub mod scratch;
