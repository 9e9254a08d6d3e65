//! The board: how far each running job is. In memory only, for it changes many
//! times a second and is worth nothing after a crash. The engine hangs up a job's
//! progress when it starts it; the API and the metrics read it.

use std::collections::{HashMap, VecDeque};
use std::sync::{Arc, Mutex, PoisonError};

use serde::Serialize;

use crate::convert::context::{Progress, Snapshot, Stage};
use crate::platform::clock::Millis;
use crate::serve::job::JobId;

/// How far a job is, as told to people and machines.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ProgressReading {
    pub stage: &'static str,
    /// Percent of this stage.
    pub percent: f64,
    /// Points of this stage.
    pub points_done: u64,
    pub points_total: u64,
    pub points_per_second: f64,
    /// Until the end of this stage, at the present rate.
    pub seconds_left: Option<f64>,
    /// Percent of the whole conversion, by what stages usually take of it.
    pub whole_percent: f64,
    /// Until the end of the conversion, judged by what it took so far.
    pub whole_seconds_left: Option<f64>,
}

/// What the stages usually take of a conversion, in percent.
const SHARES: [(Stage, f64); 5] = [
    (Stage::Survey, 40.0),
    (Stage::Distribute, 14.0),
    (Stage::Index, 36.0),
    (Stage::Merge, 7.0),
    (Stage::Publish, 3.0),
];
/// Percent of a conversion before which its end is anybody's guess.
const GUESS: f64 = 3.0;

/// How often the rate of all conversions together is noted, and how many of these
/// notes are kept: half an hour.
const NOTE: Millis = 10_000;
const NOTES: usize = 180;

#[derive(Debug)]
struct RunningEntry {
    progress: Arc<Progress>,
    stage: Stage,
    /// When the present stage was first seen, and how many points it had done.
    since: Millis,
    first: u64,
    last: Snapshot,
    moved_at: Millis,
    begun: Millis,
    /// Points that it has done of the whole, as counted when last looked at.
    counted: f64,
}

/// Points a second of all conversions together, over time.
#[derive(Debug, Default)]
struct Rates {
    notes: VecDeque<f64>,
    since: Option<Millis>,
    points: f64,
}

#[derive(Debug, Default)]
struct Entries {
    jobs: HashMap<JobId, RunningEntry>,
    rates: Rates,
}

/// Progress of all running jobs. Cheap to clone.
#[derive(Debug, Clone, Default)]
pub struct ProgressRegistry(Arc<Mutex<Entries>>);

impl ProgressRegistry {
    pub fn hang_up(&self, job: JobId, progress: Arc<Progress>, now: Millis) {
        let last = progress.snapshot();
        let entry = RunningEntry {
            progress,
            stage: last.stage,
            since: now,
            first: last.done,
            last,
            moved_at: now,
            begun: now,
            counted: 0.0,
        };
        self.with(|entries| entries.jobs.insert(job, entry));
    }

    pub fn take_down(&self, job: JobId) {
        self.with(|entries| entries.jobs.remove(&job));
    }

    /// Looks at every job; returns when each last moved.
    pub fn look(&self, now: Millis) -> Vec<JobProgress> {
        self.with(|entries| {
            let points = entries.jobs.values_mut().map(RunningEntry::count).sum();
            entries.rates.note(points, now);
            entries.jobs.iter_mut().map(|(job, entry)| entry.look(*job, now)).collect()
        })
    }

    pub fn read(&self, job: JobId, now: Millis) -> Option<ProgressReading> {
        self.with(|entries| entries.jobs.get(&job).map(|entry| entry.reading(now)))
    }

    /// How far all running jobs are.
    pub fn readings(&self, now: Millis) -> Vec<(JobId, ProgressReading)> {
        let mut readings: Vec<_> =
            self.with(|entries| entries.jobs.iter().map(|(job, entry)| (*job, entry.reading(now))).collect());
        readings.sort_by_key(|(job, _)| *job);
        readings
    }

    /// Points a second of all conversions together, a figure for every ten seconds
    /// of the last half hour, the oldest first. A point counts once for all stages.
    pub fn rates(&self) -> Vec<f64> {
        self.with(|entries| entries.rates.notes.iter().copied().collect())
    }

    fn with<T>(&self, use_it: impl FnOnce(&mut Entries) -> T) -> T {
        // The entries are plain figures: one that a panic left behind is still
        // readable.
        use_it(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

/// One look at one job.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JobProgress {
    pub job: JobId,
    pub moved_at: Millis,
}

impl Rates {
    fn note(&mut self, points: f64, now: Millis) {
        self.points += points;
        let since = *self.since.get_or_insert(now);
        let passed = now - since;
        // A clock that was set begins anew.
        if !(0..NOTE * NOTES as Millis).contains(&passed) {
            (self.since, self.points) = (Some(now), 0.0);
        } else if passed >= NOTE {
            self.notes.push_back(1000.0 * self.points / passed as f64);
            if self.notes.len() > NOTES {
                self.notes.pop_front();
            }
            (self.since, self.points) = (Some(now), 0.0);
        }
    }
}

/// How much of a conversion is done, from 0 to 1.
fn whole(snapshot: &Snapshot) -> f64 {
    if snapshot.stage == Stage::Queued {
        return 0.0;
    }
    let mut before = 0.0;
    for (stage, share) in SHARES {
        if stage == snapshot.stage {
            let part = if snapshot.total == 0 { 0.0 } else { snapshot.done as f64 / snapshot.total as f64 };
            return (before + share * part) / 100.0;
        }
        before += share;
    }
    before / 100.0
}

impl RunningEntry {
    /// Points done since the last count, where a point is done when all stages are.
    fn count(&mut self) -> f64 {
        let snapshot = self.progress.snapshot();
        let done = whole(&snapshot) * snapshot.total as f64;
        // Stages may count other points than those before them.
        let more = (done - self.counted).max(0.0);
        self.counted = done;
        more
    }

    fn look(&mut self, job: JobId, now: Millis) -> JobProgress {
        let snapshot = self.progress.snapshot();
        if snapshot.stage != self.stage {
            (self.stage, self.since, self.first) = (snapshot.stage, now, 0);
        }
        if snapshot != self.last {
            (self.last, self.moved_at) = (snapshot, now);
        }
        JobProgress { job, moved_at: self.moved_at }
    }

    fn reading(&self, now: Millis) -> ProgressReading {
        let snapshot = self.progress.snapshot();
        let (since, first) =
            if snapshot.stage == self.stage { (self.since, self.first) } else { (now, snapshot.done) };
        let seconds = (now - since).max(0) as f64 / 1000.0;
        let rate = if seconds > 0.0 { snapshot.done.saturating_sub(first) as f64 / seconds } else { 0.0 };
        let left = snapshot.total.saturating_sub(snapshot.done) as f64;
        let (whole, took) = (100.0 * whole(&snapshot), (now - self.begun).max(0) as f64 / 1000.0);
        ProgressReading {
            whole_percent: whole,
            whole_seconds_left: (whole >= GUESS).then(|| took * (100.0 - whole) / whole),
            stage: snapshot.stage.name(),
            percent: if snapshot.total == 0 {
                0.0
            } else {
                100.0 * snapshot.done as f64 / snapshot.total as f64
            },
            points_done: snapshot.done,
            points_total: snapshot.total,
            points_per_second: rate,
            seconds_left: (rate > 0.0).then(|| left / rate),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reading_tells_rate_and_time_left_of_the_stage() {
        let (board, progress) = (ProgressRegistry::default(), Arc::new(Progress::default()));
        board.hang_up(7, progress.clone(), 0);
        progress.begin(Stage::Index, 1000);
        board.look(1000);
        progress.advance(250);
        let reading = board.read(7, 2000).expect("hung up");
        assert_eq!((reading.stage, reading.percent, reading.points_per_second), ("index", 25.0, 250.0));
        assert_eq!(reading.seconds_left, Some(3.0));
        board.look(2000);
        assert_eq!(board.look(9000)[0].moved_at, 2000, "it has not moved since");
        board.take_down(7);
        assert_eq!(board.read(7, 2000), None);
    }

    #[test]
    fn a_job_that_has_not_begun_reads_as_zero_not_as_nan() {
        let board = ProgressRegistry::default();
        board.hang_up(1, Arc::new(Progress::default()), 5);
        let reading = board.read(1, 5).expect("hung up");
        assert_eq!((reading.percent, reading.points_per_second, reading.seconds_left), (0.0, 0.0, None));
    }
}
