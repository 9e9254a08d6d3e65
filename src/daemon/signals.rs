//! The first SIGINT or SIGTERM stops in good order, the second at once. Neither
//! loses anything: what a crash would keep, leaving at once keeps too.

use crate::stage::context::Cancel;
use tokio::signal::unix::{SignalKind, signal};
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
    tokio::spawn(async move {
        loop {
            tokio::select! {
                _ = interrupt.recv() => {}
                _ = terminate.recv() => {}
            }
            if stop.is_cancelled() {
                tracing::warn!("leaving at once");
                #[expect(clippy::exit, reason = "asked for twice: at once is what is meant")]
                std::process::exit(AT_ONCE);
            }
            tracing::info!("stopping; once more to leave at once");
            stop.cancel();
        }
    });
    Ok(())
}
