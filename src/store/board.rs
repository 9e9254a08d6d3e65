//! The board: how far each running job is. In memory only, for it changes many
//! times a second and is worth nothing after a crash. The engine hangs up a job's
//! progress when it starts it; the API and the metrics read it.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

use serde::Serialize;

use crate::clock::Millis;
use crate::job::JobId;
use crate::stage::context::{Progress, Snapshot, Stage};

/// How far a job is, as told to people and machines.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Reading {
    pub stage: &'static str,
    /// Percent of this stage.
    pub percent: f64,
    /// Points of this stage.
    pub points_done: u64,
    pub points_total: u64,
    pub points_per_second: f64,
    /// Until the end of this stage, at the present rate.
    pub seconds_left: Option<f64>,
}

#[derive(Debug)]
struct Entry {
    progress: Arc<Progress>,
    stage: Stage,
    /// When the present stage was first seen, and how many points it had done.
    since: Millis,
    first: u64,
    last: Snapshot,
    moved_at: Millis,
}

/// Progress of all running jobs. Cheap to clone.
#[derive(Debug, Clone, Default)]
pub struct Board(Arc<Mutex<HashMap<JobId, Entry>>>);

impl Board {
    pub fn hang_up(&self, job: JobId, progress: Arc<Progress>, now: Millis) {
        let last = progress.snapshot();
        let entry = Entry { progress, stage: last.stage, since: now, first: last.done, last, moved_at: now };
        self.with(|entries| entries.insert(job, entry));
    }

    pub fn take_down(&self, job: JobId) {
        self.with(|entries| entries.remove(&job));
    }

    /// Looks at every job; returns when each last moved.
    pub fn look(&self, now: Millis) -> Vec<Look> {
        self.with(|entries| entries.iter_mut().map(|(job, entry)| entry.look(*job, now)).collect())
    }

    pub fn read(&self, job: JobId, now: Millis) -> Option<Reading> {
        self.with(|entries| entries.get(&job).map(|entry| entry.reading(now)))
    }

    /// How far all running jobs are.
    pub fn readings(&self, now: Millis) -> Vec<(JobId, Reading)> {
        let mut readings: Vec<_> =
            self.with(|entries| entries.iter().map(|(job, entry)| (*job, entry.reading(now))).collect());
        readings.sort_by_key(|(job, _)| *job);
        readings
    }

    fn with<T>(&self, use_it: impl FnOnce(&mut HashMap<JobId, Entry>) -> T) -> T {
        // The entries are plain figures: one that a panic left behind is still
        // readable.
        use_it(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

/// One look at one job.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Look {
    pub job: JobId,
    pub moved_at: Millis,
}

impl Entry {
    fn look(&mut self, job: JobId, now: Millis) -> Look {
        let snapshot = self.progress.snapshot();
        if snapshot.stage != self.stage {
            (self.stage, self.since, self.first) = (snapshot.stage, now, 0);
        }
        if snapshot != self.last {
            (self.last, self.moved_at) = (snapshot, now);
        }
        Look { job, moved_at: self.moved_at }
    }

    fn reading(&self, now: Millis) -> Reading {
        let snapshot = self.progress.snapshot();
        let (since, first) =
            if snapshot.stage == self.stage { (self.since, self.first) } else { (now, snapshot.done) };
        let seconds = (now - since).max(0) as f64 / 1000.0;
        let rate = if seconds > 0.0 { snapshot.done.saturating_sub(first) as f64 / seconds } else { 0.0 };
        let left = snapshot.total.saturating_sub(snapshot.done) as f64;
        Reading {
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
        let (board, progress) = (Board::default(), Arc::new(Progress::default()));
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
        let board = Board::default();
        board.hang_up(1, Arc::new(Progress::default()), 5);
        let reading = board.read(1, 5).expect("hung up");
        assert_eq!((reading.percent, reading.points_per_second, reading.seconds_left), (0.0, 0.0, None));
    }
}
