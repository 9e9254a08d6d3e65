//! The first process of a container: it starts the daemon as its child, hands
//! signals on, and reaps what hooks leave behind, which nobody else would.

use std::process::Command;

use rustix::process::{Pid, Signal, WaitOptions, WaitStatus, kill_process, wait};
use tokio::signal::unix::{SignalKind, signal};

/// Whether this process is the first of its namespace, to which all orphans fall.
pub fn is_needed() -> bool {
    std::process::id() == 1
}

/// Runs this program again, with the same arguments, as a child, until that ends;
/// returns its exit code.
///
/// # Errors
///
/// Where the child cannot be started, or signals not be listened to.
pub fn run() -> std::io::Result<u8> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_io().build()?;
    runtime.block_on(async {
        // Before there is a child whose end could be missed.
        let mut child_ended = signal(SignalKind::child())?;
        let mut interrupt = signal(SignalKind::interrupt())?;
        let mut terminate = signal(SignalKind::terminate())?;
        let mut hang_up = signal(SignalKind::hangup())?;
        let child = Command::new(std::env::current_exe()?).args(std::env::args_os().skip(1)).spawn()?;
        let Some(child) = i32::try_from(child.id()).ok().and_then(Pid::from_raw) else {
            return Err(std::io::Error::other("the child has no number"));
        };
        loop {
            let order = tokio::select! {
                _ = child_ended.recv() => None,
                _ = interrupt.recv() => Some(Signal::INT),
                _ = terminate.recv() => Some(Signal::TERM),
                _ = hang_up.recv() => Some(Signal::HUP),
            };
            if let Some(order) = order {
                // It may have ended just now.
                let _ = kill_process(child, order);
            }
            while let Ok(Some((pid, status))) = wait(WaitOptions::NOHANG) {
                if pid == child {
                    return Ok(code(status));
                }
            }
        }
    })
}

/// As shells count it: 128 and the signal's number, where a signal ended it.
fn code(status: WaitStatus) -> u8 {
    let code = status.exit_status().or_else(|| status.terminating_signal().map(|signal| 128 + signal));
    code.and_then(|code| u8::try_from(code).ok()).unwrap_or(1)
}
