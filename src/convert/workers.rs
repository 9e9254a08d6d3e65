//! Workers that take units in order. Each takes the lowest unit that nobody has
//! taken yet, so files are read front to back and whoever waits for an earlier
//! unit waits for one that is already being worked on.

use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use super::context::Cancel;
use super::error::{Result, StageError};

/// Keeps the first failure. Whoever waited for one that failed only gives up, and
/// may be heard first: that is no failure of its own.
fn keep(failure: &mut Option<StageError>, error: StageError) {
    if !matches!(failure, Some(kept) if !matches!(kept, StageError::Cancelled)) {
        *failure = Some(error);
    }
}

/// Runs `work` for every unit below `units` on `threads` threads of the current
/// rayon pool, each with a state of its own. Stops at the first error, or when
/// cancelled.
pub fn in_order<S>(
    threads: usize,
    units: usize,
    cancel: &Cancel,
    start: impl Fn() -> S + Sync,
    work: impl Fn(&mut S, usize) -> Result<()> + Sync,
) -> Result<()> {
    let next = AtomicUsize::new(0);
    let stop = AtomicBool::new(false);
    let failure = Mutex::new(None);
    let run = || {
        let mut state = start();
        while !stop.load(Ordering::Relaxed) {
            let unit = next.fetch_add(1, Ordering::Relaxed);
            if unit >= units {
                break;
            }
            let outcome =
                if cancel.is_cancelled() { Err(StageError::Cancelled) } else { work(&mut state, unit) };
            if let Err(error) = outcome {
                stop.store(true, Ordering::Relaxed);
                let mut failure = failure.lock().unwrap_or_else(|e| e.into_inner());
                keep(&mut failure, error);
            }
        }
    };
    rayon::scope(|scope| {
        for _ in 0..threads.min(units) {
            scope.spawn(|_| run());
        }
    });
    match failure.into_inner().unwrap_or_else(|e| e.into_inner()) {
        Some(error) => Err(error),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failure_is_told_and_not_that_others_gave_up() {
        let lost = || StageError::Inconsistent("lost".into());
        let late = || StageError::Inconsistent("late".into());
        for order in [[StageError::Cancelled, lost(), late()], [lost(), StageError::Cancelled, late()]] {
            let mut failure = None;
            order.into_iter().for_each(|error| keep(&mut failure, error));
            assert!(
                matches!(&failure, Some(StageError::Inconsistent(what)) if what == "lost"),
                "{failure:?}"
            );
        }
        let mut failure = None;
        keep(&mut failure, StageError::Cancelled);
        assert!(matches!(failure, Some(StageError::Cancelled)));
    }
}
