//! What the watcher found whole becomes a job, or turns out to be known: one
//! transaction an arrival, so that a crash leaves either all of it or nothing.

use std::path::PathBuf;

use sqlx::{Row, Sqlite, Transaction};

use super::{Result, Store, dedup, names, note, row, step};
use crate::serve::job::retry_policy::{FailureCounts, forgive};
use crate::serve::job::{Event, JobId, QueuedFile, State};

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DataSetKind {
    File,
    Folder,
}

impl DataSetKind {
    fn name(self) -> &'static str {
        match self {
            DataSetKind::File => "file",
            DataSetKind::Folder => "folder",
        }
    }
}

/// A data set that is whole and quiet.
#[derive(Debug, Clone)]
pub struct NewDataSet {
    /// The file or folder that was dropped; UTF-8, as all paths here.
    pub path: PathBuf,
    pub kind: DataSetKind,
    /// The wished name of its octree; a number is added where it is taken.
    pub name: String,
    /// Sizes and times of its files, so that it is known again.
    pub stamp: String,
    pub content_key: String,
    pub inputs: Vec<QueuedFile>,
    /// Conversion options as JSON.
    pub options: String,
    pub priority: i64,
    /// Points that the headers claim.
    pub points: u64,
    /// Why it may not be whole: its sources stay.
    pub doubt: Option<String>,
    /// Why it cannot be converted as it was meant to be.
    pub refusal: Option<String>,
    /// Where octrees lie: a name that something has there is taken.
    pub octrees: PathBuf,
}

/// What became of an arrival.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum EnqueueResult {
    /// A new job; the older open jobs of this source were called off.
    New(JobId),
    /// A job that had failed gets a new chance, for its source was written again.
    Released(JobId),
    /// The same content is converted, or about to be: nothing to do.
    Known(JobId),
}

impl EnqueueResult {
    pub fn job(&self) -> JobId {
        match self {
            EnqueueResult::New(job) | EnqueueResult::Released(job) | EnqueueResult::Known(job) => *job,
        }
    }
}

type Tx = Transaction<'static, Sqlite>;

struct DataSet {
    id: i64,
    name: String,
    revision: i64,
}

impl Store {
    /// The stamps of all data sets by their path: what need not be looked at.
    pub async fn stamps(&self) -> Result<Vec<(PathBuf, String)>> {
        let rows = sqlx::query("SELECT path, stamp FROM data_set").fetch_all(&self.readers).await?;
        rows.iter()
            .map(|row| Ok((PathBuf::from(row.try_get::<String, _>("path")?), row.try_get("stamp")?)))
            .collect()
    }

    /// Takes an arrival into the queue.
    pub async fn take_in(&self, arrival: &NewDataSet, now: i64) -> Result<EnqueueResult> {
        let mut tx = self.begin().await?;
        let mut data_set = upsert_data_set(&mut tx, arrival, now).await?;
        if let Some(job) = being_put_away(&mut tx, &data_set, arrival).await? {
            note_stamp(&mut tx, &data_set, job, arrival, now).await?;
            tx.commit().await?;
            return Ok(EnqueueResult::Known(job));
        }
        // Its octree is no longer that of what lies here now.
        let moves_on = !names::is_free_to_use(&mut tx, &arrival.octrees, &data_set.name, None).await?;
        let arrival = &own_content(&mut tx, &data_set, moves_on, arrival).await?;
        let admission = match dedup::find_standing(&mut tx, &arrival.content_key).await? {
            Some(job) => {
                meet_again(&mut tx, &data_set, job, arrival, now).await?;
                EnqueueResult::Known(job)
            }
            None => {
                if moves_on {
                    rename(&mut tx, &mut data_set, arrival).await?;
                }
                match find_fallen(&mut tx, &data_set, &arrival.content_key).await? {
                    Some(job) => {
                        release(&mut tx, &data_set, job, arrival, now).await?;
                        EnqueueResult::Released(job)
                    }
                    None => EnqueueResult::New(insert_job(&mut tx, &data_set, arrival, now).await?),
                }
            }
        };
        let job = admission.job();
        note_stamp(&mut tx, &data_set, job, arrival, now).await?;
        call_off_older(&mut tx, &data_set, job, now).await?;
        tx.commit().await?;
        Ok(admission)
    }
}

/// Finds or makes the data set's row and settles the name of its octree.
async fn upsert_data_set(tx: &mut Tx, arrival: &NewDataSet, now: i64) -> Result<DataSet> {
    let path = arrival.path.to_string_lossy();
    let known = sqlx::query("SELECT id, name, revision FROM data_set WHERE path = ?")
        .bind(&*path)
        .fetch_optional(&mut **tx)
        .await?;
    if let Some(row) = known {
        return Ok(DataSet {
            id: row.try_get("id")?,
            name: row.try_get("name")?,
            revision: row.try_get("revision")?,
        });
    }
    let name = names::free_name(tx, &arrival.octrees, &arrival.name).await?;
    let id = sqlx::query(
        "INSERT INTO data_set (path, kind, name, stamp, created_at, updated_at) VALUES (?, ?, ?, '', ?, ?)",
    )
    .bind(&*path)
    .bind(arrival.kind.name())
    .bind(&name)
    .bind(now)
    .bind(now)
    .execute(&mut **tx)
    .await?
    .last_insert_rowid();
    Ok(DataSet { id, name, revision: 0 })
}

/// The stamp by which a data set is known again, and the job that stands for it.
async fn note_stamp(
    tx: &mut Tx,
    data_set: &DataSet,
    job: JobId,
    arrival: &NewDataSet,
    now: i64,
) -> Result<()> {
    sqlx::query("UPDATE data_set SET job = ?, stamp = ?, updated_at = ? WHERE id = ?")
        .bind(job)
        .bind(&arrival.stamp)
        .bind(now)
        .bind(data_set.id)
        .execute(&mut **tx)
        .await?;
    Ok(())
}

/// Under a name that comes again lies something of its own from now on.
async fn rename(tx: &mut Tx, data_set: &mut DataSet, arrival: &NewDataSet) -> Result<()> {
    data_set.name = names::free_name(tx, &arrival.octrees, &arrival.name).await?;
    sqlx::query("UPDATE data_set SET name = ? WHERE id = ?")
        .bind(&data_set.name)
        .bind(data_set.id)
        .execute(&mut **tx)
        .await?;
    Ok(())
}

/// The job whose sources are being removed one after the other, where these are
/// what is left of them: nothing new. Where more came to them instead, they are not
/// put away any more: what is made of them all takes their octree's place.
async fn being_put_away(tx: &mut Tx, data_set: &DataSet, arrival: &NewDataSet) -> Result<Option<JobId>> {
    let rows = sqlx::query(
        "SELECT job.id, job_input.path, job_input.size, job_input.hash FROM data_set \
         JOIN job ON job.id = data_set.job JOIN job_input ON job_input.job = job.id \
         WHERE data_set.id = ? AND job.state = 'done' AND job.sources IS NOT NULL",
    )
    .bind(data_set.id)
    .fetch_all(&mut **tx)
    .await?;
    if arrival.inputs.len() == rows.len() {
        return Ok(None);
    }
    let mut known = std::collections::HashMap::with_capacity(rows.len());
    let mut job: Option<JobId> = None;
    for row in &rows {
        job = Some(row.try_get("id")?);
        let path: String = row.try_get("path")?;
        known.insert(path, (row.try_get::<i64, _>("size")? as u64, row.try_get::<String, _>("hash")?));
    }
    let is_left = |input: &QueuedFile| {
        known.get(&*input.path.to_string_lossy()) == Some(&(input.size, input.hash.clone()))
            && !input.hash.is_empty()
    };
    if arrival.inputs.len() < rows.len() {
        return Ok(job.filter(|_| arrival.inputs.iter().all(is_left)));
    }
    if job.is_some() && arrival.inputs.iter().filter(|input| is_left(input)).count() == rows.len() {
        sqlx::query("UPDATE job SET sources = NULL WHERE id = ?").bind(job).execute(&mut **tx).await?;
    }
    Ok(None)
}

/// A content that stands as another data set's octree is not converted twice,
/// unless this data set has an octree of its own, which would go on showing what
/// the source no longer holds: then the content is its own.
async fn own_content(
    tx: &mut Tx,
    data_set: &DataSet,
    moves_on: bool,
    arrival: &NewDataSet,
) -> Result<NewDataSet> {
    let mut arrival = arrival.clone();
    if !moves_on
        && let Some(key) = dedup::own_key(tx, data_set.id, &data_set.name, &arrival.content_key).await?
    {
        arrival.content_key = key;
    }
    Ok(arrival)
}

/// A job of this data set that had this content and did not get done.
async fn find_fallen(tx: &mut Tx, data_set: &DataSet, content_key: &str) -> Result<Option<JobId>> {
    let row = sqlx::query(
        "SELECT id FROM job WHERE data_set = ? AND content_key = ? \
         AND state IN ('failed', 'quarantined', 'cancelled') ORDER BY id DESC LIMIT 1",
    )
    .bind(data_set.id)
    .bind(content_key)
    .fetch_optional(&mut **tx)
    .await?;
    Ok(row.map(|row| row.try_get("id")).transpose()?)
}

/// The content is known: under another name that is worth a note; under its own
/// the file was only touched, and its times are noted anew.
async fn meet_again(
    tx: &mut Tx,
    data_set: &DataSet,
    job: JobId,
    arrival: &NewDataSet,
    now: i64,
) -> Result<()> {
    let row = sqlx::query("SELECT data_set FROM job WHERE id = ?").bind(job).fetch_one(&mut **tx).await?;
    if row.try_get::<i64, _>("data_set")? == data_set.id {
        // It may have been called off a moment ago, for a content that is gone
        // again.
        sqlx::query("UPDATE job SET wish = NULL, superseded_by = NULL WHERE id = ? AND wish = 'cancel'")
            .bind(job)
            .execute(&mut **tx)
            .await?;
        sqlx::query("UPDATE job SET doubt = ? WHERE id = ?")
            .bind(&arrival.doubt)
            .bind(job)
            .execute(&mut **tx)
            .await?;
        return replace_inputs(tx, job, &arrival.inputs).await;
    }
    // Should its own source be gone, the engine sees now that this one is there.
    sqlx::query("UPDATE job SET hold = NULL WHERE id = ?").bind(job).execute(&mut **tx).await?;
    let told = format!("also dropped as {}; not converted twice, that copy may go", arrival.path.display());
    note(tx, job, now, "same content", Some(&told)).await
}

async fn release(tx: &mut Tx, data_set: &DataSet, job: JobId, arrival: &NewDataSet, now: i64) -> Result<()> {
    let row = sqlx::query("SELECT * FROM job WHERE id = ?").bind(job).fetch_one(&mut **tx).await?;
    let job_now = row::job(&row)?;
    let state = step(job, job_now.state, Event::Release)?;
    let tally = FailureCounts {
        attempts: job_now.attempts,
        strikes: job_now.strikes,
        postponements: job_now.postponements,
    };
    let tally = forgive(Event::Release, job_now.state == State::Quarantined, tally);
    sqlx::query(
        "UPDATE job SET state = ?, strikes = ?, postponements = ?, not_before = 0, hold = NULL, \
         error = NULL, superseded_by = NULL, finished_at = NULL, priority = ?, updated_at = ?, name = ?, \
         doubt = ?, refusal = ? WHERE id = ?",
    )
    .bind(state.name())
    .bind(tally.strikes)
    .bind(tally.postponements)
    .bind(arrival.priority)
    .bind(now)
    .bind(&data_set.name)
    .bind(&arrival.doubt)
    .bind(&arrival.refusal)
    .bind(job)
    .execute(&mut **tx)
    .await?;
    replace_inputs(tx, job, &arrival.inputs).await?;
    note(tx, job, now, Event::Release.name(), Some("its source was written again")).await
}

async fn insert_job(tx: &mut Tx, data_set: &DataSet, arrival: &NewDataSet, now: i64) -> Result<JobId> {
    let bytes: u64 = arrival.inputs.iter().map(|input| input.size).sum();
    let job = sqlx::query(
        "INSERT INTO job (data_set, name, source, revision, content_key, state, priority, options, \
         points, bytes, doubt, refusal, created_at, updated_at) \
         VALUES (?, ?, ?, ?, ?, 'queued', ?, ?, ?, ?, ?, ?, ?, ?)",
    )
    .bind(data_set.id)
    .bind(&data_set.name)
    .bind(&*arrival.path.to_string_lossy())
    .bind(data_set.revision + 1)
    .bind(&arrival.content_key)
    .bind(arrival.priority)
    .bind(&arrival.options)
    .bind(i64::try_from(arrival.points).unwrap_or(i64::MAX))
    .bind(i64::try_from(bytes).unwrap_or(i64::MAX))
    .bind(&arrival.doubt)
    .bind(&arrival.refusal)
    .bind(now)
    .bind(now)
    .execute(&mut **tx)
    .await?
    .last_insert_rowid();
    sqlx::query("UPDATE data_set SET revision = revision + 1 WHERE id = ?")
        .bind(data_set.id)
        .execute(&mut **tx)
        .await?;
    replace_inputs(tx, job, &arrival.inputs).await?;
    note(tx, job, now, "queued", None).await?;
    Ok(job)
}

async fn replace_inputs(tx: &mut Tx, job: JobId, inputs: &[QueuedFile]) -> Result<()> {
    sqlx::query("DELETE FROM job_input WHERE job = ?").bind(job).execute(&mut **tx).await?;
    for (ord, input) in inputs.iter().enumerate() {
        sqlx::query(
            "INSERT INTO job_input (job, ord, path, size, mtime_ns, hash, inode, ctime_ns) \
             VALUES (?, ?, ?, ?, ?, ?, ?, ?)",
        )
        .bind(job)
        .bind(ord as i64)
        .bind(&*input.path.to_string_lossy())
        .bind(i64::try_from(input.size).unwrap_or(i64::MAX))
        .bind(input.mtime_ns)
        .bind(&input.hash)
        .bind(input.inode as i64)
        .bind(input.ctime_ns)
        .execute(&mut **tx)
        .await?;
    }
    Ok(())
}

/// Calls off what the data set's older contents still had before them: waiting
/// jobs at once, a running one by a wish.
async fn call_off_older(tx: &mut Tx, data_set: &DataSet, job: JobId, now: i64) -> Result<()> {
    let older = sqlx::query(
        "SELECT * FROM job WHERE data_set = ? AND id <> ? AND state IN ('queued', 'running', 'paused')",
    )
    .bind(data_set.id)
    .bind(job)
    .fetch_all(&mut **tx)
    .await?;
    for row in &older {
        let old = row::job(row)?;
        let detail = format!("its source has newer content, which is job {job}");
        if old.state == State::Running {
            sqlx::query("UPDATE job SET wish = 'cancel', superseded_by = ?, updated_at = ? WHERE id = ?")
                .bind(job)
                .bind(now)
                .bind(old.id)
                .execute(&mut **tx)
                .await?;
        } else {
            let state = step(old.id, old.state, Event::Cancel)?;
            dedup::call_off(tx, old.id, state, &detail, now).await?;
            sqlx::query("UPDATE job SET superseded_by = ? WHERE id = ?")
                .bind(job)
                .bind(old.id)
                .execute(&mut **tx)
                .await?;
            dedup::look_again_after_calling_off(tx, old.id).await?;
        }
        note(tx, old.id, now, "superseded", Some(&detail)).await?;
    }
    Ok(())
}
