//! What the start finds of an earlier run of the daemon that died.

use sqlx::Row;

use super::claim::{AttemptResult, end_attempt};
use super::{Result, Store, previews, row};
use crate::serve::job::retry_policy::{AttemptEnd, Policy};
use crate::serve::job::{ControlRequest, Event, Job, JobId};

/// A job that was running.
#[derive(Debug, Clone, PartialEq)]
pub enum Recovered {
    /// Back in the queue, or in quarantine.
    Judged(JobId, Event),
    /// Its octree is converted; only the swap into place is left to do.
    Staged(Box<Job>),
}

impl Store {
    /// After the lock on the state folder is taken no other daemon can hold a
    /// lease: every running job was left by one that died. Those whose octree is
    /// staged are handed back to be published; the others are judged as crashed, or
    /// where there were several (pictures among them) as suspected.
    /// `units` tells how many units of work a job has receipts for.
    pub async fn recover(
        &self,
        owner: &str,
        policy: &Policy,
        now: i64,
        units: impl Fn(JobId) -> u64,
    ) -> Result<Vec<Recovered>> {
        let mut tx = self.begin().await?;
        let rows = sqlx::query("SELECT * FROM job WHERE state = 'running'").fetch_all(&mut *tx).await?;
        let drawing = previews::interrupted(&mut tx).await?;
        let mut at_work = drawing;
        for row in &rows {
            at_work += usize::from(row::job(row)?.staged.is_none());
        }
        let alone = at_work == 1;
        if drawing > 0 {
            previews::suspect_interrupted(&mut tx, alone, now).await?;
        }
        let mut recovered = Vec::with_capacity(rows.len());
        for row in &rows {
            let job = row::job(row)?;
            if job.staged.is_some() {
                sqlx::query("UPDATE job SET lease_owner = ? WHERE id = ?")
                    .bind(owner)
                    .bind(job.id)
                    .execute(&mut *tx)
                    .await?;
                recovered.push(Recovered::Staged(Box::new(job)));
                continue;
            }
            let (before, units) = (row.try_get::<i64, _>("units")?, units(job.id) as i64);
            sqlx::query("UPDATE job SET units = ? WHERE id = ?")
                .bind(units)
                .bind(job.id)
                .execute(&mut *tx)
                .await?;
            // An operator's wish outlives the crash.
            let end = match job.wish {
                Some(ControlRequest::Cancel) => AttemptEnd::Cancelled,
                Some(ControlRequest::Pause) => AttemptEnd::Paused,
                None if units > before => AttemptEnd::Interrupted,
                None if alone => AttemptEnd::Crashed,
                None => AttemptEnd::Suspected,
            };
            let error = match end {
                AttemptEnd::Suspected => {
                    "the daemon died while it was at this and other work; it runs alone next"
                }
                _ => "the daemon died while it converted this",
            };
            let ending = AttemptResult { end, error: Some(error.to_string()) };
            let verdict = end_attempt(&mut tx, &job, &ending, policy, now).await?;
            if matches!(end, AttemptEnd::Crashed | AttemptEnd::Suspected) {
                sqlx::query("UPDATE job SET suspect = 1 WHERE id = ?").bind(job.id).execute(&mut *tx).await?;
            }
            recovered.push(Recovered::Judged(job.id, verdict.event));
        }
        tx.commit().await?;
        Ok(recovered)
    }
}
