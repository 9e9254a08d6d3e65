//! The queue on disk. The only folder that knows sqlx.
//!
//! One connection writes, so that SQLite's single writer is never fought over,
//! and every writing transaction begins IMMEDIATE: a transaction that reads
//! first and writes later fails at once where another got in between. A few
//! connections read. WAL with synchronous FULL: what was acknowledged survives a
//! power cut. Every change of a job's state asks [`crate::serve::job::state_machine`].
//!
//! A future of this room is never put into a `select!`: dropped half-way, its
//! statement may or may not have taken effect.

mod claim;
mod dedup;
mod enqueue;
mod error;
mod listing;
mod log;
mod names;
mod outbox;
mod previews;
pub mod progress;
mod purge;
mod reasons;
mod recovery;
mod row;
mod share;
mod steering;
mod verification;
mod views;

use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::Duration;

use sqlx::migrate::{Migration, MigrationType, Migrator};
use sqlx::sqlite::{
    SqliteConnectOptions, SqliteJournalMode, SqlitePool, SqlitePoolOptions, SqliteSynchronous,
};
use sqlx::{Connection, Row, SqlSafeStr, Sqlite, Transaction};

use crate::serve::job::{Event, JobId, State};

pub use claim::AttemptResult;
pub use enqueue::{DataSetKind, EnqueueResult, NewDataSet};
pub use error::{Result, StoreError};
pub use listing::{Listing, ListingCursor, ListingPage, Shown, Sort};
pub use outbox::PendingHook;
pub use previews::{Drawn, PendingPreview, Preview, PreviewOutcome};
pub use reasons::FailureReason;
pub use recovery::Recovered;
pub use share::Share;
pub use steering::QueueMode;
pub use verification::{Verification, Verified};
pub use views::{Attempt, Counts, History};

/// The schema, one file a version; a released file is never edited again.
const MIGRATIONS: &[(i64, &str, &str)] = &[
    (1, "queue", include_str!("../../../migrations/0001_queue.sql")),
    (2, "control", include_str!("../../../migrations/0002_control.sql")),
    (3, "units", include_str!("../../../migrations/0003_units.sql")),
    (4, "preview", include_str!("../../../migrations/0004_preview.sql")),
    (5, "sources", include_str!("../../../migrations/0005_sources.sql")),
    (6, "suspects", include_str!("../../../migrations/0006_suspects.sql")),
    (7, "page", include_str!("../../../migrations/0007_page.sql")),
    (8, "verify_share", include_str!("../../../migrations/0008_verify_share.sql")),
    (9, "names", include_str!("../../../migrations/0009_names.sql")),
];

/// Lines of a job's history, and attempts: a job that is tried for a year must
/// not fill the disk with its own story. The oldest go.
const LONGEST_HISTORY: i64 = 500;

/// The queue. Cheap to clone.
#[derive(Debug, Clone)]
pub struct Store {
    writer: SqlitePool,
    readers: SqlitePool,
    path: PathBuf,
}

impl Store {
    /// Opens the queue, making and migrating it where that is needed.
    pub async fn open(path: &Path) -> Result<Store> {
        let store = Store::connect(path, true).await?;
        store.migrate().await?;
        Ok(store)
    }

    /// Opens the queue of a daemon that may be running, as it is.
    pub async fn open_existing(path: &Path) -> Result<Store> {
        if matches!(path.metadata(), Err(error) if matches!(error.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory))
        {
            return Err(StoreError::Missing { path: path.to_path_buf() });
        }
        let store = Store::connect(path, false).await?;
        if let Err(error) = store.check_version().await {
            store.close().await;
            return Err(error);
        }
        Ok(store)
    }

    async fn connect(path: &Path, create: bool) -> Result<Store> {
        let opening = |source| StoreError::Open { path: path.to_path_buf(), source };
        let options = SqliteConnectOptions::new()
            .filename(path)
            .create_if_missing(create)
            .journal_mode(SqliteJournalMode::Wal)
            .synchronous(SqliteSynchronous::Full)
            .foreign_keys(true)
            .pragma("trusted_schema", "OFF")
            .busy_timeout(Duration::from_secs(10));
        let writer = SqlitePoolOptions::new()
            .max_connections(1)
            // On a full disk or an I/O error SQLite rolls back by itself; sqlx's
            // own rollback then fails, and the connection would count as being
            // in a transaction for ever. It gives way to a new one.
            .after_release(|connection, _| {
                Box::pin(async move {
                    connection.ping().await?;
                    Ok(!connection.is_in_transaction())
                })
            })
            .connect_with(options.clone())
            .await
            .map_err(opening)?;
        let readers =
            SqlitePoolOptions::new().max_connections(3).connect_with(options).await.map_err(opening)?;
        Ok(Store { writer, readers, path: path.to_path_buf() })
    }

    async fn migrate(&self) -> Result<()> {
        let migrations = MIGRATIONS
            .iter()
            .map(|(version, name, sql)| {
                Migration::new(*version, (*name).into(), MigrationType::Simple, sql.into_sql_str(), false)
            })
            .collect();
        let migrator = Migrator::with_migrations(migrations);
        let failing = |source| StoreError::Migrate { path: self.path.clone(), source };
        migrator.run(&self.writer).await.map_err(failing)
    }

    /// Whether this program's queries fit the tables that are there.
    async fn check_version(&self) -> Result<()> {
        let path = self.path.clone();
        let tables =
            sqlx::query("SELECT count(*) AS tables FROM sqlite_master WHERE name = '_sqlx_migrations'")
                .fetch_one(&self.readers)
                .await
                .map_err(|source| StoreError::Open { path: path.clone(), source })?;
        if tables.try_get::<i64, _>("tables")? == 0 {
            return Err(StoreError::NotAQueue { path });
        }
        let row =
            sqlx::query("SELECT coalesce(max(version), 0) AS version FROM _sqlx_migrations WHERE success")
                .fetch_one(&self.readers)
                .await?;
        let (found, needed) =
            (row.try_get("version")?, MIGRATIONS.last().map_or(0, |(version, ..)| *version));
        if found < needed { Err(StoreError::Outdated { path, found, needed }) } else { Ok(()) }
    }

    /// Closes all connections, so that the WAL is folded back into the file.
    pub async fn close(&self) {
        self.readers.close().await;
        self.writer.close().await;
    }

    /// Begins a transaction that may write.
    async fn begin(&self) -> Result<Transaction<'static, Sqlite>> {
        Ok(self.writer.begin_with("BEGIN IMMEDIATE").await?)
    }
}

/// Refuses what is `asked` of a job's octree where the job is not done, or another
/// octree stands in its place.
async fn must_stand(tx: &mut Transaction<'static, Sqlite>, job: JobId, asked: &'static str) -> Result<()> {
    let found = sqlx::query("SELECT state, superseded_by FROM job WHERE id = ?")
        .bind(job)
        .fetch_optional(&mut **tx)
        .await?
        .ok_or(StoreError::NoSuchJob(job))?;
    let state = row::state(&found)?;
    let superseded = found.try_get::<Option<JobId>, _>("superseded_by")?.is_some();
    if state != State::Done || superseded {
        let state = if superseded { "superseded" } else { state.name() };
        return Err(StoreError::Illegal { job, state, asked });
    }
    Ok(())
}

/// Writes a line into a job's history.
async fn note(
    tx: &mut Transaction<'static, Sqlite>,
    job: JobId,
    at: i64,
    kind: &str,
    detail: Option<&str>,
) -> Result<()> {
    sqlx::query("INSERT INTO event (job, at, kind, detail) VALUES (?, ?, ?, ?)")
        .bind(job)
        .bind(at)
        .bind(kind)
        .bind(detail)
        .execute(&mut **tx)
        .await?;
    sqlx::query(
        "DELETE FROM event WHERE job = ?1 AND id <= \
         (SELECT id FROM event WHERE job = ?1 ORDER BY id DESC LIMIT 1 OFFSET ?2)",
    )
    .bind(job)
    .bind(LONGEST_HISTORY)
    .execute(&mut **tx)
    .await?;
    Ok(())
}

/// The state after `event`, or an error that says why not.
fn step(job: JobId, state: State, event: Event) -> Result<State> {
    crate::serve::job::state_machine::next(state, event).ok_or(StoreError::Illegal {
        job,
        state: state.name(),
        asked: event.name(),
    })
}
