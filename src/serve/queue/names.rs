//! Names of octrees: which are free, and whether what stands under one may give way.
//!
//! An octree whose sources were put away may be all that is left of them. It is
//! replaced by nothing but what is made of the same job; and so is nothing that the
//! queue does not know, be it somebody's own folder or what a lost database knew.

use std::path::Path;

use sqlx::{Row, Sqlite, Transaction};

use super::{Result, Store, note};
use crate::platform::disk::seal;
use crate::serve::job::JobId;

type Tx = Transaction<'static, Sqlite>;

/// The sources of a job were put away, or are about to be.
macro_rules! put_away {
    () => {
        "(sources_now IS NOT NULL OR (sources IS NOT NULL AND (state = 'done' OR staged <> 0)))"
    };
}

/// Whether what lies under `octrees/<name>` may be replaced by what becomes of a
/// data set: nothing, or an octree of ours whose sources are still there. For `job`
/// its own octree may, where it is made again.
pub(super) async fn is_free_to_use(
    tx: &mut Tx,
    octrees: &Path,
    name: &str,
    job: Option<JobId>,
) -> Result<bool> {
    let Some(seal) = seal(&octrees.join(name)) else { return Ok(true) };
    let row = sqlx::query(concat!(
        "SELECT EXISTS (SELECT 1 FROM job WHERE lower(name) = lower(?1) AND name = ?1 AND (octree = ?2 OR (octree IS NULL AND ?2 <> '' \
         AND state = 'done' AND superseded_by IS NULL))) \
         AND NOT EXISTS (SELECT 1 FROM job WHERE lower(name) = lower(?1) AND name = ?1 AND id IS NOT ?3 AND superseded_by IS NULL \
         AND (octree = ?2 OR octree IS NULL) AND ",
        put_away!(),
        ") AS free"
    ))
    .bind(name)
    .bind(&seal)
    .bind(job)
    .fetch_one(&mut **tx)
    .await?;
    Ok(row.try_get("free")?)
}

/// The wished name, or with the first free number behind it: `a.las` and `a.laz`
/// are two data sets and get two octrees.
pub(super) async fn free_name(tx: &mut Tx, octrees: &Path, wished: &str) -> Result<String> {
    let (mut name, mut number) = (wished.to_string(), 1u64);
    loop {
        // Without regard to case, for file systems that have none.
        let taken = sqlx::query(
            "SELECT 1 FROM data_set WHERE lower(name) = lower(?1) UNION ALL \
             SELECT 1 FROM job WHERE lower(name) = lower(?1) AND (state IN ('queued', 'running', 'paused') \
             OR (state = 'done' AND superseded_by IS NULL)) LIMIT 1",
        )
        .bind(&name)
        .fetch_optional(&mut **tx)
        .await?;
        if taken.is_none() && octrees.join(&name).symlink_metadata().is_err() {
            return Ok(name);
        }
        number += 1;
        name = format!("{wished}-{number}");
    }
}

impl Store {
    /// Whether a job's octree may take the place of what lies under its name.
    pub async fn may_publish(&self, job: JobId, name: &str, octrees: &Path) -> Result<bool> {
        let mut tx = self.begin().await?;
        is_free_to_use(&mut tx, octrees, name, Some(job)).await
    }

    /// Gives a job, and the data set that it stands for, a name that is free.
    pub async fn give_new_name(&self, job: JobId, octrees: &Path, now: i64) -> Result<String> {
        let mut tx = self.begin().await?;
        let row = sqlx::query("SELECT name FROM job WHERE id = ?").bind(job).fetch_one(&mut *tx).await?;
        let old: String = row.try_get("name")?;
        let name = free_name(&mut tx, octrees, &old).await?;
        sqlx::query("UPDATE job SET name = ? WHERE id = ?").bind(&name).bind(job).execute(&mut *tx).await?;
        sqlx::query(
            "UPDATE data_set SET name = ?1 WHERE job = ?2 AND id = (SELECT data_set FROM job WHERE id = ?2)",
        )
        .bind(&name)
        .bind(job)
        .execute(&mut *tx)
        .await?;
        let why = format!(
            "what stands as {old} may be all that is left of its sources, or is not known here; \
             this becomes {name}"
        );
        note(&mut tx, job, now, "renamed", Some(&why)).await?;
        tx.commit().await?;
        Ok(name)
    }
}
