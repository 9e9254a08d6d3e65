//! What operators order while jobs run: of one of them, or of all.

use super::engine::Engine;
use super::stop::StopReason;
use crate::serve::queue::Result;

impl Engine {
    /// Step 2.
    pub(super) async fn pass_on_wishes(&mut self) -> Result<()> {
        for (job, wish) in self.tools.store.wishes().await? {
            if let Some(running) = self.running.get_mut(&job)
                && matches!(running.stop, None | Some(StopReason::Stalled))
            {
                tracing::info!(job, wish = wish.name(), "asked of a running job");
                running.stop = Some(StopReason::Wish(wish));
                running.pulse.stop();
                running.cancel.cancel();
            }
        }
        Ok(())
    }

    /// Step 2, where everything is paused: what runs goes on from there later, and
    /// its attempt does not count.
    pub(super) fn return_to_queue(&mut self) {
        for running in self.running.values_mut().filter(|running| running.stop.is_none()) {
            tracing::info!(job = running.job.id, "stopped, for everything is paused");
            running.stop = Some(StopReason::Shutdown);
            running.cancel.cancel();
        }
    }
}
