//! The life of a job after it is queued: claims, heartbeats, ends, orders.
//! Whoever ends an attempt must still hold its lease: `WHERE lease_owner = ? AND
//! attempts = ?` is the fence, and where no row answers, the result is thrown
//! away.

use std::ops::RangeInclusive;

use sqlx::{Row, Sqlite, Transaction};

use super::{LONGEST_HISTORY, Result, Store, StoreError, dedup, note, previews, row, step};
use crate::serve::job::retry_policy::{AttemptEnd, FailureCounts, Policy, RetryDecision, forgive, judge};
use crate::serve::job::{ControlRequest, Event, Job, JobId, State};

type Tx = Transaction<'static, Sqlite>;

/// How an attempt ended, for the record.
#[derive(Debug, Clone)]
pub struct AttemptResult {
    pub end: AttemptEnd,
    /// What to tell the operator.
    pub error: Option<String>,
}

impl Store {
    /// Jobs with inputs of these `sizes` that may start now, best first. One that is to wait for longer than
    /// `longest_wait` was told so by a clock that has been set back since.
    pub async fn ready(
        &self,
        now: i64,
        longest_wait: i64,
        sizes: RangeInclusive<u64>,
        limit: i64,
    ) -> Result<Vec<Job>> {
        let bytes = |size: &u64| i64::try_from(*size).unwrap_or(i64::MAX);
        let rows = sqlx::query(
            "SELECT * FROM job WHERE state = 'queued' AND suspect = 0 AND (not_before <= ? OR not_before > ?) \
             AND bytes BETWEEN ? AND ? ORDER BY priority DESC, id LIMIT ?",
        )
        .bind(now)
        .bind(now.saturating_add(longest_wait))
        .bind(bytes(sizes.start()))
        .bind(bytes(sizes.end()))
        .bind(limit)
        .fetch_all(&self.readers)
        .await?;
        rows.iter().map(row::job).collect()
    }

    /// Jobs that are due and may have brought the daemon down: each runs alone.
    pub async fn suspects(&self, now: i64, longest_wait: i64, limit: i64) -> Result<Vec<Job>> {
        let rows = sqlx::query(
            "SELECT * FROM job WHERE state = 'queued' AND suspect = 1 \
             AND (not_before <= ? OR not_before > ?) ORDER BY priority DESC, id LIMIT ?",
        )
        .bind(now)
        .bind(now.saturating_add(longest_wait))
        .bind(limit)
        .fetch_all(&self.readers)
        .await?;
        rows.iter().map(row::job).collect()
    }

    /// When the next waiting job may start, where one waits.
    pub async fn next_start(&self, now: i64) -> Result<Option<i64>> {
        let row =
            sqlx::query("SELECT min(not_before) AS at FROM job WHERE state = 'queued' AND not_before > ?")
                .bind(now)
                .fetch_one(&self.readers)
                .await?;
        Ok(row.try_get("at")?)
    }

    /// Notes why a queued job does not start yet, or that nothing holds it.
    pub async fn hold(&self, job: JobId, reason: Option<&str>, now: i64) -> Result<()> {
        let mut tx = self.begin().await?;
        let changed = sqlx::query(
            "UPDATE job SET hold = ?, updated_at = ? WHERE id = ? AND state = 'queued' AND hold IS NOT ?",
        )
        .bind(reason)
        .bind(now)
        .bind(job)
        .bind(reason)
        .execute(&mut *tx)
        .await?
        .rows_affected();
        if changed > 0
            && let Some(reason) = reason
        {
            note(&mut tx, job, now, "held", Some(reason)).await?;
        }
        Ok(tx.commit().await?)
    }

    /// Takes a job for `owner` and counts the attempt, before anything is done.
    /// Nothing is returned where the job is no longer queued.
    pub async fn claim(&self, job: JobId, owner: &str, now: i64) -> Result<Option<Job>> {
        let mut tx = self.begin().await?;
        let Some(before) = find(&mut tx, job).await? else { return Ok(None) };
        let Ok(state) = step(job, before.state, Event::Claim) else { return Ok(None) };
        sqlx::query(
            "UPDATE job SET state = ?, attempts = attempts + 1, lease_owner = ?, heartbeat_at = ?, \
             started_at = ?, updated_at = ?, hold = NULL, wish = NULL, error = NULL, staged = 0, \
             sources = NULL, result = NULL, finished_at = NULL WHERE id = ?",
        )
        .bind(state.name())
        .bind(owner)
        .bind(now)
        .bind(now)
        .bind(now)
        .bind(job)
        .execute(&mut *tx)
        .await?;
        sqlx::query(
            "INSERT INTO attempt (job, ord, owner, started_at) \
             SELECT ?, 1 + coalesce(max(ord), 0), ?, ? FROM attempt WHERE job = ?",
        )
        .bind(job)
        .bind(owner)
        .bind(now)
        .bind(job)
        .execute(&mut *tx)
        .await?;
        sqlx::query("DELETE FROM attempt WHERE job = ?1 AND ord <= (SELECT max(ord) FROM attempt WHERE job = ?1) - ?2")
            .bind(job)
            .bind(LONGEST_HISTORY)
            .execute(&mut *tx)
            .await?;
        note(&mut tx, job, now, Event::Claim.name(), None).await?;
        let claimed = find(&mut tx, job).await?;
        tx.commit().await?;
        Ok(claimed)
    }

    /// Notes that a running job's progress moved.
    pub async fn heartbeat(&self, job: JobId, owner: &str, now: i64) -> Result<()> {
        sqlx::query("UPDATE job SET heartbeat_at = ? WHERE id = ? AND state = 'running' AND lease_owner = ?")
            .bind(now)
            .bind(job)
            .bind(owner)
            .execute(&self.writer)
            .await?;
        Ok(())
    }

    /// Notes that the octree is whole in the staging folder (`inode` tells it from
    /// the one it will replace, its seal from any other), with the report: from here on a crash costs
    /// nothing but a swap. Refused where the lease is lost, or where the job was
    /// called off meanwhile; after this, calling it off comes too late.
    pub async fn stage(
        &self,
        job: JobId,
        owner: &str,
        (inode, seal): (u64, Option<&str>),
        result: &str,
        now: i64,
    ) -> Result<bool> {
        let done = sqlx::query(
            // What was counted takes the place of what the headers claimed.
            "UPDATE job SET staged = ?1, octree = ?2, result = ?3, \
             points = coalesce(json_extract(?3, '$.points_in'), points), updated_at = ?4 \
             WHERE id = ?5 AND state = 'running' AND lease_owner = ?6 AND wish IS NULL",
        )
        .bind(inode as i64)
        .bind(seal)
        .bind(result)
        .bind(now)
        .bind(job)
        .bind(owner)
        .execute(&self.writer)
        .await?;
        Ok(done.rows_affected() == 1)
    }

    /// Records the end of an attempt and what follows from it. Nothing is
    /// returned where the lease was lost.
    pub async fn finish(
        &self,
        job: JobId,
        owner: &str,
        ending: &AttemptResult,
        policy: &Policy,
        now: i64,
    ) -> Result<Option<RetryDecision>> {
        let mut tx = self.begin().await?;
        let held = sqlx::query("SELECT * FROM job WHERE id = ? AND state = 'running' AND lease_owner = ?")
            .bind(job)
            .bind(owner)
            .fetch_optional(&mut *tx)
            .await?;
        let Some(held) = held else { return Ok(None) };
        let verdict = end_attempt(&mut tx, &row::job(&held)?, ending, policy, now).await?;
        tx.commit().await?;
        Ok(Some(verdict))
    }

    /// What operators ask of running jobs.
    pub async fn wishes(&self) -> Result<Vec<(JobId, ControlRequest)>> {
        let rows = sqlx::query("SELECT id, wish FROM job WHERE state = 'running' AND wish IS NOT NULL")
            .fetch_all(&self.readers)
            .await?;
        let mut wishes = Vec::with_capacity(rows.len());
        for row in &rows {
            if let Some(wish) = ControlRequest::parse(row.try_get("wish")?) {
                wishes.push((row.try_get("id")?, wish));
            }
        }
        Ok(wishes)
    }

    /// An operator's order. A running job gets it as a wish, which the next tick
    /// fulfils; any other changes state at once.
    pub async fn order(&self, job: JobId, event: Event, now: i64) -> Result<State> {
        let mut tx = self.begin().await?;
        let state = order_within(&mut tx, job, event, now).await?;
        tx.commit().await?;
        Ok(state)
    }

    pub async fn set_priority(&self, job: JobId, priority: i64, now: i64) -> Result<()> {
        let mut tx = self.begin().await?;
        let changed = sqlx::query("UPDATE job SET priority = ?, updated_at = ? WHERE id = ?")
            .bind(priority)
            .bind(now)
            .bind(job)
            .execute(&mut *tx)
            .await?;
        if changed.rows_affected() == 0 {
            return Err(StoreError::NoSuchJob(job));
        }
        note(&mut tx, job, now, "priority", Some(&priority.to_string())).await?;
        Ok(tx.commit().await?)
    }
}

/// An order within a transaction; one that is refused has written nothing into it.
pub(super) async fn order_within(tx: &mut Tx, job: JobId, event: Event, now: i64) -> Result<State> {
    let before = find(tx, job).await?.ok_or(StoreError::NoSuchJob(job))?;
    let state = step(job, before.state, event)?;
    if before.state == State::Running {
        let wish = if event == Event::Pause { ControlRequest::Pause } else { ControlRequest::Cancel };
        sqlx::query("UPDATE job SET wish = ?, updated_at = ? WHERE id = ?")
            .bind(wish.name())
            .bind(now)
            .bind(job)
            .execute(&mut **tx)
            .await?;
        note(tx, job, now, "asked", Some(wish.name())).await?;
        return Ok(State::Running);
    }
    if state == State::Queued {
        part_from_twin(tx, &before, event).await?;
    }
    let tally = tally_of(&before);
    let tally = match event {
        Event::Retry => forgive(event, before.state == State::Quarantined, tally),
        _ => tally,
    };
    sqlx::query(
        "UPDATE job SET state = ?1, strikes = ?2, postponements = ?3, not_before = 0, hold = NULL, \
         updated_at = ?4, finished_at = CASE WHEN ?1 = 'cancelled' THEN ?4 END, \
         error = CASE WHEN ?1 <> 'queued' THEN error END, \
         superseded_by = CASE WHEN ?1 <> 'queued' THEN superseded_by END WHERE id = ?5",
    )
    .bind(state.name())
    .bind(tally.strikes)
    .bind(tally.postponements)
    .bind(now)
    .bind(job)
    .execute(&mut **tx)
    .await?;
    note(tx, job, now, event.name(), Some("by order")).await?;
    Ok(state)
}

/// Two jobs of one content must not be open side by side: where another data set's
/// job stands for it, this one makes its data set's own octree new, or is refused.
async fn part_from_twin(tx: &mut Tx, job: &Job, event: Event) -> Result<()> {
    let is_other = |found: Option<JobId>| found.is_some_and(|found| found != job.id);
    if !is_other(dedup::find_standing(tx, &job.content_key).await?) {
        return Ok(());
    }
    let row = sqlx::query("SELECT data_set FROM job WHERE id = ?").bind(job.id).fetch_one(&mut **tx).await?;
    if let Some(key) = dedup::own_key(tx, row.try_get("data_set")?, &job.name, &job.content_key).await?
        && !is_other(dedup::find_standing(tx, &key).await?)
    {
        sqlx::query("UPDATE job SET content_key = ? WHERE id = ?")
            .bind(key)
            .bind(job.id)
            .execute(&mut **tx)
            .await?;
        return Ok(());
    }
    Err(StoreError::Illegal {
        job: job.id,
        state: "the twin of a job that has the same content",
        asked: event.name(),
    })
}

async fn find(tx: &mut Tx, job: JobId) -> Result<Option<Job>> {
    let row = sqlx::query("SELECT * FROM job WHERE id = ?").bind(job).fetch_optional(&mut **tx).await?;
    row.as_ref().map(row::job).transpose()
}

fn tally_of(job: &Job) -> FailureCounts {
    FailureCounts { attempts: job.attempts, strikes: job.strikes, postponements: job.postponements }
}

/// What an end means in the light of what is wished now. A job that was called
/// off must not come back because its run failed in that moment; and one whose
/// source came back after it was called off goes on.
fn as_wished(end: AttemptEnd, wish: Option<ControlRequest>) -> AttemptEnd {
    match (end, wish) {
        (AttemptEnd::Published | AttemptEnd::Hopeless | AttemptEnd::Panicked, _) => end,
        (_, Some(ControlRequest::Cancel)) => AttemptEnd::Cancelled,
        (_, Some(ControlRequest::Pause)) => AttemptEnd::Paused,
        (AttemptEnd::Cancelled | AttemptEnd::Paused, None) => AttemptEnd::Parked,
        (_, None) => end,
    }
}

pub(super) async fn end_attempt(
    tx: &mut Tx,
    job: &Job,
    ending: &AttemptResult,
    policy: &Policy,
    now: i64,
) -> Result<RetryDecision> {
    let verdict = judge(as_wished(ending.end, job.wish), tally_of(job), policy);
    let newer = job.superseded_by.map(|by| format!("its source has newer content, which is job {by}"));
    let state = step(job.id, job.state, verdict.event)?;
    let error = match (verdict.event, &ending.error) {
        (Event::Quarantine, Some(error)) => Some(format!(
            "{error}; this was strike {} and the job is in quarantine until its source changes or it is retried",
            verdict.tally.strikes
        )),
        (Event::Succeed | Event::Park, _) => None,
        (Event::Cancel, error) => newer.or_else(|| error.clone()),
        (_, error) => error.clone(),
    };
    let finished = (!state.is_open()).then_some(now);
    sqlx::query(
        "UPDATE job SET state = ?, attempts = ?, strikes = ?, postponements = ?, not_before = ?, error = ?, \
         lease_owner = NULL, heartbeat_at = NULL, wish = NULL, staged = 0, suspect = 0, updated_at = ?, finished_at = ?, \
         hook = coalesce(?, hook) WHERE id = ?",
    )
    .bind(state.name())
    .bind(verdict.tally.attempts)
    .bind(verdict.tally.strikes)
    .bind(verdict.tally.postponements)
    .bind(if verdict.wait > 0 { now + verdict.wait } else { 0 })
    .bind(&error)
    .bind(now)
    .bind(finished)
    .bind(finished.and((state != State::Cancelled).then_some(state.name())))
    .bind(job.id)
    .execute(&mut **tx)
    .await?;
    sqlx::query("UPDATE attempt SET ended_at = ?, outcome = ?, error = ? WHERE job = ? AND ended_at IS NULL")
        .bind(now)
        .bind(verdict.event.name())
        .bind(&error)
        .bind(job.id)
        .execute(&mut **tx)
        .await?;
    match verdict.event {
        Event::Succeed => {
            supersede(tx, job).await?;
            previews::owe(tx, job.id, now).await?;
        }
        Event::Cancel => dedup::look_again_after_calling_off(tx, job.id).await?,
        _ => {}
    }
    note(tx, job.id, now, verdict.event.name(), error.as_deref()).await?;
    Ok(verdict)
}

/// What this octree replaced does not stand any more: should its content come
/// back, it must be converted anew.
async fn supersede(tx: &mut Tx, job: &Job) -> Result<()> {
    sqlx::query(
        // By the index of names, which knows no case.
        "UPDATE job SET superseded_by = ?1 WHERE lower(name) = lower(?2) AND name = ?2 AND id <> ?1 \
         AND state = 'done' AND superseded_by IS NULL",
    )
    .bind(job.id)
    .bind(&job.name)
    .execute(&mut **tx)
    .await?;
    dedup::look_again_after_superseding(tx, job.id).await?;
    // Its own standing begins anew, should it have been superseded before.
    sqlx::query("UPDATE job SET superseded_by = NULL WHERE id = ?").bind(job.id).execute(&mut **tx).await?;
    Ok(())
}
