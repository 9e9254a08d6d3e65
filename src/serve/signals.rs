//! The first SIGINT, SIGTERM or SIGHUP stops in good order, the second at once. Neither
//! loses anything: what a crash would keep, leaving at once keeps too. SIGHUP is left
//! alone where it was ignored from the start, as by `nohup`.

use crate::convert::context::Cancel;
use tokio::signal::unix::{Signal, SignalKind, signal};
use tokio_util::sync::CancellationToken;

/// Exit code of a process that a signal ended, as shells count it (128 + SIGINT).
const AT_ONCE: i32 = 130;

/// Cancels a synchronous piece of work when the process is told to end. Where
/// signals cannot be listened to, they end the process as they always do.
pub fn cancel_on_signal(cancel: &Cancel) {
    let cancel = cancel.clone();
    // The thread lives as long as the process; it has nothing to lose.
    std::thread::spawn(move || {
        let Ok(runtime) = tokio::runtime::Builder::new_current_thread().enable_io().build() else { return };
        runtime.block_on(async {
            let stop = CancellationToken::new();
            if listen(stop.clone()).is_ok() {
                stop.cancelled().await;
                cancel.cancel();
                std::future::pending::<()>().await;
            }
        });
    });
}

/// Cancels `stop` at the first signal.
pub(super) fn listen(stop: CancellationToken) -> std::io::Result<()> {
    let (mut interrupt, mut terminate) = (signal(SignalKind::interrupt())?, signal(SignalKind::terminate())?);
    let mut hang_up = if is_hang_up_ignored() { None } else { Some(signal(SignalKind::hangup())?) };
    tokio::spawn(async move {
        loop {
            tokio::select! {
                _ = interrupt.recv() => {}
                _ = terminate.recv() => {}
                () = received(&mut hang_up) => {}
            }
            if stop.is_cancelled() {
                tracing::warn!("leaving at once");
                leave();
            }
            tracing::info!("stopping; once more to leave at once");
            stop.cancel();
        }
    });
    Ok(())
}

async fn received(signal: &mut Option<Signal>) {
    match signal {
        Some(signal) => {
            signal.recv().await;
        }
        None => std::future::pending().await,
    }
}

/// Whether whoever started us had us ignore SIGHUP.
fn is_hang_up_ignored() -> bool {
    std::fs::read_to_string("/proc/self/status").is_ok_and(|status| ignores_hang_up(&status))
}

/// Signals that are ignored stand in a mask, SIGHUP as its lowest bit.
fn ignores_hang_up(status: &str) -> bool {
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).is_some_and(|mask| mask & 1 == 1)
}

#[expect(
    clippy::exit,
    reason = "the second signal says: at once; a crash loses nothing, so neither does this"
)]
fn leave() -> ! {
    std::process::exit(AT_ONCE)
}

#[cfg(test)]
mod tests {
    use super::ignores_hang_up;

    #[test]
    fn an_ignored_signal_is_read_from_the_mask() {
        assert!(ignores_hang_up("Name:\tx\nSigIgn:\t0000000000000001\n"));
        assert!(ignores_hang_up("SigIgn:\t0000000000001003\n"));
        assert!(!ignores_hang_up("SigIgn:\t0000000000001002\n") && !ignores_hang_up("Name: x\n"));
    }
}
