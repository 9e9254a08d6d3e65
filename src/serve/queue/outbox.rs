//! What is owed after a job's end: to put its sources away, to tell a hook. A debt
//! stands in the queue until it is paid, so that a crash in between forgets none.

use sqlx::Row;

use super::{Result, Store, note, row};
use crate::serve::config::sources::OnDone;
use crate::serve::job::{Job, JobId, State};

/// An end that a hook is to be told of.
#[derive(Debug, Clone)]
pub struct PendingHook {
    pub job: Job,
    /// How the job ended; it may have been ordered to run again since.
    pub end: State,
    /// Where its source is now; empty where it was removed.
    pub source_now: String,
    /// Whether the sources are still to be put away.
    pub sources_owed: bool,
}

impl Store {
    /// Notes, before the octree is published, what is to be done with the sources
    /// afterwards. It counts once the job is done.
    pub async fn owe_sources(&self, job: JobId, owner: &str, what: OnDone) -> Result<()> {
        sqlx::query(
            "UPDATE job SET sources = ?, sources_now = NULL \
             WHERE id = ? AND state = 'running' AND lease_owner = ?",
        )
        .bind((what != OnDone::Keep).then_some(what.name()))
        .bind(job)
        .bind(owner)
        .execute(&self.writer)
        .await?;
        Ok(())
    }

    /// The source of a job that is done was dropped once more, unchanged: what
    /// was done with it then is to be done again. Tells whether it will be.
    pub async fn owe_sources_again(&self, job: JobId, source: &str, what: OnDone) -> Result<bool> {
        if what == OnDone::Keep {
            return Ok(false);
        }
        let owed = sqlx::query(
            "UPDATE job SET sources = ? \
             WHERE id = ? AND source = ? AND state = 'done' AND superseded_by IS NULL AND doubt IS NULL",
        )
        .bind(what.name())
        .bind(job)
        .bind(source)
        .execute(&self.writer)
        .await?;
        Ok(owed.rows_affected() > 0)
    }

    /// Jobs that are done and stand for what lies in their source now, with what
    /// is still to be done with that. Newer content has a job of its own to say.
    ///
    /// A folder is left to itself for a while after it was taken in, `linger` in
    /// milliseconds: more may come, and its copier must find it.
    pub async fn sources_owed(&self, now: i64, linger: i64, limit: i64) -> Result<Vec<(Job, OnDone)>> {
        let rows = sqlx::query(
            "SELECT job.* FROM job INDEXED BY job_owing_sources WHERE sources IS NOT NULL AND state = 'done' \
             AND EXISTS (SELECT 1 FROM data_set WHERE data_set.id = job.data_set AND data_set.job = job.id \
             AND (kind = 'file' OR abs(?1 - data_set.updated_at) >= ?2)) ORDER BY job.id LIMIT ?3",
        )
        .bind(now)
        .bind(linger)
        .bind(limit)
        .fetch_all(&self.readers)
        .await?;
        let mut owed = Vec::with_capacity(rows.len());
        for found in &rows {
            let what = OnDone::parse(found.try_get("sources")?).unwrap_or_default();
            owed.push((row::job(found)?, what));
        }
        Ok(owed)
    }

    /// Notes that the sources are about to be put away, before anything is: after a
    /// crash in between, the octree may be all that is left of them, whatever lies
    /// under their name then. Tells whether that was begun before.
    pub async fn begin_sources(&self, job: JobId) -> Result<bool> {
        let mut tx = self.begin().await?;
        let row = sqlx::query("SELECT sources_now IS NOT NULL AS begun FROM job WHERE id = ?")
            .bind(job)
            .fetch_one(&mut *tx)
            .await?;
        sqlx::query("UPDATE job SET sources_now = coalesce(sources_now, '') WHERE id = ?")
            .bind(job)
            .execute(&mut *tx)
            .await?;
        tx.commit().await?;
        Ok(row.try_get("begun")?)
    }

    /// Closes the debt: the sources were put away (`now_at` says where to), or
    /// stay for good.
    pub async fn settle_sources(
        &self,
        job: JobId,
        now_at: Option<&str>,
        what: &str,
        detail: &str,
        now: i64,
    ) -> Result<()> {
        let mut tx = self.begin().await?;
        sqlx::query("UPDATE job SET sources = NULL, sources_now = ?, updated_at = ? WHERE id = ?")
            .bind(now_at)
            .bind(now)
            .bind(job)
            .execute(&mut *tx)
            .await?;
        note(&mut tx, job, now, what, Some(detail)).await?;
        Ok(tx.commit().await?)
    }

    /// Ends that a hook is still to be told of, the oldest first.
    pub async fn hooks_owed(&self, limit: i64) -> Result<Vec<PendingHook>> {
        let rows = sqlx::query("SELECT * FROM job WHERE hook IS NOT NULL ORDER BY id LIMIT ?")
            .bind(limit)
            .fetch_all(&self.readers)
            .await?;
        let telling = |found: &sqlx::sqlite::SqliteRow| {
            let job = row::job(found)?;
            let end: String = found.try_get("hook")?;
            let sources_owed = found.try_get::<Option<String>, _>("sources")?.is_some();
            // What is only begun may still be where it was.
            let source_now: Option<String> = found.try_get("sources_now")?;
            let source_now = source_now.filter(|_| !sources_owed);
            Ok(PendingHook {
                end: State::parse(&end).unwrap_or(job.state),
                sources_owed,
                source_now: source_now.unwrap_or_else(|| job.source.to_string_lossy().into_owned()),
                job,
            })
        };
        rows.iter().map(telling).collect()
    }

    /// Notes that the hook was told of this end. Where the job ended once more
    /// meanwhile, that end is still owed.
    pub async fn settle_hook(&self, job: JobId, end: State, detail: &str, now: i64) -> Result<()> {
        let mut tx = self.begin().await?;
        sqlx::query("UPDATE job SET hook = NULL WHERE id = ? AND hook = ?")
            .bind(job)
            .bind(end.name())
            .execute(&mut *tx)
            .await?;
        note(&mut tx, job, now, "hook", Some(detail)).await?;
        Ok(tx.commit().await?)
    }

    /// Nobody is to be told of these ends.
    pub async fn forget_hooks(&self, ends: &[State]) -> Result<()> {
        for end in ends {
            sqlx::query("UPDATE job SET hook = NULL WHERE hook = ?")
                .bind(end.name())
                .execute(&self.writer)
                .await?;
        }
        Ok(())
    }
}
