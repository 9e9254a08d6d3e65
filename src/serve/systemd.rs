//! What systemd is told, where it started the daemon.

use sd_notify::NotifyState;

/// Tells systemd of a change of state.
pub(super) fn tell_systemd(states: &[NotifyState]) {
    // Without systemd this does nothing.
    if let Err(error) = sd_notify::notify(states) {
        tracing::debug!(%error, "systemd was not told");
    }
}
