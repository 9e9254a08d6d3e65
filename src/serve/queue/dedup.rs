//! Data sets of the same content share one job. When that job stops standing for
//! them (its own source got new content, or is gone before it was read), the
//! others must not be forgotten with it: their stamp is cleared, which means
//! "look at this again", and the watcher then finds them as if they were new.

use std::path::PathBuf;

use sqlx::{Row, Sqlite, Transaction};

use super::{Result, Store, note, row, step};
use crate::serve::job::{Event, JobId, State};

type Tx = Transaction<'static, Sqlite>;

/// A data set whose content another one's job stands for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Copy {
    pub path: PathBuf,
    pub job: JobId,
    /// Of the octree that holds it, or will.
    pub name: String,
    /// When it was found, in milliseconds since 1970.
    pub since: i64,
}

impl Store {
    /// Data sets that were not converted because their content was known already,
    /// the latest first.
    pub async fn copies(&self, limit: i64) -> Result<Vec<Copy>> {
        let rows = sqlx::query(
            "SELECT data_set.path, data_set.updated_at, job.id, job.name FROM data_set \
             JOIN job ON job.id = data_set.job WHERE job.data_set <> data_set.id AND data_set.stamp <> '' \
             ORDER BY data_set.id DESC LIMIT ?",
        )
        .bind(limit)
        .fetch_all(&self.readers)
        .await?;
        let copy = |row: &sqlx::sqlite::SqliteRow| {
            Ok(Copy {
                path: PathBuf::from(row.try_get::<String, _>("path")?),
                job: row.try_get("id")?,
                name: row.try_get("name")?,
                since: row.try_get("updated_at")?,
            })
        };
        rows.iter().map(copy).collect()
    }

    /// Data sets that the watcher is to look at again, though it knows them.
    pub async fn to_look_at_again(&self) -> Result<Vec<PathBuf>> {
        let rows = sqlx::query("SELECT path FROM data_set WHERE stamp = ''").fetch_all(&self.readers).await?;
        rows.iter().map(|row| Ok(PathBuf::from(row.try_get::<String, _>("path")?))).collect()
    }

    /// Calls off a waiting job whose own source cannot be read, where another data
    /// set has the same content: that one gets a job of its own. Tells whether it
    /// was so.
    pub async fn give_way(&self, job: JobId, reason: &str, now: i64) -> Result<bool> {
        let mut tx = self.begin().await?;
        let found = sqlx::query(
            "SELECT * FROM job WHERE id = ? AND state = 'queued' AND EXISTS \
             (SELECT 1 FROM data_set WHERE data_set.job = job.id AND data_set.id <> job.data_set)",
        )
        .bind(job)
        .fetch_optional(&mut *tx)
        .await?;
        let Some(found) = found else { return Ok(false) };
        let state = step(job, row::state(&found)?, Event::Cancel)?;
        let detail = format!("{reason}; another data set has the same content and takes its place");
        call_off(&mut tx, job, state, &detail, now).await?;
        note(&mut tx, job, now, Event::Cancel.name(), Some(&detail)).await?;
        look_again(&mut tx, "job = ?", job).await?;
        tx.commit().await?;
        Ok(true)
    }
}

/// The key of a content that is a data set's own, where another data set's octree
/// holds it and this one's an older content.
pub(super) async fn own_key(tx: &mut Tx, data_set: i64, name: &str, key: &str) -> Result<Option<String>> {
    let row = sqlx::query(
        "SELECT EXISTS (SELECT 1 FROM job WHERE data_set = ?1 AND state = 'done' AND superseded_by IS NULL) \
         AND EXISTS (SELECT 1 FROM job WHERE content_key = ?2 AND data_set <> ?1 \
         AND (state IN ('queued', 'running', 'paused') OR (state = 'done' AND superseded_by IS NULL))) AS own",
    )
    .bind(data_set)
    .bind(key)
    .fetch_one(&mut **tx)
    .await?;
    Ok(row.try_get::<bool, _>("own")?.then(|| format!("{key} as {name}")))
}

/// A job that converts this content now, or whose octree stands.
pub(super) async fn find_standing(tx: &mut Tx, content_key: &str) -> Result<Option<JobId>> {
    let row = sqlx::query(
        "SELECT id FROM job WHERE content_key = ? AND (state IN ('queued', 'running', 'paused') \
         OR (state = 'done' AND superseded_by IS NULL))",
    )
    .bind(content_key)
    .fetch_optional(&mut **tx)
    .await?;
    Ok(row.map(|row| row.try_get("id")).transpose()?)
}

/// Writes the end of a job that never ran, or does not run now.
pub(super) async fn call_off(tx: &mut Tx, job: JobId, state: State, detail: &str, now: i64) -> Result<()> {
    sqlx::query(
        "UPDATE job SET state = ?, hold = NULL, error = ?, finished_at = ?, updated_at = ? WHERE id = ?",
    )
    .bind(state.name())
    .bind(detail)
    .bind(now)
    .bind(now)
    .bind(job)
    .execute(&mut **tx)
    .await?;
    Ok(())
}

/// After `job` was called off for a newer content of its own source. By an order
/// alone nothing else becomes of those that share it.
pub(super) async fn look_again_after_calling_off(tx: &mut Tx, job: JobId) -> Result<()> {
    let others = "job = ?1 AND NOT EXISTS (SELECT 1 FROM job AS j JOIN data_set AS own ON own.id = j.data_set \
                  WHERE j.id = ?1 AND own.job = ?1)";
    look_again(tx, others, job).await
}

/// After `job` was published in the place of others: their octree is gone.
pub(super) async fn look_again_after_superseding(tx: &mut Tx, job: JobId) -> Result<()> {
    look_again(tx, "job IN (SELECT id FROM job WHERE superseded_by = ?)", job).await
}

async fn look_again(tx: &mut Tx, which: &'static str, job: JobId) -> Result<()> {
    let update = format!("UPDATE data_set SET stamp = '' WHERE {which}");
    // Of our own words only: every `which` stands in this file.
    sqlx::query(sqlx::AssertSqlSafe(update)).bind(job).execute(&mut **tx).await?;
    Ok(())
}
