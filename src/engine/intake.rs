//! From what the watcher found to a job in the queue.

use std::path::PathBuf;

use crate::clock::Millis;
use crate::stage::options::Options;
use crate::store::{Admission, Arrival, Kind, Store, StoreError};
use crate::watch::Found;
use crate::watch::fingerprint::fingerprint;

/// What became of a find.
#[derive(Debug)]
pub enum Taken {
    /// In the queue, or known; the stamp by which it is known again.
    In { path: PathBuf, stamp: String, admission: Admission },
    /// It changed under our hands, and will be found again.
    Moving,
}

/// Reads all bytes of a find (for the fingerprint), and takes it into the queue.
pub async fn take_in(store: &Store, found: Found, base: &Options, now: Millis) -> Result<Taken, StoreError> {
    let options = match &found.marker {
        // Checked when the marker was read; the base cannot make it wrong.
        Some(marker) => marker.options_over(base).unwrap_or_else(|_| base.clone()),
        None => base.clone(),
    };
    let (path, stamp) = (found.path.clone(), found.stamp.clone());
    let arrival = tokio::task::spawn_blocking(move || arrival(found, options)).await.ok().flatten();
    let Some(arrival) = arrival else { return Ok(Taken::Moving) };
    let admission = store.take_in(&arrival, now).await?;
    match &admission {
        Admission::New(job) => tracing::info!(job, path = %path.display(), "queued"),
        Admission::Released(job) => {
            tracing::info!(job, path = %path.display(), "queued again, for its source was written again");
        }
        Admission::Known(job) => {
            tracing::info!(job, path = %path.display(), "its content is known; not converted twice");
        }
    }
    Ok(Taken::In { path, stamp, admission })
}

fn arrival(found: Found, options: Options) -> Option<Arrival> {
    let print = fingerprint(&found, &options)?;
    Some(Arrival {
        kind: if found.is_folder { Kind::Folder } else { Kind::File },
        priority: found.marker.as_ref().map_or(0, |marker| marker.priority),
        path: found.path,
        name: found.name,
        stamp: found.stamp,
        content_key: print.content_key,
        inputs: print.inputs,
        options: serde_json::to_string(&options).unwrap_or_else(|_| "{}".to_string()),
        points: found.points,
    })
}
