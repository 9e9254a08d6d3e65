//! `/upload`: files that a browser hands in. They are written behind a dot in the
//! inbox, where the watcher does not look, and get their names when the whole
//! request has arrived and lies on the disk; what is interrupted leaves nothing.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use axum::Json;
use axum::extract::State as Extract;
use axum::extract::multipart::{Field, Multipart};
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Redirect, Response};
use serde_json::json;
use tokio::io::{AsyncWriteExt, BufWriter};
use tokio::sync::Semaphore;

use super::super::refusal::ApiError;
use super::super::shared::AppState;
use super::{frame, words};
use crate::platform::disk::{Disk, DiskError};
use crate::serve::watch::{marker, names};

/// Uploads at a time.
const MOST: usize = 8;
/// Nothing for so long, and whoever sends is gone.
const SILENCE: Duration = Duration::from_secs(60);
/// Bytes that are written at once.
const BLOCK: usize = 1 << 20;
/// Bytes between two looks at the room that is left.
const LOOK: u64 = 64 << 20;
/// Folders within each other.
const DEEPEST: usize = 24;
/// Files of one upload.
const MOST_FILES: usize = 100_000;

/// Places for uploads.
pub fn places() -> Arc<Semaphore> {
    Arc::new(Semaphore::new(MOST))
}

/// Where uploads lie until they are whole, in the inbox.
pub fn folder(inbox: &Path) -> PathBuf {
    inbox.join(".uploads")
}

/// A folder for one upload; what is left in it goes with this.
struct Partial {
    folder: PathBuf,
    disk: Disk,
}

impl Drop for Partial {
    fn drop(&mut self) {
        if let Err(error) = self.disk.remove_dir_all(&self.folder) {
            tracing::warn!(%error, "left-over of an upload");
        }
    }
}

fn refused(status: StatusCode, text: impl Into<String>) -> ApiError {
    ApiError::new(status, text)
}

fn failed(error: &DiskError) -> ApiError {
    let full = matches!(error.source.kind(), io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded);
    let status = if full { StatusCode::INSUFFICIENT_STORAGE } else { StatusCode::INTERNAL_SERVER_ERROR };
    refused(status, error.to_string())
}

/// The path below the inbox that a browser's name for a file stands for; nothing for
/// what is no cloud and belongs to none.
fn path_of(name: &str) -> Option<PathBuf> {
    let parts: Vec<&str> = name.split(['/', '\\']).filter(|part| !matches!(*part, "" | "." | "..")).collect();
    let (file, folders) = parts.split_last()?;
    // One with a mistake in its name comes too, so that the data set's job says so.
    let is_marker = (*file == marker::NAME || marker::is_misnamed(file)) && !folders.is_empty();
    if (!names::is_cloud(file) && !is_marker) || folders.len() > DEEPEST {
        return None;
    }
    // The same as makes octrees' names of files' names.
    let path: PathBuf = folders.iter().chain([file]).map(|part| names::plain(part)).collect();
    // What is left of the name must still be taken.
    let left = path.file_name()?.to_str()?;
    (is_marker || names::is_cloud(left)).then_some(path)
}

pub(in super::super) async fn receive(
    Extract(shared): Extract<AppState>,
    headers: HeaderMap,
    mut multipart: Multipart,
) -> Result<Response, ApiError> {
    let config = &shared.config;
    if !config.upload {
        let text = "uploads are switched off here (`upload = false`); copy the files into a watched folder";
        return Err(refused(StatusCode::FORBIDDEN, text));
    }
    let _place = shared.uploads.clone().try_acquire_owned().map_err(|_| {
        refused(StatusCode::SERVICE_UNAVAILABLE, "other uploads are under way; try again in a moment")
    })?;
    let announced = headers.get(header::CONTENT_LENGTH).and_then(|value| value.to_str().ok()?.parse().ok());
    let announced: u64 = announced.unwrap_or_default();
    check_room(&shared, 0, announced)?;
    let partial = begin(&shared).await?;
    let (mut taken, mut passed_over, mut written) = (0usize, vec![], 0u64);
    loop {
        let field = within(multipart.next_field()).await?;
        let Some(field) = field else { break };
        let Some(name) = field.file_name().map(str::to_string).filter(|name| !name.is_empty()) else {
            continue;
        };
        let Some(path) = path_of(&name) else {
            passed_over.push(name);
            drain(field).await?;
            continue;
        };
        if taken >= MOST_FILES {
            return Err(refused(
                StatusCode::PAYLOAD_TOO_LARGE,
                format!("an upload holds {MOST_FILES} files at most"),
            ));
        }
        write(&shared, field, &partial.folder.join(path), &mut written).await?;
        taken += 1;
    }
    if taken == 0 {
        let what = passed_over
            .first()
            .map_or("nothing was sent".to_string(), |name| format!("{name} is no LAS or LAZ file"));
        let text = format!("{what}; PDAL or CloudCompare turns other formats into LAZ");
        return Err(refused(StatusCode::UNSUPPORTED_MEDIA_TYPE, text));
    }
    let (disk, inbox) = (shared.disk.clone(), config.inbox());
    let put = tokio::task::spawn_blocking(move || {
        put(&disk, &partial.folder, &inbox).map(|names| (names, partial))
    });
    let (names, _) = put
        .await
        .map_err(|error| refused(StatusCode::INTERNAL_SERVER_ERROR, error.to_string()))?
        .map_err(|error| failed(&error))?;
    tracing::info!(files = taken, bytes = written, names = names.join(", "), "uploaded");
    let wants_json =
        headers.get(header::ACCEPT).is_some_and(|value| value.as_bytes().starts_with(b"application/json"));
    if wants_json {
        return Ok(Json(
            json!({ "names": names, "files": taken, "bytes": written, "passed_over": passed_over.len() }),
        )
        .into_response());
    }
    let to = format!("{}/?said=uploaded&n={}", frame::base(&shared), names.len());
    Ok(Redirect::to(&to).into_response())
}

/// Refuses what is too large, or would take the room that is to stay free.
fn check_room(shared: &AppState, written: u64, more: u64) -> Result<(), ApiError> {
    let config = &shared.config;
    if written.max(more) > config.upload_limit {
        let limit = words::bytes(config.upload_limit);
        let text =
            format!("an upload holds {limit} at most here (`upload_limit`); copy it into a watched folder");
        return Err(refused(StatusCode::PAYLOAD_TOO_LARGE, text));
    }
    let free = shared.disk.free_space(&config.inbox()).map_err(|error| failed(&error))?;
    if free < config.disk_reserve.saturating_add(more) {
        let text = format!(
            "only {} of disk are free, of which {} stay in reserve; make room and send it again",
            words::bytes(free),
            words::bytes(config.disk_reserve)
        );
        return Err(refused(StatusCode::INSUFFICIENT_STORAGE, text));
    }
    Ok(())
}

async fn begin(shared: &AppState) -> Result<Partial, ApiError> {
    static NUMBER: AtomicU64 = AtomicU64::new(0);
    let number = NUMBER.fetch_add(1, Ordering::Relaxed);
    let place = folder(&shared.config.inbox()).join(format!("{}-{number}", shared.clock.now()));
    let partial = Partial { folder: place, disk: shared.disk.clone() };
    partial.disk.create_dir_all(&partial.folder).map_err(|error| failed(&error))?;
    Ok(partial)
}

/// Waits for more of the request, but not for ever.
async fn within<T>(
    more: impl Future<Output = Result<T, axum::extract::multipart::MultipartError>>,
) -> Result<T, ApiError> {
    match tokio::time::timeout(SILENCE, more).await {
        Ok(Ok(more)) => Ok(more),
        Ok(Err(error)) => {
            let text = format!("the upload broke off, nothing of it is kept: {}", error.body_text());
            Err(refused(StatusCode::BAD_REQUEST, text))
        }
        Err(_) => Err(refused(StatusCode::REQUEST_TIMEOUT, "the upload stood still and was given up")),
    }
}

async fn drain(mut field: Field<'_>) -> Result<(), ApiError> {
    while within(field.chunk()).await?.is_some() {}
    Ok(())
}

/// Writes one file, a block at a time, so that memory stays flat however large it is.
async fn write(
    shared: &AppState,
    mut field: Field<'_>,
    path: &Path,
    written: &mut u64,
) -> Result<(), ApiError> {
    let trouble = |error: io::Error| failed(&DiskError::new("write to", path, error));
    if let Some(folder) = path.parent() {
        shared.disk.create_dir_all(folder).map_err(|error| failed(&error))?;
    }
    let file = tokio::fs::File::create(path).await.map_err(trouble)?;
    let mut file = BufWriter::with_capacity(BLOCK, file);
    let mut looked_at = *written;
    while let Some(chunk) = within(field.chunk()).await? {
        file.write_all(&chunk).await.map_err(trouble)?;
        *written += chunk.len() as u64;
        if *written - looked_at >= LOOK || *written > shared.config.upload_limit {
            looked_at = *written;
            // On its way to the disk as it comes: else all of a large file is waited for
            // at its end, in silence.
            file.flush().await.map_err(trouble)?;
            file.get_ref().sync_data().await.map_err(trouble)?;
            check_room(shared, *written, 0)?;
        }
    }
    file.flush().await.map_err(trouble)?;
    file.into_inner().sync_data().await.map_err(trouble)
}

/// Gives everything its name in the inbox; a folder that is there already gets the
/// new files beside its own, or in their place.
fn put(disk: &Disk, from: &Path, inbox: &Path) -> Result<Vec<String>, DiskError> {
    let listed = |path: &Path| {
        let entries = std::fs::read_dir(path).and_then(|entries| entries.collect::<io::Result<Vec<_>>>());
        entries.map_err(|error| DiskError::new("list", path, error))
    };
    let mut names = vec![];
    for entry in listed(from)? {
        let (source, target) = (entry.path(), inbox.join(entry.file_name()));
        if source.is_dir() && target.is_dir() {
            put(disk, &source, &target)?;
        } else {
            disk.rename(&source, &target)?;
        }
        names.push(entry.file_name().to_string_lossy().into_owned());
    }
    names.sort();
    Ok(names)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_from_browsers_stay_below_the_inbox() {
        for (name, path) in [
            ("a.laz", Some("a.laz")),
            ("tiles/a.LAS", Some("tiles/a.LAS")),
            ("../../etc/a.las", Some("etc/a.las")),
            ("C:\\clouds\\a.las", Some("C:/clouds/a.las")),
            ("/etc/passwd", None),
            (".hidden/a.las", Some("hidden/a.las")),
            ("tiles/lodestone.json", Some("tiles/lodestone.json")),
            ("lodestone.json", None),
            ("tiles/notes.txt", None),
            ("a.laz.part", None),
            ("..", None),
            ("", None),
        ] {
            assert_eq!(path_of(name), path.map(PathBuf::from), "{name}");
        }
        let path = path_of("tiles/a\n\u{1b}[2J.las").expect("taken");
        assert!(!path.to_string_lossy().contains(char::is_control), "{path:?}");
        assert_eq!(path_of(&format!("{}a.las", "x/".repeat(60))), None);
    }

    #[test]
    fn a_folder_that_is_there_gets_the_new_files() {
        let folder = tempfile::tempdir().expect("a folder");
        let (from, inbox) = (folder.path().join("from"), folder.path().join("inbox"));
        for (path, text) in [
            ("from/t/a.las", "new"),
            ("from/t/s/b.las", "b"),
            ("inbox/t/a.las", "old"),
            ("inbox/t/c.las", "c"),
        ] {
            let path = folder.path().join(path);
            std::fs::create_dir_all(path.parent().expect("one")).expect("made");
            std::fs::write(path, text).expect("written");
        }
        assert_eq!(put(&Disk::new(), &from, &inbox).expect("put"), ["t"]);
        let read = |path: &str| std::fs::read_to_string(inbox.join(path)).expect("there");
        assert_eq!([read("t/a.las"), read("t/s/b.las"), read("t/c.las")], ["new", "b", "c"]);
    }
}
