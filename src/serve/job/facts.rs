//! What follows from a job's record and is told beside it, in lists and in the API:
//! dates, how long it took, what became of its points, and what was odd.

use serde::Serialize;
use serde_json::Value;

use super::time::iso8601;
use super::{Job, State};

/// Warnings that a list tells of one job; `report.json` has all.
const MAX_WARNINGS: usize = 50;

/// What is derived from a [`Job`]. Each time `…_at` of a job stands here once more as
/// `…_at_iso`, in ISO 8601 with its zone, which is always UTC.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Facts {
    pub created_at_iso: String,
    pub started_at_iso: Option<String>,
    pub updated_at_iso: String,
    pub finished_at_iso: Option<String>,
    /// When a job that waits may start at the earliest; none where it may at once.
    pub not_before_iso: Option<String>,
    /// How long the last run took, or has taken so far; none of a job that waits.
    pub duration_seconds: Option<f64>,
    /// Points in the octree, once there is one.
    pub points_written: Option<u64>,
    /// Points that were kept out of the octree, dropped ones too, once there is one.
    pub points_set_aside: Option<u64>,
    /// Those of them that are in no file, as was asked for.
    pub points_dropped: Option<u64>,
    /// Points that the inputs promise and that could not be read, once that is known.
    pub points_missing: Option<u64>,
    /// What was odd about the inputs and what was done about it; the first
    /// fifty, and how many more there are.
    pub warnings: Vec<String>,
}

impl Facts {
    /// `now` in milliseconds since 1970.
    pub fn of(job: &Job, now: i64) -> Facts {
        let end = match job.state {
            State::Running => Some(now),
            _ => job.finished_at,
        };
        let duration = job.started_at.zip(end).map(|(start, end)| (end - start).max(0) as f64 / 1000.0);
        let waits = job.state == State::Queued && job.not_before > 0;
        let result = job.result.as_ref().filter(|_| job.state == State::Done);
        let count = |key: &str| result.and_then(|result| result[key].as_u64());
        Facts {
            created_at_iso: iso8601(job.created_at),
            started_at_iso: job.started_at.map(iso8601),
            updated_at_iso: iso8601(job.updated_at),
            finished_at_iso: job.finished_at.map(iso8601),
            not_before_iso: waits.then(|| iso8601(job.not_before)),
            duration_seconds: duration,
            points_written: count("points_out"),
            points_set_aside: count("points_set_aside"),
            points_dropped: count("points_dropped"),
            points_missing: count("points_missing"),
            warnings: result.map(warnings).unwrap_or_default(),
        }
    }
}

fn warnings(result: &Value) -> Vec<String> {
    let all = ["repairs", "notes"].into_iter().flat_map(|key| result[key].as_array().into_iter().flatten());
    let mut all: Vec<String> = all.filter_map(|line| line.as_str().map(str::to_string)).collect();
    if let Some(more @ 1..) = all.len().checked_sub(MAX_WARNINGS) {
        all.truncate(MAX_WARNINGS);
        all.push(format!("and {more} more, in report.json"));
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn job(state: State, result: Option<Value>) -> Job {
        Job {
            id: 1,
            name: "a".into(),
            source: "/a.las".into(),
            revision: 1,
            state,
            hold: None,
            error: None,
            wish: None,
            priority: 0,
            attempts: 1,
            strikes: 0,
            postponements: 0,
            not_before: 0,
            points: 0,
            bytes: 0,
            created_at: 0,
            started_at: Some(1000),
            updated_at: 0,
            finished_at: (!state.is_open()).then_some(3500),
            staged: None,
            octree: None,
            doubt: None,
            refusal: None,
            superseded_by: None,
            result,
            content_key: String::new(),
            options: Value::Null,
        }
    }

    #[test]
    fn a_finished_job_tells_counts_and_warnings() {
        let result = json!({"points_out": 7, "points_set_aside": 2, "points_dropped": 0,
                            "points_missing": 3, "repairs": ["box"], "notes": ["odd", 5]});
        let facts = Facts::of(&job(State::Done, Some(result.clone())), 9000);
        assert_eq!(facts.duration_seconds, Some(2.5));
        assert_eq!((facts.points_written, facts.points_set_aside), (Some(7), Some(2)));
        assert_eq!((facts.points_dropped, facts.points_missing), (Some(0), Some(3)));
        assert_eq!(facts.warnings, ["box", "odd"]);
        assert_eq!(facts.finished_at_iso.as_deref(), Some("1970-01-01T00:00:03.500Z"));
        let running = Facts::of(&job(State::Running, Some(result)), 9000);
        assert_eq!((running.duration_seconds, running.points_written), (Some(8.0), None));
        assert!(running.warnings.is_empty());
    }

    #[test]
    fn warnings_are_bounded_and_say_so() {
        let notes: Vec<String> = (0..1000).map(|i| format!("note {i}")).collect();
        let facts = Facts::of(&job(State::Done, Some(json!({ "notes": notes }))), 0);
        assert_eq!(facts.warnings.len(), MAX_WARNINGS + 1);
        assert_eq!(facts.warnings.last().map(String::as_str), Some("and 950 more, in report.json"));
        assert_eq!(Facts::of(&job(State::Done, Some(json!([1]))), 0).warnings, Vec::<String>::new());
    }
}
