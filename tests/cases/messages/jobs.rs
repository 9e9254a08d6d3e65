//! What lists, the API and the log tell of a job: by what it was superseded, dates,
//! durations, true counts and warnings.

use std::fs;
use std::path::Path;

use lodestone::serve::job::retry_policy::{AttemptEnd, Policy};
use lodestone::serve::job::{Event, Job, QueuedFile, State};
use lodestone::serve::queue::{AttemptResult, DataSetKind, NewDataSet, Store};
use serde_json::Value;

use super::{lodestone, stderr, stdout, text};
use crate::daemon_support::{Daemon, fill_folder, las, wait_for};

fn arrival(content: &str) -> NewDataSet {
    NewDataSet {
        path: "/in/a.las".into(),
        kind: DataSetKind::File,
        name: "a".into(),
        stamp: content.into(),
        content_key: content.into(),
        inputs: vec![QueuedFile {
            path: "/in/a.las".into(),
            size: 9,
            mtime_ns: 0,
            ctime_ns: 0,
            inode: 0,
            hash: content.into(),
        }],
        options: "{}".into(),
        priority: 0,
        points: 0,
        doubt: None,
        refusal: None,
        octrees: "/nowhere".into(),
    }
}

async fn end(store: &Store, job: i64, end: AttemptEnd, error: Option<&str>) -> Job {
    let ending = AttemptResult { end, error: error.map(str::to_string) };
    store.finish(job, "me", &ending, &Policy::default(), 5000).await.expect("recorded").expect("ours");
    store.job(job).await.expect("there")
}

fn with_store(run: impl AsyncFnOnce(Store)) {
    let root = tempfile::tempdir().expect("a folder");
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().expect("a runtime");
    runtime.block_on(async {
        let store = Store::open(&root.path().join("lodestone.db")).await.expect("opened");
        run(store.clone()).await;
        store.close().await;
    });
}

#[test]
fn a_superseded_job_says_by_which() {
    with_store(async |store| {
        // Waiting.
        let first = store.take_in(&arrival("one"), 0).await.expect("taken").job();
        let second = store.take_in(&arrival("two"), 1).await.expect("taken").job();
        let told = store.job(first).await.expect("there");
        assert_eq!((told.state, told.superseded_by), (State::Cancelled, Some(second)));
        assert!(told.error.expect("a reason").contains(&format!("job {second}")));
        // Running.
        store.claim(second, "me", 2).await.expect("asked").expect("claimed");
        let third = store.take_in(&arrival("three"), 3).await.expect("taken").job();
        let told = end(&store, second, AttemptEnd::Cancelled, None).await;
        assert_eq!((told.state, told.superseded_by), (State::Cancelled, Some(third)));
        assert!(told.error.expect("a reason").contains(&format!("job {third}")));
        // Done.
        store.claim(third, "me", 4).await.expect("asked").expect("claimed");
        assert_eq!(end(&store, third, AttemptEnd::Published, None).await.superseded_by, None);
        let fourth = store.take_in(&arrival("four"), 5).await.expect("taken").job();
        store.claim(fourth, "me", 6).await.expect("asked").expect("claimed");
        end(&store, fourth, AttemptEnd::Published, None).await;
        assert_eq!(store.job(third).await.expect("there").superseded_by, Some(fourth));
        // Its content comes back: it is no longer superseded.
        let again = store.take_in(&arrival("two"), 7).await.expect("taken").job();
        let told = store.job(again).await.expect("there");
        assert_eq!((again, told.state, told.superseded_by, told.error), (second, State::Queued, None, None));
    });
}

#[test]
fn a_requeued_job_shows_no_old_error() {
    with_store(async |store| {
        let job = store.take_in(&arrival("one"), 0).await.expect("taken").job();
        for event in [Event::Retry, Event::Retry] {
            store.claim(job, "me", 1).await.expect("asked").expect("claimed");
            let told = end(&store, job, AttemptEnd::Hopeless, Some("it is broken")).await;
            assert!(told.error.expect("why").contains("it is broken"));
            store.order(job, event, 2).await.expect("ordered");
            let told = store.job(job).await.expect("there");
            assert_eq!((told.state, told.error, told.finished_at), (State::Queued, None, None));
        }
        // Written again, and so released; the history remembers.
        store.claim(job, "me", 3).await.expect("asked").expect("claimed");
        end(&store, job, AttemptEnd::Hopeless, Some("it is broken")).await;
        assert_eq!(store.take_in(&arrival("one"), 4).await.expect("taken").job(), job);
        assert_eq!(store.job(job).await.expect("there").error, None);
        let history = store.history(job).await.expect("read");
        assert!(history.iter().any(|line| line.detail.as_deref().is_some_and(|d| d.contains("broken"))));
        // One that is tried again by itself says why.
        store.claim(job, "me", 5).await.expect("asked").expect("claimed");
        let told = end(&store, job, AttemptEnd::Passing, Some("the disk is away")).await;
        assert_eq!((told.state, told.error.as_deref()), (State::Queued, Some("the disk is away")));
    });
}

/// LAS 1.2 of format 1 with these GPS times.
fn las_with_times(times: &[f64]) -> Vec<u8> {
    let plain = las(times.len() as u32, 3);
    let (header, records) = plain.split_at(227);
    let mut bytes = header.to_vec();
    bytes[104] = 1;
    bytes[105..107].copy_from_slice(&28u16.to_le_bytes());
    for (record, time) in records.chunks_exact(20).zip(times) {
        bytes.extend_from_slice(record);
        bytes.extend_from_slice(&time.to_le_bytes());
    }
    bytes
}

/// A box that is not that of the points.
fn with_wrong_box(mut las: Vec<u8>) -> Vec<u8> {
    for (at, value) in [(179, 5000.0f64), (187, -3.0), (195, f64::NAN), (203, 0.0)] {
        las[at..at + 8].copy_from_slice(&value.to_le_bytes());
    }
    las
}

/// 1000 points, of which the last lies far away.
fn with_outlier() -> Vec<u8> {
    let mut las = las(1000, 4);
    let at = las.len() - 20;
    las[at..at + 4].copy_from_slice(&2_000_000_000i32.to_le_bytes());
    las
}

fn warnings(job: &Value) -> String {
    job["warnings"].to_string()
}

#[test]
fn jobs_tell_true_counts_dates_and_warnings() {
    let root = tempfile::tempdir().expect("a folder");
    let data = root.path().join("data");
    let daemon = Daemon::start_with(&data, &["--damaged", "keep", "--patience-seconds", "0.5"]);
    let times: Vec<f64> = (0..2000).map(|i| if i % 500 == 7 { f64::NAN } else { f64::from(i) }).collect();
    fill_folder(
        &daemon.inbox(),
        &[
            ("times.las", las_with_times(&times)),
            ("infinite.las", las_with_times(&[1.0, f64::INFINITY, 3.0])),
            ("box.las", with_wrong_box(las(1500, 2))),
            ("cut.las", las(1000, 1)[..227 + 20 * 600].to_vec()),
            ("far.las", with_outlier()),
        ],
    );
    for (name, points, missing, set_aside, word) in [
        ("times", 2000, 0, 0, "4 values that are no numbers"),
        ("infinite", 3, 0, 0, "1 value that is no number"),
        ("box", 1500, 0, 0, "bounding box is not the points' own"),
        ("cut", 600, 400, 0, "400 of the 1000 points"),
        ("far", 1000, 0, 1, "1 point set aside as outlier, in set-aside.laz"),
    ] {
        let job = daemon.wait(name, "done");
        let count = |key: &str| job[key].as_u64();
        assert_eq!(count("points"), Some(points), "{name}");
        assert_eq!(count("points_written"), Some(points - set_aside), "{name}");
        assert_eq!(count("points_missing"), Some(missing), "{name}");
        assert_eq!(count("points_set_aside"), Some(set_aside), "{name}");
        assert!(warnings(&job).contains(word), "{name}: {}", warnings(&job));
        assert!(job["duration_seconds"].as_f64().is_some_and(|s| (0.0..600.0).contains(&s)), "{job}");
        wait_for("the log to tell the warning", || daemon.log().contains(word).then_some(()));
        let details = daemon.json(&format!("/api/jobs/{}", job["id"]));
        for (at, iso) in [("created_at", "created_at_iso"), ("finished_at", "finished_at_iso")] {
            let iso = details[iso].as_str().expect("a date");
            let millis = details[at].as_i64().expect("millis");
            assert!(iso.len() == 24 && iso.ends_with(&format!(".{:03}Z", millis % 1000)), "{iso} {millis}");
        }
        let attempt = &details["attempts_log"][0];
        assert!(
            attempt["started_at_iso"].is_string() && attempt["duration_seconds"].is_number(),
            "{attempt}"
        );
        assert!(details["history"][0]["at_iso"].as_str().is_some_and(|at| at.ends_with('Z')), "{details}");
    }
    told_on_the_command_line(&data, &daemon);
}

fn told_on_the_command_line(data: &Path, daemon: &Daemon) {
    let list = lodestone(&["jobs", "list", "--root", text(data)]);
    let list = stdout(&list);
    let line = |name: &str| list.lines().find(|line| line.contains(name)).expect("listed").to_string();
    assert!(list.starts_with("#  NAME") && list.contains("CREATED") && list.contains("TOOK"), "{list}");
    assert!(line(" cut ").contains(" 600 ") && line(" cut ").contains("400 missing"), "{list}");
    assert!(line(" far ").contains("1 set aside") && line(" times ").contains("warning"), "{list}");
    let job = daemon.jobs().into_iter().find(|job| job["name"] == "cut").expect("there");
    let id = job["id"].to_string();
    let show = stdout(&lodestone(&["jobs", "show", &id, "--root", text(data)]));
    let date = job["created_at_iso"].as_str().expect("a date");
    for word in [date, "400 missing", "400 of the 1000 points", "finished", "history, the latest first"] {
        assert!(show.contains(word), "{word} is missing in: {show}");
    }
    let json = lodestone(&["jobs", "show", &id, "--json", "--root", text(data)]);
    let json: Value = serde_json::from_slice(&json.stdout).expect("JSON");
    assert_eq!((&json["points"], &json["warnings"]), (&job["points"], &job["warnings"]));
    assert!(json["inputs"].is_array() && json["attempts_log"].is_array() && json["history"].is_array());
}

#[test]
fn lists_are_bounded_and_say_so() {
    let root = tempfile::tempdir().expect("a folder");
    let data = root.path().join("data");
    let daemon = Daemon::start(&data);
    let names: Vec<String> = (0..30).map(|i| format!("tile {i:02}.las")).collect();
    let tiles: Vec<(&str, Vec<u8>)> =
        names.iter().zip(10..).map(|(name, seed)| (name.as_str(), las(20, seed))).collect();
    daemon.drop_folder("tiles", &tiles);
    fs::write(daemon.inbox().join("other.las"), las(20, 1)).expect("dropped");
    daemon.wait("tiles", "done");
    daemon.wait("other", "done");
    let list = lodestone(&["jobs", "list", "--limit", "1", "--root", text(&data)]);
    assert!(stdout(&list).contains("the youngest 1 of 2 jobs; `--limit 2` shows all"), "{}", stdout(&list));
    let all = stdout(&lodestone(&["jobs", "list", "--root", text(&data)]));
    assert!(!all.contains("--limit"), "{all}");
    let id = daemon.wait("tiles", "done")["id"].to_string();
    let show = lodestone(&["jobs", "show", &id, "--root", text(&data)]);
    assert!(stdout(&show).contains("… and 10 more; `--json` shows all"), "{}", stdout(&show));
    let inputs = stdout(&show).lines().filter(|line| line.contains(".las  ")).count();
    assert_eq!(inputs, 20, "{}", stdout(&show));
    let missing = lodestone(&["jobs", "show", "77", "--root", text(&data)]);
    assert_eq!(missing.status.code(), Some(1));
    assert!(stderr(&missing).contains("no job 77"), "{}", stderr(&missing));
}

#[test]
fn guards_say_when_they_did_not_look() {
    let root = tempfile::tempdir().expect("a folder");
    let input = root.path().join("a.las");
    let report = |points: u32, more: &[&str]| -> Value {
        fs::write(&input, las(points, 1)).expect("written");
        let octree = root.path().join("octree");
        let arguments = ["convert", text(&input), "-o", text(&octree), "--overwrite"];
        let run = lodestone(&[&arguments[..], more].concat());
        assert!(run.status.success(), "{}", stderr(&run));
        let report = fs::read(octree.join("report.json")).expect("there");
        serde_json::from_slice::<Value>(&report).expect("JSON")["guards"].clone()
    };
    let looked = |guards: &Value, at: usize| {
        (guards[at]["looked"].as_bool().expect("said"), guards[at]["not_looked_because"].is_string())
    };
    let usual = report(1000, &[]);
    assert_eq!(
        [looked(&usual, 0), looked(&usual, 1), looked(&usual, 2)],
        [(true, false), (true, false), (false, true)]
    );
    let off = report(1000, &["--outliers", "keep", "--duplicates", "keep", "--twins", "drop"]);
    assert_eq!(
        [looked(&off, 0), looked(&off, 1), looked(&off, 2)],
        [(false, true), (false, true), (true, false)]
    );
    let few = report(49, &[]);
    assert_eq!(looked(&few, 0), (false, true));
    assert!(few[0]["not_looked_because"].to_string().contains("too few"), "{few}");
}
