//! Pictures that are owed. The debt is written with the job's success, in one
//! transaction, and stands until there is a receipt, nothing to show, or no hope.
//!
//! An attempt is counted before it runs, so a picture that brings the daemon down
//! is not tried for ever. The count is the fence as well: the octree that is
//! published anew, and the order to draw again, begin it anew, and what an older
//! attempt says after that is not recorded.

use std::collections::HashMap;

use serde::Serialize;
use sqlx::sqlite::SqliteRow;
use sqlx::{Row, Sqlite, Transaction};

use super::{Result, Store, StoreError, must_stand, note};
use crate::serve::job::JobId;

/// How far a job's pictures are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Drawn {
    /// They are owed.
    Queued,
    Done,
    /// The octree has no points that could be seen.
    Nothing,
    /// Given up, until somebody asks for them again.
    Failed,
}

impl Drawn {
    pub const ALL: [Drawn; 4] = [Drawn::Queued, Drawn::Done, Drawn::Nothing, Drawn::Failed];

    pub fn name(self) -> &'static str {
        match self {
            Drawn::Queued => "queued",
            Drawn::Done => "done",
            Drawn::Nothing => "nothing",
            Drawn::Failed => "failed",
        }
    }
}

/// What the queue knows of a job's pictures.
#[derive(Debug, Clone, PartialEq)]
pub struct Preview {
    pub state: Drawn,
    pub attempts: u32,
    pub error: Option<String>,
    /// What there is, as `preview.json` says it.
    pub receipt: Option<serde_json::Value>,
    pub updated_at: i64,
}

/// Pictures that are to be made, and later one attempt at them.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PendingPreview {
    pub job: JobId,
    /// Of the octree.
    pub name: String,
    /// Those that were begun; of one that runs, its own is among them.
    pub attempts: u32,
    /// They may have brought the daemon down, and are drawn alone.
    pub suspect: bool,
}

/// How an attempt ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum PreviewOutcome {
    /// With the text of its `preview.json`.
    Done(String),
    Nothing(String),
    /// It may go better at this time.
    Later(String, i64),
    Failed(String),
    /// The daemon stopped in good order; the attempt does not count.
    Parked,
    /// There is no such octree any more.
    Gone(String),
}

impl Store {
    /// The next pictures to make, where some are due. What is to wait for longer
    /// than `longest_wait` was told so by a clock that has been set back since.
    /// Suspects only where there is nothing else at work.
    pub async fn preview_due(
        &self,
        now: i64,
        longest_wait: i64,
        suspects: bool,
    ) -> Result<Option<PendingPreview>> {
        let row = sqlx::query(
            "SELECT preview.job, job.name, preview.attempts, preview.suspect FROM preview CROSS JOIN job \
             ON job.id = preview.job \
             WHERE preview.state = 'queued' AND (preview.not_before <= ? OR preview.not_before > ?) \
             AND job.state = 'done' AND job.superseded_by IS NULL AND preview.suspect <= ? \
             ORDER BY preview.attempts, preview.job DESC LIMIT 1",
        )
        .bind(now)
        .bind(now.saturating_add(longest_wait))
        .bind(suspects)
        .fetch_optional(&self.readers)
        .await?;
        let due = |row: SqliteRow| {
            Ok(PendingPreview {
                job: row.try_get("job")?,
                name: row.try_get("name")?,
                attempts: row.try_get("attempts")?,
                suspect: row.try_get("suspect")?,
            })
        };
        row.map(due).transpose()
    }

    /// Counts an attempt, before anything is done. Should the daemon die over it,
    /// the next is not before `next`. Nothing is returned where it is not due.
    pub async fn begin_preview(
        &self,
        due: &PendingPreview,
        next: i64,
        now: i64,
    ) -> Result<Option<PendingPreview>> {
        let begun = sqlx::query(
            "UPDATE preview SET attempts = attempts + 1, not_before = ?, drawing = 1, updated_at = ? \
             WHERE job = ? AND state = 'queued' AND attempts = ?",
        )
        .bind(next)
        .bind(now)
        .bind(due.job)
        .bind(due.attempts)
        .execute(&self.writer)
        .await?;
        Ok((begun.rows_affected() == 1).then(|| PendingPreview { attempts: due.attempts + 1, ..due.clone() }))
    }

    /// Whether these pictures are still wanted of this attempt.
    pub async fn preview_stands(&self, due: &PendingPreview) -> Result<bool> {
        let row = sqlx::query("SELECT 1 FROM preview WHERE job = ? AND state = 'queued' AND attempts = ?")
            .bind(due.job)
            .bind(due.attempts)
            .fetch_optional(&self.readers)
            .await?;
        Ok(row.is_some())
    }

    /// Records the end of an attempt; tells whether it still counted.
    pub async fn settle_preview(&self, due: &PendingPreview, end: &PreviewOutcome, now: i64) -> Result<bool> {
        let (state, attempts, not_before, error, receipt) = match end {
            PreviewOutcome::Done(receipt) => (Drawn::Done, due.attempts, 0, None, Some(receipt)),
            PreviewOutcome::Nothing(why) => (Drawn::Nothing, due.attempts, 0, Some(why), None),
            PreviewOutcome::Later(why, at) => (Drawn::Queued, due.attempts, *at, Some(why), None),
            PreviewOutcome::Failed(why) => (Drawn::Failed, due.attempts, 0, Some(why), None),
            PreviewOutcome::Parked => (Drawn::Queued, due.attempts.saturating_sub(1), 0, None, None),
            PreviewOutcome::Gone(why) => return self.drop_preview(due, why, now).await,
        };
        let mut tx = self.begin().await?;
        sqlx::query("UPDATE preview SET drawing = 0 WHERE job = ?").bind(due.job).execute(&mut *tx).await?;
        let settled = sqlx::query(
            "UPDATE preview SET state = ?, suspect = 0, attempts = ?, not_before = ?, error = ?, \
             receipt = coalesce(?, receipt), updated_at = ? \
             WHERE job = ? AND state = 'queued' AND attempts = ?",
        )
        .bind(state.name())
        .bind(attempts)
        .bind(not_before)
        .bind(error)
        .bind(receipt)
        .bind(now)
        .bind(due.job)
        .bind(due.attempts)
        .execute(&mut *tx)
        .await?;
        if settled.rows_affected() == 0 {
            tx.commit().await?;
            return Ok(false);
        }
        let kind = match end {
            PreviewOutcome::Done(_) => Some("preview"),
            PreviewOutcome::Nothing(_) => Some("no preview"),
            PreviewOutcome::Later(..) | PreviewOutcome::Failed(_) => Some("preview failed"),
            PreviewOutcome::Parked | PreviewOutcome::Gone(_) => None,
        };
        if let Some(kind) = kind {
            note(&mut tx, due.job, now, kind, error.map(String::as_str)).await?;
        }
        tx.commit().await?;
        Ok(true)
    }

    /// Nothing is owed of an octree that is gone; made again, it is owed again.
    async fn drop_preview(&self, due: &PendingPreview, why: &str, now: i64) -> Result<bool> {
        let mut tx = self.begin().await?;
        let gone = sqlx::query("DELETE FROM preview WHERE job = ? AND state = 'queued' AND attempts = ?")
            .bind(due.job)
            .bind(due.attempts)
            .execute(&mut *tx)
            .await?;
        if gone.rows_affected() == 0 {
            return Ok(false);
        }
        note(&mut tx, due.job, now, "no preview", Some(why)).await?;
        tx.commit().await?;
        Ok(true)
    }

    /// An operator's order to make a job's pictures, be it once more.
    pub async fn order_preview(&self, job: JobId, now: i64) -> Result<()> {
        let mut tx = self.begin().await?;
        must_stand(&mut tx, job, "preview").await?;
        queue(&mut tx, job, now).await?;
        note(&mut tx, job, now, "preview asked", Some("by order")).await?;
        Ok(tx.commit().await?)
    }

    /// What is known of the pictures of these jobs.
    pub async fn previews(&self, jobs: &[JobId]) -> Result<HashMap<JobId, Preview>> {
        let jobs = serde_json::to_string(jobs).unwrap_or_default();
        let rows = sqlx::query("SELECT * FROM preview WHERE job IN (SELECT value FROM json_each(?))")
            .bind(jobs)
            .fetch_all(&self.readers)
            .await?;
        rows.iter().map(|row| Ok((row.try_get("job")?, preview(row)?))).collect()
    }

    /// How many octrees wait for their pictures.
    pub async fn previews_waiting(&self) -> Result<i64> {
        let row = sqlx::query(
            "SELECT count(*) AS waiting FROM preview CROSS JOIN job ON job.id = preview.job \
             WHERE preview.state = 'queued' AND job.state = 'done' AND job.superseded_by IS NULL",
        )
        .fetch_one(&self.readers)
        .await?;
        Ok(row.try_get("waiting")?)
    }
}

/// How many pictures were being drawn when the daemon died.
pub(super) async fn interrupted(tx: &mut Transaction<'static, Sqlite>) -> Result<usize> {
    let row =
        sqlx::query("SELECT count(*) AS interrupted FROM preview WHERE drawing = 1 AND state = 'queued'")
            .fetch_one(&mut **tx)
            .await?;
    Ok(row.try_get::<i64, _>("interrupted")? as usize)
}

/// They are drawn alone from now on. Where they were not, their attempt is taken
/// back: it says nothing about them.
pub(super) async fn suspect_interrupted(
    tx: &mut Transaction<'static, Sqlite>,
    alone: bool,
    now: i64,
) -> Result<()> {
    sqlx::query(
        "UPDATE preview SET drawing = 0, suspect = 1, updated_at = ?1, \
         attempts = CASE WHEN ?2 THEN attempts ELSE max(attempts - 1, 0) END, \
         not_before = CASE WHEN ?2 THEN not_before ELSE 0 END \
         WHERE drawing = 1 AND state = 'queued'",
    )
    .bind(now)
    .bind(alone)
    .execute(&mut **tx)
    .await?;
    Ok(())
}

/// Part of a job's success: its pictures are owed, and nothing is any more of the
/// octrees that it replaced.
pub(super) async fn owe(tx: &mut Transaction<'static, Sqlite>, job: JobId, now: i64) -> Result<()> {
    sqlx::query("DELETE FROM preview WHERE job = ?1 OR job IN (SELECT id FROM job WHERE superseded_by = ?1)")
        .bind(job)
        .execute(&mut **tx)
        .await?;
    queue(tx, job, now).await
}

/// What was drawn of the same octree before is there until it is replaced.
async fn queue(tx: &mut Transaction<'static, Sqlite>, job: JobId, now: i64) -> Result<()> {
    sqlx::query(
        "INSERT INTO preview (job, state, updated_at) VALUES (?, 'queued', ?) ON CONFLICT (job) DO UPDATE \
         SET state = 'queued', attempts = 0, not_before = 0, error = NULL, updated_at = excluded.updated_at",
    )
    .bind(job)
    .bind(now)
    .execute(&mut **tx)
    .await?;
    Ok(())
}

fn preview(row: &SqliteRow) -> Result<Preview> {
    let state: String = row.try_get("state")?;
    let receipt: Option<String> = row.try_get("receipt")?;
    Ok(Preview {
        state: Drawn::ALL
            .into_iter()
            .find(|drawn| drawn.name() == state)
            .ok_or(StoreError::Unknown { what: "a preview's state", value: state })?,
        attempts: row.try_get("attempts")?,
        error: row.try_get("error")?,
        receipt: receipt.and_then(|text| serde_json::from_str(&text).ok()),
        updated_at: row.try_get("updated_at")?,
    })
}
