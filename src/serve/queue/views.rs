//! What the API, the metrics and the command line read of the queue.

use serde::Serialize;
use sqlx::Row;

use super::{Result, Store, StoreError, row};
use crate::serve::job::time::iso8601;
use crate::serve::job::{Job, JobId, QueuedFile, State};

/// One run of a job. Times are milliseconds since 1970.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Attempt {
    pub number: i64,
    pub started_at: i64,
    /// In ISO 8601, as all such names.
    pub started_at_iso: String,
    pub ended_at: Option<i64>,
    pub ended_at_iso: Option<String>,
    /// How long it took; none while it runs.
    pub duration_seconds: Option<f64>,
    pub outcome: Option<String>,
    pub error: Option<String>,
}

/// One line of a job's history.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct History {
    pub at: i64,
    pub at_iso: String,
    pub kind: String,
    pub detail: Option<String>,
}

/// Gauges of the whole queue.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Counts {
    /// Jobs by state, in the order of [`State::ALL`].
    pub by_state: Vec<(State, i64)>,
    /// When the oldest queued job was made.
    pub oldest_queued: Option<i64>,
    /// Queued jobs that something holds.
    pub held: i64,
    /// When the progress of a running job last moved.
    pub last_heartbeat: Option<i64>,
}

impl Store {
    pub async fn job(&self, job: JobId) -> Result<Job> {
        let found =
            sqlx::query("SELECT * FROM job WHERE id = ?").bind(job).fetch_optional(&self.readers).await?;
        row::job(&found.ok_or(StoreError::NoSuchJob(job))?)
    }

    /// Jobs without their options, the youngest first; those of one state where `state` is given, and
    /// those with a smaller number than `before` for the next page.
    pub async fn jobs(&self, state: Option<State>, before: Option<JobId>, limit: i64) -> Result<Vec<Job>> {
        let state = state.map(State::name);
        let rows = sqlx::query(
            "SELECT * FROM job WHERE (?1 IS NULL OR state = ?1) AND (?2 IS NULL OR id < ?2) \
             ORDER BY id DESC LIMIT ?3",
        )
        .bind(state)
        .bind(before)
        .bind(limit)
        .fetch_all(&self.readers)
        .await?;
        rows.iter().map(row::listed).collect()
    }

    /// How many jobs there are; of one state where `state` is given.
    pub async fn count_jobs(&self, state: Option<State>) -> Result<i64> {
        let row = sqlx::query("SELECT count(*) AS jobs FROM job WHERE (?1 IS NULL OR state = ?1)")
            .bind(state.map(State::name))
            .fetch_one(&self.readers)
            .await?;
        Ok(row.try_get("jobs")?)
    }

    pub async fn inputs(&self, job: JobId) -> Result<Vec<QueuedFile>> {
        let rows = sqlx::query("SELECT * FROM job_input WHERE job = ? ORDER BY ord")
            .bind(job)
            .fetch_all(&self.readers)
            .await?;
        rows.iter().map(row::input).collect()
    }

    /// The number of the latest line in any job's history.
    pub async fn latest_event(&self) -> Result<i64> {
        let row =
            sqlx::query("SELECT coalesce(max(id), 0) AS id FROM event").fetch_one(&self.readers).await?;
        Ok(row.try_get("id")?)
    }

    /// Jobs to which something happened after that line, the oldest first, without
    /// their options.
    pub async fn jobs_since(&self, event: i64, limit: i64) -> Result<Vec<Job>> {
        let rows = sqlx::query(
            "SELECT * FROM job WHERE id IN (SELECT job FROM event WHERE id > ?) ORDER BY id DESC LIMIT ?",
        )
        .bind(event)
        .bind(limit)
        .fetch_all(&self.readers)
        .await?;
        rows.iter().rev().map(row::listed).collect()
    }

    /// What happened after that line of history, the oldest first: which job it
    /// happened to, its name, and what.
    pub async fn happened_since(&self, event: i64, limit: i64) -> Result<Vec<(JobId, String, String)>> {
        let rows = sqlx::query(
            "SELECT event.job, job.name, event.kind FROM event JOIN job ON job.id = event.job \
             WHERE event.id > ? ORDER BY event.id LIMIT ?",
        )
        .bind(event)
        .bind(limit)
        .fetch_all(&self.readers)
        .await?;
        rows.iter().map(|row| Ok((row.try_get("job")?, row.try_get("name")?, row.try_get("kind")?))).collect()
    }

    pub async fn attempts(&self, job: JobId) -> Result<Vec<Attempt>> {
        let rows = sqlx::query("SELECT * FROM attempt WHERE job = ? ORDER BY ord DESC LIMIT 100")
            .bind(job)
            .fetch_all(&self.readers)
            .await?;
        let attempt = |row: &sqlx::sqlite::SqliteRow| {
            let (started_at, ended_at): (i64, Option<i64>) =
                (row.try_get("started_at")?, row.try_get("ended_at")?);
            Ok(Attempt {
                number: row.try_get("ord")?,
                started_at,
                started_at_iso: iso8601(started_at),
                ended_at,
                ended_at_iso: ended_at.map(iso8601),
                duration_seconds: ended_at.map(|end| (end - started_at).max(0) as f64 / 1000.0),
                outcome: row.try_get("outcome")?,
                error: row.try_get("error")?,
            })
        };
        rows.iter().map(attempt).collect()
    }

    pub async fn history(&self, job: JobId) -> Result<Vec<History>> {
        let rows = sqlx::query("SELECT * FROM event WHERE job = ? ORDER BY id DESC LIMIT 200")
            .bind(job)
            .fetch_all(&self.readers)
            .await?;
        let line = |row: &sqlx::sqlite::SqliteRow| {
            let at = row.try_get("at")?;
            Ok(History {
                at,
                at_iso: iso8601(at),
                kind: row.try_get("kind")?,
                detail: row.try_get("detail")?,
            })
        };
        rows.iter().map(line).collect()
    }

    pub async fn counts(&self) -> Result<Counts> {
        let rows = sqlx::query("SELECT state, count(*) AS jobs FROM job GROUP BY state")
            .fetch_all(&self.readers)
            .await?;
        let mut counts =
            Counts { by_state: State::ALL.map(|state| (state, 0)).to_vec(), ..Counts::default() };
        for row in &rows {
            let state = row::state(row)?;
            let jobs: i64 = row.try_get("jobs")?;
            counts.by_state.iter_mut().filter(|(s, _)| *s == state).for_each(|(_, n)| *n = jobs);
        }
        let row = sqlx::query(
            "SELECT min(created_at) AS oldest, count(hold) AS held FROM job WHERE state = 'queued'",
        )
        .fetch_one(&self.readers)
        .await?;
        counts.oldest_queued = row.try_get("oldest")?;
        counts.held = row.try_get("held")?;
        let row = sqlx::query("SELECT max(heartbeat_at) AS at FROM job WHERE state = 'running'")
            .fetch_one(&self.readers)
            .await?;
        counts.last_heartbeat = row.try_get("at")?;
        Ok(counts)
    }

    /// Numbers of the jobs that have work before them: whose scratch is theirs.
    pub async fn open_jobs(&self) -> Result<Vec<JobId>> {
        let rows = sqlx::query("SELECT id FROM job WHERE state IN ('queued', 'running', 'paused')")
            .fetch_all(&self.readers)
            .await?;
        rows.iter().map(|row| Ok(row.try_get("id")?)).collect()
    }
}
