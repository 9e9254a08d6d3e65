//! Time is handed in, never fetched: whoever decides by the clock takes a
//! [`Clock`], so that a test can make it jump.

use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};
use std::time::{SystemTime, UNIX_EPOCH};

/// Milliseconds since 1970, UTC.
pub type Millis = i64;

#[derive(Clone, Debug, Default)]
pub enum Clock {
    /// The machine's own clock.
    #[default]
    System,
    /// A clock that a test sets by hand.
    Manual(Arc<AtomicI64>),
}

impl Clock {
    pub fn now(&self) -> Millis {
        match self {
            // A clock before 1970 is a broken clock; zero is then as good an
            // answer as any.
            Clock::System => {
                SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |d| d.as_millis() as Millis)
            }
            Clock::Manual(now) => now.load(Ordering::SeqCst),
        }
    }
}
