//! The log's lines about each job, kept with it: whoever asks why a job failed
//! need not search the daemon's log, which may be long gone. The oldest go.

use sqlx::Row;

use super::{Result, Store};
use crate::serve::job::JobId;
use crate::serve::log::LogLine;

/// Lines that are kept of a job.
const LONGEST_LOG: i64 = 400;

impl Store {
    /// Keeps lines with their jobs; those about jobs that are gone are dropped.
    pub async fn keep_lines(&self, lines: &[LogLine]) -> Result<()> {
        let mut tx = self.begin().await?;
        for line in lines {
            sqlx::query(
                "INSERT INTO log_line (job, at, level, text) SELECT id, ?, ?, ? FROM job WHERE id = ?",
            )
            .bind(line.at)
            .bind(&line.level)
            .bind(&line.text)
            .bind(line.job)
            .execute(&mut *tx)
            .await?;
        }
        let mut jobs: Vec<JobId> = lines.iter().map(|line| line.job).collect();
        jobs.sort_unstable();
        jobs.dedup();
        for job in jobs {
            sqlx::query(
                "DELETE FROM log_line WHERE job = ?1 AND id <= \
                 (SELECT id FROM log_line WHERE job = ?1 ORDER BY id DESC LIMIT 1 OFFSET ?2)",
            )
            .bind(job)
            .bind(LONGEST_LOG)
            .execute(&mut *tx)
            .await?;
        }
        Ok(tx.commit().await?)
    }

    /// The latest lines about a job, the oldest first.
    pub async fn lines(&self, job: JobId) -> Result<Vec<LogLine>> {
        let rows = sqlx::query("SELECT * FROM log_line WHERE job = ? ORDER BY id DESC LIMIT ?")
            .bind(job)
            .bind(LONGEST_LOG)
            .fetch_all(&self.readers)
            .await?;
        let line = |row: &sqlx::sqlite::SqliteRow| {
            Ok(LogLine {
                job: row.try_get("job")?,
                at: row.try_get("at")?,
                level: row.try_get("level")?,
                text: row.try_get("text")?,
            })
        };
        rows.iter().rev().map(line).collect()
    }
}
