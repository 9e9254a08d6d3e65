//! Verifications that operators ordered, and what they found. An attempt is counted
//! before it runs, so one that brings the daemon down is not begun for ever.

use serde::Serialize;
use sqlx::Row;

use super::{Result, Store, StoreError, must_stand, note, row};
use crate::serve::job::{Job, JobId};

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Verified {
    Queued,
    Done,
    Failed,
}

/// What is known of an octree's verification. Times are milliseconds since 1970.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Verification {
    pub state: Verified,
    pub asked_at: i64,
    pub ended_at: Option<i64>,
    /// Why nothing could be verified.
    pub error: Option<String>,
    /// What was found, as `lodestone verify --json` tells it.
    pub report: Option<serde_json::Value>,
}

impl Store {
    /// Orders a verification of a job's octree, be it once more.
    pub async fn order_verification(&self, job: JobId, now: i64) -> Result<()> {
        let mut tx = self.begin().await?;
        must_stand(&mut tx, job, "verify").await?;
        sqlx::query(
            "INSERT INTO verification (job, state, asked_at) VALUES (?1, 'queued', ?2) ON CONFLICT (job) DO UPDATE \
             SET state = 'queued', attempts = 0, asked_at = ?2, ended_at = NULL, error = NULL",
        )
        .bind(job)
        .bind(now)
        .execute(&mut *tx)
        .await?;
        note(&mut tx, job, now, "verification asked", Some("by order")).await?;
        Ok(tx.commit().await?)
    }

    /// The verification that was ordered first and not done yet, with the attempts
    /// that were begun.
    pub async fn verification_due(&self) -> Result<Option<(Job, u32)>> {
        let found = sqlx::query(
            "SELECT job.*, verification.attempts AS tries FROM verification CROSS JOIN job ON job.id = verification.job \
             WHERE verification.state = 'queued' AND job.state = 'done' ORDER BY verification.asked_at LIMIT 1",
        )
        .fetch_optional(&self.readers)
        .await?;
        found.map(|found| Ok((row::job(&found)?, found.try_get("tries")?))).transpose()
    }

    /// Counts an attempt before it is begun; one that a shutdown ends is taken back.
    pub async fn count_verification(&self, job: JobId, by: i32) -> Result<()> {
        sqlx::query(
            "UPDATE verification SET attempts = max(0, attempts + ?) WHERE job = ? AND state = 'queued'",
        )
        .bind(by)
        .bind(job)
        .execute(&self.writer)
        .await?;
        Ok(())
    }

    /// Records what came of a verification: its report, or why there is none.
    pub async fn settle_verification(
        &self,
        job: JobId,
        end: &std::result::Result<serde_json::Value, String>,
        now: i64,
    ) -> Result<()> {
        let (state, report, error) = match end {
            Ok(report) => ("done", Some(report.to_string()), None),
            Err(error) => ("failed", None, Some(error.as_str())),
        };
        let mut tx = self.begin().await?;
        let settled = sqlx::query(
            "UPDATE verification SET state = ?, report = ?, error = ?, ended_at = ? WHERE job = ? AND state = 'queued'",
        )
        .bind(state)
        .bind(report)
        .bind(error)
        .bind(now)
        .bind(job)
        .execute(&mut *tx)
        .await?;
        if settled.rows_affected() > 0 {
            let fine = end.as_ref().is_ok_and(|report| report["ok"] == true);
            let what = if fine { "verified" } else { "verification failed" };
            note(&mut tx, job, now, what, error).await?;
        }
        Ok(tx.commit().await?)
    }

    pub async fn verification(&self, job: JobId) -> Result<Option<Verification>> {
        let found = sqlx::query("SELECT * FROM verification WHERE job = ?")
            .bind(job)
            .fetch_optional(&self.readers)
            .await?;
        let Some(found) = found else { return Ok(None) };
        let (state, report): (String, Option<String>) = (found.try_get("state")?, found.try_get("report")?);
        let state = match state.as_str() {
            "queued" => Verified::Queued,
            "done" => Verified::Done,
            "failed" => Verified::Failed,
            _ => return Err(StoreError::Unknown { what: "a verification's state", value: state }),
        };
        Ok(Some(Verification {
            state,
            asked_at: found.try_get("asked_at")?,
            ended_at: found.try_get("ended_at")?,
            error: found.try_get("error")?,
            report: report.and_then(|text| serde_json::from_str(&text).ok()),
        }))
    }
}
