//! The laws of the queue, held against the database, the folders, and the log of
//! what was converted.

use std::collections::{BTreeMap, HashSet};
use std::fs;

use lodestone::platform::disk::Disk;
use lodestone::serve::config::sources::OnDone;
use lodestone::serve::job::Event;
use lodestone::serve::job::Job;
use lodestone::serve::job::State;
use lodestone::serve::job::state_machine;
use lodestone::serve::queue::Drawn;
use sqlx::{Connection, Row, SqliteConnection};

use crate::Broken;
use crate::content::{self, Nature};
use crate::world::World;

/// What the table of events has told so far.
#[derive(Debug, Default)]
pub struct Ledger {
    last_event: i64,
    states: BTreeMap<i64, State>,
    /// Jobs that got an order or a changed source since they were last published.
    renewed: HashSet<i64>,
    /// What each job is of, though its record be purged.
    contents: BTreeMap<i64, String>,
    /// Runs of the converter that were looked at.
    runs: usize,
}

macro_rules! law {
    ($holds:expr, $($why:tt)*) => {
        if !$holds {
            return Err(format!($($why)*));
        }
    };
}

/// What is read of the database in one go.
struct Books {
    events: Vec<(i64, i64, String)>,
    /// By job: attempts, and how many of them have not ended.
    attempts: BTreeMap<i64, (i64, i64)>,
    contents: BTreeMap<i64, String>,
    /// Path, name, current job.
    data_sets: Vec<(String, String, Option<i64>)>,
    orphans: usize,
}

async fn read_books(path: &std::path::Path, after: i64) -> Result<Books, sqlx::Error> {
    let mut db = SqliteConnection::connect(&format!("sqlite:{}", path.display())).await?;
    let rows = sqlx::query("SELECT id, job, kind FROM event WHERE id > ? ORDER BY id").bind(after);
    let rows = rows.fetch_all(&mut db).await?;
    let events = rows.iter().map(|row| (row.get(0), row.get(1), row.get(2))).collect();
    let rows = sqlx::query("SELECT job, count(*), sum(ended_at IS NULL) FROM attempt GROUP BY job");
    let rows = rows.fetch_all(&mut db).await?;
    let attempts = rows.iter().map(|row| (row.get(0), (row.get(1), row.get(2)))).collect();
    let rows = sqlx::query("SELECT job, substr(hash, 1, 16) FROM job_input ORDER BY job, ord");
    let mut contents = BTreeMap::<i64, String>::new();
    for row in rows.fetch_all(&mut db).await? {
        let all = contents.entry(row.get(0)).or_default();
        if !all.is_empty() {
            all.push(',');
        }
        all.push_str(row.get(1));
    }
    let rows = sqlx::query("SELECT path, name, job FROM data_set").fetch_all(&mut db).await?;
    let data_sets = rows.iter().map(|row| (row.get(0), row.get(1), row.get(2))).collect();
    let orphans = sqlx::query("PRAGMA foreign_key_check").fetch_all(&mut db).await?.len();
    db.close().await?;
    Ok(Books { events, attempts, contents, data_sets, orphans })
}

fn books(world: &mut World) -> Result<(Books, Vec<Job>), Broken> {
    let (path, after) = (world.config.database(), world.ledger.last_event);
    let life = world.life.as_ref().expect("alive");
    let books = life.runtime.block_on(read_books(&path, after)).map_err(|error| error.to_string())?;
    Ok((books, life.jobs()))
}

/// After every step.
pub fn hold(world: &mut World) -> Result<(), Broken> {
    nothing_is_lost(world)?;
    if world.life.is_none() {
        // Dead daemons break no law; what the next one finds is looked at then.
        return Ok(());
    }
    let (books, jobs) = books(world)?;
    world.ledger.contents.extend(books.contents.clone());
    replay(&mut world.ledger, &books, &jobs)?;
    law!(books.orphans == 0, "{} rows without their parents", books.orphans);
    let mut open = HashSet::new();
    for job in &jobs {
        if job.state.is_open() || (job.state == State::Done && job.superseded_by.is_none()) {
            law!(open.insert(&job.content_key), "content of job {} is open or stands twice", job.id);
        }
        tallies(world, job, &books)?;
    }
    runs(world, &books)?;
    published(world, &books, &jobs)
}

/// A source that the daemon removed is in an octree on disk, then and ever after;
/// and what is somebody's own among the octrees stays as it is.
fn nothing_is_lost(world: &mut World) -> Result<(), Broken> {
    let (mount, _) = world.mount();
    let away = !mount.exists();
    let gone: Vec<_> =
        world.trust.files.keys().filter(|path| !(away && path.starts_with(&mount))).cloned().collect();
    for path in gone.into_iter().filter(|path| !path.exists()) {
        let content = world.trust.files.remove(&path).expect("just listed");
        let asked =
            world.trust.asked.removal && world.folders().iter().any(|folder| path.starts_with(folder));
        let may_go = world.config.on_done != OnDone::Keep || asked;
        law!(may_go, "{} was removed, though sources are kept", path.display());
        law!(
            content != content::hash(&content::bytes(content::HOLLOW)),
            "{} was removed half written",
            path.display()
        );
        world.trust.removed.insert(content);
    }
    let mut held = HashSet::new();
    for entry in fs::read_dir(world.config.octrees()).expect("there").flatten() {
        if !entry.file_name().to_string_lossy().starts_with('.') {
            let shown = fs::read_to_string(entry.path().join("metadata.json")).unwrap_or_default();
            held.extend(shown.split(',').map(String::from));
        }
    }
    for content in &world.trust.removed {
        law!(held.contains(content), "content {content} was removed, and no octree holds it");
    }
    for (folder, own) in &world.trust.foreign {
        let there = fs::read_to_string(folder.join("metadata.json"));
        law!(there.as_ref().ok() == Some(own), "{} held {own}, and holds {there:?}", folder.display());
    }
    Ok(())
}

/// The events of each job are a way through the machine, and end where it is.
fn replay(ledger: &mut Ledger, books: &Books, jobs: &[Job]) -> Result<(), Broken> {
    for (id, job, kind) in &books.events {
        ledger.last_event = *id;
        let event = match kind.as_str() {
            "queued" => {
                let before = ledger.states.insert(*job, State::Queued);
                law!(before.is_none(), "job {job} was made twice");
                continue;
            }
            "superseded" if ledger.states.get(job) != Some(&State::Running) => Event::Cancel,
            other => match Event::ALL.into_iter().find(|event| event.name() == other) {
                Some(event) => event,
                None => continue,
            },
        };
        let state = ledger.states.get(job).copied().ok_or_else(|| {
            let told: Vec<&str> =
                books.events.iter().filter(|(_, of, _)| of == job).map(|(.., kind)| kind.as_str()).collect();
            format!("job {job} began with {kind}: {told:?}")
        })?;
        let next =
            state_machine::next(state, event).ok_or(format!("job {job}: {kind} of a {state:?} job"))?;
        ledger.states.insert(*job, next);
        match event {
            Event::Retry | Event::Release => ledger.renewed.insert(*job),
            Event::Succeed => ledger.renewed.remove(job),
            _ => false,
        };
    }
    for job in jobs {
        let told = ledger.states.get(&job.id);
        law!(told == Some(&job.state), "job {} is {:?}, its history says {told:?}", job.id, job.state);
    }
    Ok(())
}

/// Strikes lead to quarantine at exactly their number, runs are counted before
/// they begin, and what ended has an end and a reason.
fn tallies(world: &World, job: &Job, books: &Books) -> Result<(), Broken> {
    let most = world.config.policy.max_strikes;
    law!(
        (job.state == State::Quarantined) == (job.strikes >= most) && job.strikes <= most,
        "job {} is {:?} with {} strikes",
        job.id,
        job.state,
        job.strikes
    );
    let (attempts, running) = books.attempts.get(&job.id).copied().unwrap_or_default();
    let expected = i64::from(job.state == State::Running);
    law!(running == expected, "job {} is {:?} with {running} attempts under way", job.id, job.state);
    let runs = world.script.runs.lock().unwrap().iter().filter(|run| run.job == job.id).count() as i64;
    law!(runs <= attempts, "job {} ran {runs} times, {attempts} were counted", job.id);
    if matches!(job.state, State::Failed | State::Quarantined) {
        law!(job.error.is_some(), "job {} is {:?} and does not say why", job.id, job.state);
    }
    Ok(())
}

/// What was converted had to be converted.
fn runs(world: &mut World, books: &Books) -> Result<(), Broken> {
    let runs = world.script.runs.lock().unwrap().clone();
    for run in &runs[world.ledger.runs..] {
        let told = &books.contents[&run.job];
        // An input that vanished after the claim is read by nobody.
        if !run.content.is_empty() && run.content == *told && run.stood.as_ref() == Some(told) {
            let excused = world.trust.meddled
                || world.ledger.renewed.contains(&run.job)
                || world.was_sick
                || world.trust.asked.options
                || !world.ordered.is_empty();
            law!(excused, "job {} converts what stands as {} already", run.job, run.name);
        }
    }
    world.ledger.runs = runs.len();
    Ok(())
}

/// What a name shows is the newest content that was taken in under it.
fn published(world: &mut World, books: &Books, jobs: &[Job]) -> Result<(), Broken> {
    for entry in fs::read_dir(world.config.octrees()).expect("there").flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        if name.starts_with('.') {
            continue;
        }
        let shown = fs::read_to_string(entry.path().join("metadata.json"));
        let shown = shown.map_err(|error| format!("half an octree under {name}: {error}"))?;
        if let Ok(picture) = fs::read_to_string(entry.path().join("preview/preview.json")) {
            law!(picture == shown, "{name} shows {shown}, and its pictures {picture}");
        }
        if world.shown.insert(name.clone(), shown.clone()).as_ref() == Some(&shown) {
            continue;
        }
        if world.trust.foreign.contains_key(&entry.path()) {
            continue;
        }
        // A data set whose sources were removed goes on under another name, and its
        // octree stays.
        if world.config.on_done != OnDone::Keep || world.trust.meddled || world.trust.asked.removal {
            let is_of_job = jobs.iter().any(|job| job.name == name && books.contents[&job.id] == shown);
            law!(is_of_job, "{name} shows {shown}, which no job of that name holds");
            continue;
        }
        let data_set = books.data_sets.iter().find(|(_, n, _)| *n == name);
        let (_, _, newest) = data_set.ok_or(format!("octree {name} of no data set"))?;
        let is_newest = newest.is_some_and(|job| books.contents[&job] == shown);
        let by_order = jobs.iter().any(|job| {
            job.name == name && books.contents[&job.id] == shown && world.ordered.contains(&job.id)
        });
        law!(is_newest || by_order, "{name} shows {shown}, but job {newest:?} is newer");
    }
    Ok(())
}

/// When the faults have stopped and time has passed: nothing is lost.
pub fn hold_in_the_end(world: &mut World) -> Result<(), Broken> {
    world.life(Disk::new());
    hold(world)?;
    world.ledger.last_event = 0;
    let (books, jobs) = books(world)?;
    for place in world.places() {
        let Some(content) = content::on_disk(&place) else { continue };
        let place = place.to_string_lossy().into_owned();
        // An octree of its own never goes on showing what is no longer there.
        let own = books.data_sets.iter().find(|(path, ..)| *path == place).map(|(_, name, _)| name);
        let own = own.map(|name| world.config.octrees().join(name).join("metadata.json"));
        if let Some(Ok(shown)) = own.map(fs::read_to_string)
            && content::nature(&content) == Nature::Good
            && world.ordered.is_empty()
            && world.config.on_done == OnDone::Keep
            && !world.trust.meddled
        {
            // Where its own job failed, the list says so, and the old octree stays.
            let current = books.data_sets.iter().find(|(path, ..)| *path == place).and_then(|(.., job)| *job);
            let done = jobs.iter().any(|job| Some(job.id) == current && job.state == State::Done);
            law!(shown == content || !done, "{place} holds {content}, and its octree shows {shown}");
        }
        let of_content: Vec<&Job> = jobs.iter().filter(|job| books.contents[&job.id] == content).collect();
        let stands = of_content.iter().find(|job| job.state == State::Done && job.superseded_by.is_none());
        if let Some(job) = stands {
            let shown = fs::read_to_string(world.config.octrees().join(&job.name).join("metadata.json"));
            law!(
                shown.as_ref().ok() == Some(&content) || world.trust.meddled,
                "job {} is done, and {} shows {shown:?}",
                job.id,
                job.name
            );
            continue;
        }
        let data_set = books.data_sets.iter().find(|(path, ..)| *path == place);
        let job = data_set.and_then(|(_, _, job)| *job);
        // A file that failed long ago, or that somebody called off, stays known, though its
        // record is purged.
        let purged = world.ledger.states.iter().any(|(id, state)| {
            let ended = matches!(state, State::Failed | State::Quarantined)
                || (*state == State::Cancelled && world.ordered.contains(id));
            ended && world.ledger.contents[id] == content && jobs.iter().all(|job| job.id != *id)
        });
        if data_set.is_some() && job.is_none() && purged {
            continue;
        }
        let job = jobs.iter().find(|j| Some(j.id) == job).ok_or(format!("{place} was never taken in"))?;
        law!(books.contents[&job.id] == content, "{place} has newer content than its job {}", job.id);
        let bad = content::nature(&content) != Nature::Good;
        match job.state {
            State::Failed | State::Quarantined if bad || job.strikes > 0 || job.postponements > 0 => {}
            State::Cancelled if world.ordered.contains(&job.id) => {}
            state => return Err(format!("{place} ends {state:?} as job {}: {job:#?}", job.id)),
        }
    }
    pictures(world, &jobs)?;
    for folder in [world.config.scratch(), world.config.octrees().join(".staged")] {
        for entry in fs::read_dir(&folder).expect("there").flatten() {
            let name = entry.file_name().to_string_lossy().into_owned();
            let job: Option<i64> = name.trim_start_matches("job-").parse().ok();
            let open = jobs.iter().any(|j| Some(j.id) == job && j.state.is_open());
            law!(open, "{} is left over", entry.path().display());
        }
    }
    Ok(())
}

/// No octree that stands waits for its pictures, and what is said to be drawn is there.
fn pictures(world: &mut World, jobs: &[Job]) -> Result<(), Broken> {
    let octrees = world.config.octrees();
    let life = world.life.as_ref().expect("alive");
    let standing = jobs.iter().filter(|job| job.state == State::Done && job.superseded_by.is_none());
    let standing: BTreeMap<i64, &Job> = standing.map(|job| (job.id, job)).collect();
    let ids: Vec<i64> = standing.keys().copied().collect();
    let previews = life.runtime.block_on(life.store.previews(&ids)).map_err(|error| error.to_string())?;
    for (id, job) in standing {
        let place = octrees.join(&job.name);
        let Some(preview) = previews.get(&id) else {
            // Dropped with an octree that was taken away, or could not be put in its place.
            law!(
                world.was_sick || world.trust.meddled || !place.exists(),
                "job {id} is done and owes no pictures"
            );
            continue;
        };
        law!(preview.state != Drawn::Queued, "the pictures of job {id} still wait: {preview:?}");
        let there = place.join("preview/preview.json").exists();
        law!(
            there || preview.state != Drawn::Done || world.was_sick || world.trust.meddled,
            "the pictures of job {id} are not there"
        );
    }
    let left: Vec<_> = fs::read_dir(octrees.join(".previews")).into_iter().flatten().flatten().collect();
    law!(left.is_empty(), "left over: {left:?}");
    Ok(())
}
