//! Ctrl-C and a polite kill stop the work in hand: the first asks for it, so
//! that nothing half-made stays behind, the second leaves at once.

use crate::stage::context::Cancel;

/// The exit code of a program that Ctrl-C ended.
const INTERRUPTED: i32 = 130;

/// Cancels the work when the process is told to end.
pub fn cancel_on_signal(cancel: &Cancel) {
    let cancel = cancel.clone();
    // The thread lives as long as the process; it has nothing to lose.
    std::thread::spawn(move || {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_io().build();
        let Ok(runtime) = runtime else { return };
        runtime.block_on(async {
            if wait().await {
                eprintln!("lodestone: stopping (once more to leave at once)");
                cancel.cancel();
                if wait().await {
                    std::process::exit(INTERRUPTED);
                }
            }
        });
    });
}

/// Waits for a signal; false where none can be waited for.
async fn wait() -> bool {
    use tokio::signal::unix::{SignalKind, signal};
    let (Ok(mut interrupt), Ok(mut terminate)) =
        (signal(SignalKind::interrupt()), signal(SignalKind::terminate()))
    else {
        return false;
    };
    tokio::select! {
        _ = interrupt.recv() => true,
        _ = terminate.recv() => true,
    }
}
