//! Old records go, so that the database does not grow for ever.
//!
//! A job that is done and not superseded stands for its octree: as long as that
//! is there it must stay known, or its content would be converted once more. The
//! stamps of the data sets stay as well, so that a file that failed long ago and
//! still lies in its folder is not taken for a new one.

use std::path::Path;

use sqlx::Row;

use super::{Result, Store};
use crate::serve::job::{JobId, State};

/// Ended before a time, owing nothing, and not what another job is said to be
/// superseded by: that one would seem to stand again. The youngest stays, and so does
/// the one of the last event, or their numbers would be given away once more: whoever
/// asks for events behind a number would miss some.
macro_rules! old {
    () => {
        "state IN ('done', 'failed', 'quarantined', 'cancelled') AND finished_at < ? \
         AND sources IS NULL AND hook IS NULL \
         AND id < (SELECT max(id) FROM job) \
         AND id IS NOT (SELECT job FROM event ORDER BY id DESC LIMIT 1) \
         AND NOT EXISTS (SELECT 1 FROM job AS other WHERE other.superseded_by = job.id)"
    };
}

/// Records that go in one transaction: nobody waits long for the writer.
const BATCH: i64 = 200;

struct Old {
    id: JobId,
    name: String,
    stands: bool,
}

impl Store {
    /// Removes ended jobs of before `before` whose octree, if they stand for
    /// one, is no longer under `octrees`. Returns how many went.
    pub async fn purge(&self, before: i64, octrees: &Path) -> Result<u64> {
        let (mut gone, mut last) = (0, 0);
        loop {
            let old = self.old_jobs(before, last).await?;
            let Some(end) = old.last() else { return Ok(gone) };
            last = end.id;
            let octrees = octrees.to_path_buf();
            let goes = move |job: &Old| !job.stands || octrees.join(&job.name).symlink_metadata().is_err();
            let jobs = tokio::task::spawn_blocking(move || {
                old.iter().filter(|job| goes(job)).map(|job| job.id).collect::<Vec<_>>()
            });
            // What could not be looked at stays.
            let jobs = jobs.await.unwrap_or_default();
            if !jobs.is_empty() {
                gone += self.remove(&jobs, before).await?;
            }
        }
    }

    /// Ended jobs that nobody speaks of any more, by their number.
    async fn old_jobs(&self, before: i64, after: JobId) -> Result<Vec<Old>> {
        let rows = sqlx::query(concat!(
            "SELECT id, name, state, superseded_by FROM job WHERE id > ? AND ",
            old!(),
            " ORDER BY id LIMIT ?"
        ))
        .bind(after)
        .bind(before)
        .bind(BATCH)
        .fetch_all(&self.readers)
        .await?;
        let old = |row: &sqlx::sqlite::SqliteRow| {
            let superseded: Option<JobId> = row.try_get("superseded_by")?;
            let stands = super::row::state(row)? == State::Done && superseded.is_none();
            Ok(Old { id: row.try_get("id")?, name: row.try_get("name")?, stands })
        };
        rows.iter().map(old).collect()
    }

    async fn remove(&self, jobs: &[JobId], before: i64) -> Result<u64> {
        let mut tx = self.begin().await?;
        let mut gone = 0;
        for job in jobs {
            // Asked once more: it may have been retried in between.
            let still = sqlx::query(concat!("SELECT 1 FROM job WHERE id = ? AND ", old!()))
                .bind(job)
                .bind(before)
                .fetch_optional(&mut *tx)
                .await?;
            if still.is_none() {
                continue;
            }
            sqlx::query("UPDATE data_set SET job = NULL WHERE job = ?").bind(job).execute(&mut *tx).await?;
            gone += sqlx::query("DELETE FROM job WHERE id = ?")
                .bind(job)
                .execute(&mut *tx)
                .await?
                .rows_affected();
        }
        tx.commit().await?;
        Ok(gone)
    }
}
