//! Rows to values.

use std::path::PathBuf;

use sqlx::Row;
use sqlx::sqlite::SqliteRow;

use super::error::{Result, StoreError};
use crate::serve::job::{ControlRequest, Job, QueuedFile, State};

pub(super) fn state(row: &SqliteRow) -> Result<State> {
    let name: String = row.try_get("state")?;
    State::parse(&name).ok_or(StoreError::Unknown { what: "a state", value: name })
}

pub(super) fn job(row: &SqliteRow) -> Result<Job> {
    let wish: Option<String> = row.try_get("wish")?;
    let options: String = row.try_get("options")?;
    let result: Option<String> = row.try_get("result")?;
    let result: Option<serde_json::Value> = result.and_then(|text| serde_json::from_str(&text).ok());
    let state = state(row)?;
    // Headers may be wrong, or unreadable.
    let read = result.as_ref().filter(|_| state == State::Done).and_then(|r| r["points_in"].as_u64());
    Ok(Job {
        id: row.try_get("id")?,
        name: row.try_get("name")?,
        source: PathBuf::from(row.try_get::<String, _>("source")?),
        revision: row.try_get("revision")?,
        state,
        hold: row.try_get("hold")?,
        error: row.try_get("error")?,
        wish: wish.as_deref().and_then(ControlRequest::parse),
        priority: row.try_get("priority")?,
        attempts: row.try_get("attempts")?,
        strikes: row.try_get("strikes")?,
        postponements: row.try_get("postponements")?,
        not_before: row.try_get("not_before")?,
        points: read.unwrap_or(row.try_get::<i64, _>("points")? as u64),
        bytes: row.try_get::<i64, _>("bytes")? as u64,
        created_at: row.try_get("created_at")?,
        started_at: row.try_get("started_at")?,
        updated_at: row.try_get("updated_at")?,
        finished_at: row.try_get("finished_at")?,
        staged: Some(row.try_get::<i64, _>("staged")? as u64).filter(|inode| *inode != 0),
        octree: row.try_get("octree")?,
        doubt: row.try_get("doubt")?,
        refusal: row.try_get("refusal")?,
        superseded_by: row.try_get("superseded_by")?,
        result,
        content_key: row.try_get("content_key")?,
        options: serde_json::from_str(&options).unwrap_or_default(),
    })
}

/// A job as lists have it: without its options, which may be long.
pub(super) fn listed(row: &SqliteRow) -> Result<Job> {
    let mut job = job(row)?;
    job.options = serde_json::Value::Null;
    if let Some(serde_json::Value::Object(result)) = &mut job.result {
        result.remove("options");
    }
    Ok(job)
}

pub(super) fn input(row: &SqliteRow) -> Result<QueuedFile> {
    Ok(QueuedFile {
        path: PathBuf::from(row.try_get::<String, _>("path")?),
        size: row.try_get::<i64, _>("size")? as u64,
        mtime_ns: row.try_get("mtime_ns")?,
        hash: row.try_get("hash")?,
        inode: row.try_get::<i64, _>("inode")? as u64,
        ctime_ns: row.try_get("ctime_ns")?,
    })
}
