//! Has the engine tick: at every bell, when something is due, and every
//! second anyway.

use std::time::Duration;

use sd_notify::NotifyState;
use tokio_util::sync::CancellationToken;

use super::systemd::tell_systemd;
use crate::serve::scheduler::Engine;
use crate::serve::web::AppState;

const LONGEST_PAUSE: Duration = Duration::from_millis(1000);

pub(super) async fn run(engine: &mut Engine, shared: &AppState, stop: &CancellationToken) {
    while !stop.is_cancelled() {
        // Not within a select: a tick that is dropped half-way may or may not
        // have taken effect.
        let ticked = engine.tick().await;
        let now = shared.clock.now();
        let mut pause = LONGEST_PAUSE;
        let error = match ticked {
            Ok(outcome) => {
                let due = outcome.due.map(|due| (due - now).max(1) as u64);
                pause = due.map_or(pause, |due| pause.min(Duration::from_millis(due)));
                None
            }
            Err(error) => {
                shared.metrics.queue_errors.inc();
                tracing::error!(%error, "the queue could not be worked; trying again");
                Some(error.to_string())
            }
        };
        shared.update_health(|health| {
            health.last_tick = now;
            health.queue_error = error;
        });
        tell_systemd(&[NotifyState::Watchdog]);
        tokio::select! {
            () = shared.bell.notified() => {}
            () = tokio::time::sleep(pause) => {}
            () = stop.cancelled() => {}
        }
    }
}
