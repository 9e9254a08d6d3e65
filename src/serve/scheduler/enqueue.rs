//! From what the watcher found to a job in the queue.

use std::path::PathBuf;

use crate::convert::options::Options;
use crate::platform::clock::Millis;
use crate::serve::config::Config;
use crate::serve::queue::{DataSetKind, EnqueueResult, NewDataSet, Store, StoreError};
use crate::serve::watch::FoundDataSet;
use crate::serve::watch::fingerprint::fingerprint;
use crate::serve::watch::settle::NotYet;

/// What became of a find.
#[derive(Debug)]
pub enum EnqueueOutcome {
    /// In the queue, or known; the stamp by which it is known again.
    In { path: PathBuf, stamp: String, admission: EnqueueResult },
    /// It changed under our hands, and will be found again.
    Moving,
    /// Reading all of it showed that it is not whole. The watcher is to be told,
    /// and finds it again when its patience is over.
    Hollow { path: PathBuf, stamp: String, not_yet: NotYet },
}

/// Reads all bytes of a find (for the fingerprint), and takes it into the queue.
pub async fn take_in(
    store: &Store,
    mut found: FoundDataSet,
    config: &Config,
    now: Millis,
) -> Result<EnqueueOutcome, StoreError> {
    let options = match found.marker.as_ref().map(|marker| marker.options_over(&config.options)) {
        Some(Ok(options)) => options,
        Some(Err(why)) => {
            found.refusal = Some(why);
            config.options.clone()
        }
        None => config.options.clone(),
    };
    let wish = found.marker.as_ref().and_then(|marker| marker.on_done).unwrap_or(config.on_done);
    let (path, stamp, octrees) = (found.path.clone(), found.stamp.clone(), config.octrees());
    let read = tokio::task::spawn_blocking(move || arrival(found, options, octrees)).await.ok().flatten();
    let arrival = match read {
        Some(Ok(arrival)) => arrival,
        Some(Err(not_yet)) => return Ok(EnqueueOutcome::Hollow { path, stamp, not_yet }),
        None => return Ok(EnqueueOutcome::Moving),
    };
    let admission = store.take_in(&arrival, now).await?;
    match &admission {
        EnqueueResult::New(job) => tracing::info!(job, path = %path.display(), "queued"),
        EnqueueResult::Released(job) => {
            tracing::info!(job, path = %path.display(), "queued again, for its source was written again");
        }
        EnqueueResult::Known(job) => {
            tracing::info!(job, path = %path.display(), "its content is known; not converted twice: that job's octree is this one's too, and this copy may go");
            // Dropped once more, it is put away once more.
            store.owe_sources_again(*job, &path.to_string_lossy(), wish).await?;
        }
    }
    Ok(EnqueueOutcome::In { path, stamp, admission })
}

/// Nothing where it changed meanwhile; an error where it is not whole, and its
/// time is not up.
fn arrival(found: FoundDataSet, options: Options, octrees: PathBuf) -> Option<Result<NewDataSet, NotYet>> {
    let print = fingerprint(&found, &options)?;
    if let (Some(not_yet), None) = (&print.hollow, &found.doubt) {
        return Some(Err(not_yet.clone()));
    }
    Some(Ok(NewDataSet {
        kind: if found.is_folder { DataSetKind::Folder } else { DataSetKind::File },
        priority: found.marker.as_ref().map_or(0, |marker| marker.priority),
        path: found.path,
        name: found.name,
        stamp: found.stamp,
        content_key: print.content_key,
        inputs: print.inputs,
        options: serde_json::to_string(&options).unwrap_or_else(|_| "{}".to_string()),
        points: found.points,
        doubt: print.hollow.map(|not_yet| not_yet.why).or(found.doubt),
        refusal: found.refusal,
        octrees,
    }))
}
