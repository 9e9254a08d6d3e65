//! Figures of all jobs, as every list tells them. Counting a hundred thousand jobs takes
//! tens of milliseconds, and many pages may be open: so it is done once for all of them,
//! only when something happened, and never for more than a share of the time.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use tokio::sync::Mutex;

use crate::platform::clock::Millis;
use crate::serve::queue::{Result, Shown, Store};

/// Hours of the small chart.
pub(super) const HOURS: i64 = 24;
/// In milliseconds.
pub(super) const HOUR: Millis = 3_600_000;

/// Counting is not begun again for so many times as long as it took.
const PAUSE: u32 = 200;
const LONGEST_PAUSE: Duration = Duration::from_secs(10);
/// What leaves no line in a history, as the next hour, is seen this late.
const LONGEST: Duration = Duration::from_secs(60);

/// Figures of all jobs.
#[derive(Debug, Clone, Default)]
pub(super) struct JobTotals {
    /// How many jobs are shown in each state.
    pub counts: Vec<(Shown, i64)>,
    /// Jobs that were done, and their points, by hours since 1970.
    pub hours: Vec<(i64, i64, i64)>,
}

#[derive(Debug, Clone)]
struct CachedFigures {
    /// The latest line of history that they know of.
    event: i64,
    at: Instant,
    /// Not to be counted anew before.
    rests_until: Instant,
    totals: JobTotals,
}

/// The latest figures, for all pages. Cheap to clone.
#[derive(Debug, Clone, Default)]
pub struct Figures {
    kept: Arc<Mutex<Option<CachedFigures>>>,
    /// A page was told figures from before the latest news.
    is_behind: Arc<AtomicBool>,
}

impl Figures {
    pub(super) async fn get(&self, store: &Store, now: Millis) -> Result<JobTotals> {
        // Held meanwhile: one asks, the others get its answer.
        let mut kept = self.kept.lock().await;
        // Before they are counted: what happens in between is counted once more.
        let event = store.latest_event().await?;
        let start = Instant::now();
        if let Some(kept) = &*kept {
            let is_true = kept.event == event && start - kept.at < LONGEST;
            if is_true || start < kept.rests_until {
                if !is_true {
                    self.is_behind.store(true, Ordering::Relaxed);
                }
                return Ok(kept.totals.clone());
            }
        }
        let totals = JobTotals {
            counts: store.shown_counts().await?,
            hours: store.done_by_hour(now - HOURS * HOUR).await?,
        };
        let rests_until = start + (start.elapsed() * PAUSE).min(LONGEST_PAUSE);
        *kept = Some(CachedFigures { event, at: start, rests_until, totals: totals.clone() });
        Ok(totals)
    }

    /// To be called after an order: who gave it looks at what came of it.
    pub(super) async fn forget(&self) {
        *self.kept.lock().await = None;
    }

    /// Whether pages show figures of before, and newer ones are to be had by now; told
    /// once. Without it they would stay on a page on which nothing happens any more.
    pub(super) async fn catch_up(&self) -> bool {
        if !self.is_behind.load(Ordering::Relaxed) {
            return false;
        }
        let rests = self.kept.lock().await.as_ref().is_some_and(|kept| Instant::now() < kept.rests_until);
        !rests && self.is_behind.swap(false, Ordering::Relaxed)
    }
}
