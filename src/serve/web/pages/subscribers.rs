//! Who is told what is new: the pages that are open.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use tokio::sync::broadcast;

/// Messages that a slow reader may be behind.
const BEHIND: usize = 32;

/// Who is told. Cheap to clone.
#[derive(Debug, Clone)]
pub struct Live {
    pub(super) sender: broadcast::Sender<Arc<str>>,
    pub(super) looking: Arc<AtomicBool>,
}

impl Default for Live {
    fn default() -> Live {
        Live { sender: broadcast::channel(BEHIND).0, looking: Arc::default() }
    }
}
