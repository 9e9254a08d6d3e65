//! What an operator set for all jobs at once: whether new ones are started, and
//! orders to many jobs.

use sqlx::Row;

use super::claim::order_within;
use super::{Result, Store, StoreError, note};
use crate::serve::job::{Event, JobId};

/// Whether jobs are started.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum QueueMode {
    /// As they come.
    #[default]
    Run,
    /// No new ones; what runs goes on to its end.
    Drain,
    /// None; what runs goes back to the queue and goes on from there later.
    Pause,
}

impl QueueMode {
    pub const ALL: [QueueMode; 3] = [QueueMode::Run, QueueMode::Drain, QueueMode::Pause];

    pub fn name(self) -> &'static str {
        match self {
            QueueMode::Run => "run",
            QueueMode::Drain => "drain",
            QueueMode::Pause => "pause",
        }
    }

    pub fn parse(name: &str) -> Option<QueueMode> {
        QueueMode::ALL.into_iter().find(|mode| mode.name() == name)
    }
}

const MODE: &str = "mode";

/// Orders in one transaction: nobody waits long for the writer.
const BATCH: usize = 500;

impl Store {
    /// Whether jobs are started. It holds until it is set anew, also over a restart.
    pub async fn mode(&self) -> Result<QueueMode> {
        let value = self.setting(MODE).await?;
        Ok(value.as_deref().and_then(QueueMode::parse).unwrap_or_default())
    }

    pub async fn set_mode(&self, mode: QueueMode) -> Result<()> {
        self.set_setting(MODE, mode.name()).await
    }

    pub async fn setting(&self, key: &str) -> Result<Option<String>> {
        let row = sqlx::query("SELECT value FROM setting WHERE key = ?")
            .bind(key)
            .fetch_optional(&self.readers)
            .await?;
        Ok(row.map(|row| row.try_get("value")).transpose()?)
    }

    pub async fn set_setting(&self, key: &str, value: &str) -> Result<()> {
        sqlx::query(
            "INSERT INTO setting (key, value) VALUES (?, ?) ON CONFLICT (key) DO UPDATE SET value = excluded.value",
        )
        .bind(key)
        .bind(value)
        .execute(&self.writer)
        .await?;
        Ok(())
    }

    /// Gives the same order to many jobs; tells how many took it. Those to which it
    /// means nothing by now are passed over.
    pub async fn order_all(&self, jobs: &[JobId], event: Event, now: i64) -> Result<u64> {
        let mut taken = 0;
        for batch in jobs.chunks(BATCH) {
            let mut tx = self.begin().await?;
            for job in batch {
                match order_within(&mut tx, *job, event, now).await {
                    Ok(_) => taken += 1,
                    Err(StoreError::Illegal { .. } | StoreError::NoSuchJob(_)) => {}
                    Err(error) => return Err(error),
                }
            }
            tx.commit().await?;
        }
        Ok(taken)
    }

    /// Takes ended jobs that stand for no octree out of the list until something
    /// happens to them; tells how many.
    pub async fn dismiss(&self, jobs: &[JobId], now: i64) -> Result<u64> {
        let mut tx = self.begin().await?;
        let mut dismissed = 0;
        for job in jobs {
            let done = sqlx::query(
                "UPDATE job SET dismissed_at = ?, updated_at = ? WHERE id = ? AND dismissed_at IS NULL \
                 AND (state IN ('failed', 'quarantined', 'cancelled') \
                      OR (state = 'done' AND superseded_by IS NOT NULL))",
            )
            .bind(now)
            .bind(now)
            .bind(job)
            .execute(&mut *tx)
            .await?;
            if done.rows_affected() > 0 {
                note(&mut tx, *job, now, "dismissed", None).await?;
                dismissed += 1;
            }
        }
        tx.commit().await?;
        Ok(dismissed)
    }
}
