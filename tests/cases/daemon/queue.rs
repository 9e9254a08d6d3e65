//! The queue and the engine on a real SQLite file, with conversions that fail,
//! panic, hang until they are stopped, or succeed, and a clock that is set by
//! hand.

use std::collections::HashMap;
use std::path::Path;
use std::sync::Mutex;
use std::time::Duration;

use crate::engine_support::wait;
use lodestone::convert::context::{Context, Stage};
use lodestone::platform::clock::Clock;
use lodestone::serve::job::{Event, Job, State};
use lodestone::serve::queue::{EnqueueResult, Store, StoreError};
use lodestone::serve::scheduler::Engine;
use lodestone::serve::scheduler::converter::{ConversionResult, Converter, Failure, Work};

type House = crate::engine_support::House<Script>;

/// What the fake conversion of a data set does, try after try; the last for ever.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Act {
    Succeed,
    FailForGood,
    FailForNow,
    Panic,
    /// Works until it is told to stop.
    Hang,
    /// Rewrites its own input while it works.
    Disturbed,
}

#[derive(Default)]
struct Script {
    acts: Mutex<HashMap<String, Vec<Act>>>,
    runs: Mutex<Vec<String>>,
}

impl Converter for Script {
    fn convert(&self, work: &Work, context: &Context) -> Result<ConversionResult, Failure> {
        let name = work.options.name.clone().unwrap_or_default();
        let act = {
            let mut acts = self.acts.lock().unwrap();
            let acts = acts.entry(name.clone()).or_insert_with(|| vec![Act::Succeed]);
            if acts.len() > 1 { acts.remove(0) } else { acts[0] }
        };
        context.progress.begin(Stage::Survey, 10);
        std::fs::create_dir_all(&context.scratch).unwrap();
        // Last, for this is what tests wait for: see `at_work`.
        self.runs.lock().unwrap().push(name.clone());
        let failure = |may_pass| Failure { message: format!("{name} said no"), may_pass, panicked: false };
        match act {
            Act::FailForGood => return Err(failure(false)),
            Act::FailForNow => return Err(failure(true)),
            Act::Panic => panic!("a worker's panic, on purpose"),
            Act::Hang => {
                while !context.cancel.is_cancelled() {
                    std::thread::sleep(Duration::from_millis(1));
                }
                return Err(failure(true));
            }
            Act::Disturbed => std::fs::write(&work.inputs[0], "other content than before").unwrap(),
            Act::Succeed => {}
        }
        std::fs::create_dir_all(&work.output).unwrap();
        let content = std::fs::read(&work.inputs[0]).unwrap();
        std::fs::write(work.output.join("metadata.json"), content).unwrap();
        Ok(ConversionResult {
            points_in: 10,
            points_out: 10,
            json: serde_json::json!({"points_out": 10}),
            ..ConversionResult::default()
        })
    }
}

/// What the queue's tests ask of their house.
impl House {
    fn acts(&self, name: &str, acts: &[Act]) {
        self.converter.acts.lock().unwrap().insert(name.into(), acts.to_vec());
    }

    fn runs(&self) -> Vec<String> {
        self.converter.runs.lock().unwrap().clone()
    }

    /// Turns the wheel until the job runs, and waits until the `nth` run of all is
    /// at work: that a job is running says nothing of its thread yet.
    async fn at_work(&mut self, id: i64, nth: usize) -> Job {
        let job = self.turn_until(id, State::Running).await;
        let script = self.converter.clone();
        wait("the run", || script.runs.lock().unwrap().len() == nth).await;
        job
    }

    fn octree(&self, name: &str) -> Option<String> {
        std::fs::read_to_string(self.folder.path().join("octrees").join(name).join("metadata.json")).ok()
    }

    fn left_over(&self) -> usize {
        let count = |sub: &str| std::fs::read_dir(self.folder.path().join(sub)).unwrap().count();
        count("scratch") + count("octrees/.staged")
    }
}

const PLAIN: &str = "disk_reserve = 0\nshutdown_seconds = 5";

fn id(admission: EnqueueResult) -> i64 {
    admission.job()
}

#[tokio::test]
async fn a_job_is_published_and_leaves_nothing_behind() {
    let mut house = House::new(PLAIN).await;
    let job = id(house.drop_file("a", "one").await);
    let job = house.turn_until(job, State::Done).await;
    assert_eq!((job.attempts, job.strikes), (1, 0));
    assert_eq!(house.octree("a").as_deref(), Some("one"));
    assert_eq!(house.left_over(), 0);
}

#[tokio::test]
async fn hopeless_jobs_fail_at_once_and_poison_ends_in_quarantine_until_the_file_changes() {
    let mut house = House::new(PLAIN).await;
    house.acts("bad", &[Act::FailForGood]);
    let job = id(house.drop_file("bad", "rubbish").await);
    let failed = house.turn_until(job, State::Failed).await;
    assert_eq!((failed.attempts, failed.strikes), (1, 1));
    assert_eq!(failed.error.as_deref(), Some("bad said no"));
    for state in [State::Failed, State::Quarantined] {
        house.tools.store.order(job, Event::Retry, 0).await.unwrap();
        house.turn_until(job, state).await;
    }
    let error = house.job(job).await.error.unwrap();
    assert!(error.contains("bad said no") && error.contains("quarantine"), "{error}");

    house.acts("bad", &[Act::Succeed]);
    assert_eq!(house.drop_file("bad", "rubbish").await, EnqueueResult::Released(job), "written again");
    assert_eq!(house.turn_until(job, State::Done).await.strikes, 0);
}

#[tokio::test]
async fn a_panic_fails_its_job_and_the_engine_goes_on() {
    let mut house = House::new(PLAIN).await;
    house.acts("bad", &[Act::Panic]);
    let (bad, good) = (id(house.drop_file("bad", "x").await), id(house.drop_file("good", "y").await));
    let job = house.turn_until(bad, State::Failed).await;
    assert!(job.error.unwrap().contains("a worker's panic, on purpose"));
    house.turn_until(good, State::Done).await;
    assert_eq!(house.left_over(), 0);
}

#[tokio::test]
async fn what_may_pass_is_tried_again_later_and_longer_each_time() {
    let mut house = House::new(PLAIN).await;
    house.acts("a", &[Act::FailForNow, Act::FailForNow, Act::Succeed]);
    let job = id(house.drop_file("a", "x").await);
    for wait in [5_000, 10_000] {
        house.turn_until(job, State::Running).await;
        let now = house.tools.clock.now();
        let waiting = house.turn_until(job, State::Queued).await;
        assert_eq!((waiting.not_before, waiting.error.as_deref()), (now + wait, Some("a said no")));
        house.advance(wait - 1);
        house.engine.tick().await.unwrap();
        assert_eq!(house.job(job).await.state, State::Queued, "too early");
        house.advance(1);
    }
    let done = house.turn_until(job, State::Done).await;
    assert_eq!((done.attempts, done.strikes, done.error), (3, 0, None));
}

#[tokio::test]
async fn the_attempt_is_counted_before_the_run_and_three_crashes_are_quarantine() {
    let mut house = House::new(PLAIN).await;
    house.acts("poison", &[Act::Hang]);
    let job = id(house.drop_file("poison", "x").await);
    for crash in 1..=3u32 {
        let running = house.at_work(job, crash as usize).await;
        assert_eq!(running.attempts, crash);
        house.crash().await;
        house.advance(60_000);
    }
    let job = house.job(job).await;
    assert_eq!((job.state, job.strikes), (State::Quarantined, 3));
    assert!(job.error.unwrap().contains("the daemon died"));
    house.engine.tick().await.unwrap();
    assert_eq!(house.runs().len(), 3, "and it is left alone");
}

/// Leases end with their owner, not with time: nobody "rescues" a long job.
#[tokio::test]
async fn an_hours_long_job_is_never_taken_for_dead() {
    let mut house = House::new(PLAIN).await;
    house.acts("long", &[Act::Hang]);
    let job = id(house.drop_file("long", "x").await);
    house.at_work(job, 1).await;
    for _ in 0..10 {
        house.advance(10 * 3_600_000);
        house.engine.tick().await.unwrap();
    }
    let job = house.job(job).await;
    assert_eq!((job.state, job.attempts, job.strikes), (State::Running, 1, 0));
    assert_eq!(house.runs(), ["long"]);
    house.engine.stop().await;
}

/// Called off in the moment in which its run fails for now, a job must not come
/// back by way of being tried again.
#[tokio::test]
async fn a_job_that_is_cancelled_as_it_fails_stays_cancelled() {
    let mut house = House::new(PLAIN).await;
    house.acts("a", &[Act::FailForNow]);
    let job = id(house.drop_file("a", "x").await);
    house.turn_until(job, State::Running).await;
    // The run has ended, and nobody has looked yet.
    house.tools.bell.notified().await;
    house.tools.store.order(job, Event::Cancel, 0).await.unwrap();
    assert_eq!(house.turn_until(job, State::Cancelled).await.attempts, 1);
}

#[tokio::test]
async fn a_clock_that_is_set_back_does_not_keep_a_job_waiting() {
    let mut house = House::new(PLAIN).await;
    house.acts("a", &[Act::FailForNow, Act::Succeed]);
    let job = id(house.drop_file("a", "x").await);
    house.turn_until(job, State::Running).await;
    house.turn_until(job, State::Queued).await;
    house.advance(-30 * 86_400_000);
    house.turn_until(job, State::Done).await;
}

#[tokio::test]
async fn a_shutdown_parks_the_job_and_does_not_count_its_attempt() {
    let mut house = House::new(PLAIN).await;
    // The system's clock, for the shutdown waits in real time.
    house.tools.clock = Clock::System;
    house.engine = Engine::new(house.tools.clone(), "run-x".into());
    house.acts("a", &[Act::Hang, Act::Succeed]);
    let job = id(house.drop_file("a", "x").await);
    house.at_work(job, 1).await;
    house.engine.stop().await;
    let parked = house.job(job).await;
    assert_eq!((parked.state, parked.attempts, parked.strikes), (State::Queued, 0, 0));
    house.crash().await;
    assert_eq!(house.turn_until(job, State::Done).await.attempts, 1);
}

#[tokio::test]
async fn orders_reach_a_running_job() {
    let mut house = House::new(PLAIN).await;
    house.acts("a", &[Act::Hang, Act::Hang, Act::Succeed]);
    let job = id(house.drop_file("a", "x").await);
    house.turn_until(job, State::Running).await;
    assert_eq!(house.tools.store.order(job, Event::Pause, 0).await.unwrap(), State::Running);
    house.turn_until(job, State::Paused).await;
    house.engine.tick().await.unwrap();
    assert_eq!(house.job(job).await.state, State::Paused, "paused stays paused");
    house.tools.store.order(job, Event::Resume, 0).await.unwrap();
    house.turn_until(job, State::Running).await;
    house.tools.store.order(job, Event::Cancel, 0).await.unwrap();
    house.turn_until(job, State::Cancelled).await;
    let refused = house.tools.store.order(job, Event::Resume, 0).await.unwrap_err();
    assert!(matches!(refused, StoreError::Illegal { .. }), "{refused}");
    house.tools.store.order(job, Event::Retry, 0).await.unwrap();
    house.turn_until(job, State::Done).await;
}

#[tokio::test]
async fn new_content_calls_off_the_old_and_takes_its_place() {
    let mut house = House::new(PLAIN).await;
    house.acts("a", &[Act::Hang, Act::Succeed]);
    let old = id(house.drop_file("a", "old").await);
    house.at_work(old, 1).await;
    let new = id(house.drop_file("a", "new").await);
    house.turn_until(old, State::Cancelled).await;
    assert_eq!(house.turn_until(new, State::Done).await.revision, 2);
    assert_eq!(house.octree("a").as_deref(), Some("new"));
    // And back: the old content's octree does not stand, so it is made again.
    let back = house.drop_file("a", "old").await;
    assert_eq!(back, EnqueueResult::Released(old));
    house.turn_until(old, State::Done).await;
    assert_eq!(house.octree("a").as_deref(), Some("old"));
    assert_eq!(house.job(new).await.superseded_by, Some(old));
}

#[tokio::test]
async fn known_content_is_not_converted_twice() {
    let mut house = House::new(PLAIN).await;
    let job = id(house.drop_file("a", "x").await);
    assert_eq!(house.drop_file("b", "x").await, EnqueueResult::Known(job), "while it waits");
    house.turn_until(job, State::Done).await;
    assert_eq!(house.drop_file("a", "x").await, EnqueueResult::Known(job), "touched");
    assert_eq!(house.drop_file("c", "x").await, EnqueueResult::Known(job), "under another name");
    house.engine.tick().await.unwrap();
    assert_eq!(house.runs().len(), 1);
}

/// Its octree would go on showing what its source no longer holds.
#[tokio::test]
async fn retry_though_another_octree_holds_the_content() {
    let mut house = House::new(PLAIN).await;
    house.acts("a", &[Act::Succeed, Act::FailForGood, Act::Succeed]);
    house.acts("c", &[Act::FailForGood]);
    let old = id(house.drop_file("a", "old").await);
    house.turn_until(old, State::Done).await;
    let a = id(house.drop_file("a", "x").await);
    house.turn_until(a, State::Failed).await;
    let c = id(house.drop_file("c", "x").await);
    house.turn_until(c, State::Failed).await;
    let b = id(house.drop_file("b", "x").await);
    house.turn_until(b, State::Done).await;
    let refused = house.tools.store.order(c, Event::Retry, house.tools.clock.now()).await;
    assert!(matches!(refused, Err(StoreError::Illegal { .. })), "c shows nothing old: {refused:?}");
    house.tools.store.order(a, Event::Retry, house.tools.clock.now()).await.unwrap();
    house.turn_until(a, State::Done).await;
    assert_eq!(house.octree("a").as_deref(), Some("x"));
    assert_eq!(house.octree("b").as_deref(), Some("x"));
    assert_eq!(house.job(b).await.superseded_by, None);
}

#[tokio::test]
async fn two_sources_of_one_name_get_two_octrees() {
    let mut house = House::new(PLAIN).await;
    let first = id(house.arrive("x", "1", |arrival| arrival.name = "same".into()).await);
    let second = id(house.arrive("y", "2", |arrival| arrival.name = "Same".into()).await);
    house.turn_until(first, State::Done).await;
    house.turn_until(second, State::Done).await;
    assert_eq!((house.octree("same"), house.octree("Same-2")), (Some("1".into()), Some("2".into())));
}

#[tokio::test]
async fn a_source_that_changes_under_the_conversion_is_not_published() {
    let mut house = House::new(PLAIN).await;
    house.acts("a", &[Act::Disturbed, Act::Succeed]);
    let job = id(house.drop_file("a", "x").await);
    house.turn_until(job, State::Running).await;
    let waiting = house.turn_until(job, State::Queued).await;
    assert!(waiting.error.unwrap().contains("changed while it was converted"));
    assert_eq!(house.octree("a"), None);
    house.advance(10_000);
    house.engine.tick().await.unwrap();
    assert!(house.job(job).await.hold.unwrap().contains("waiting until it is quiet"));
    // The watcher sees the new content and calls the old job off.
    let new = id(house.drop_file("a", "other content than before").await);
    house.turn_until(new, State::Done).await;
    assert_eq!(house.job(job).await.state, State::Cancelled);
}

#[tokio::test]
async fn a_missing_mount_holds_the_job_and_its_return_lets_it_go() {
    let mut house = House::new(PLAIN).await;
    let job = id(house.drop_file("a", "x").await);
    // The folder goes, as a mount does; the file itself is not touched.
    let (inbox, away) = (house.folder.path().join("inbox"), house.folder.path().join("away"));
    std::fs::rename(&inbox, &away).unwrap();
    house.engine.tick().await.unwrap();
    let held = house.job(job).await;
    assert_eq!(held.state, State::Queued);
    assert!(held.hold.unwrap().contains("is not there"));
    std::fs::rename(&away, &inbox).unwrap();
    assert_eq!(house.turn_until(job, State::Done).await.hold, None);
}

#[tokio::test]
async fn what_does_not_fit_on_the_disk_waits_and_the_rest_goes_by() {
    let mut house = House::new(PLAIN).await;
    let huge = id(house.arrive("huge", "h", |arrival| arrival.points = 1 << 50).await);
    let small = id(house.drop_file("small", "s").await);
    house.turn_until(small, State::Done).await;
    let held = house.job(huge).await;
    assert_eq!(held.state, State::Queued);
    let reason = held.hold.unwrap();
    assert!(reason.contains("needs up to") && reason.contains("free"), "{reason}");
    assert_eq!(house.runs(), ["small"]);
}

#[tokio::test]
async fn a_small_job_passes_a_huge_one_and_priority_decides_among_equals() {
    // One place for small jobs: two that start in one tick run in any order.
    let mut house = House::new(&format!("{PLAIN}\nlight_bytes = 10\nlight_jobs = 1")).await;
    house.acts("huge", &[Act::Hang]);
    house.drop_file("huge", "more than ten bytes of it").await;
    house.drop_file("huge-2", "more than ten bytes as well").await;
    let first = id(house.arrive("first", "1", |arrival| arrival.priority = -1).await);
    let urgent = id(house.arrive("urgent", "2", |arrival| arrival.priority = 9).await);
    house.turn_until(urgent, State::Done).await;
    house.turn_until(first, State::Done).await;
    let runs = house.runs();
    assert!(!runs.contains(&"huge-2".to_string()), "one heavy job at a time: {runs:?}");
    let place = |name: &str| runs.iter().position(|run| run == name);
    assert!(place("urgent") < place("first"), "{runs:?}");
    house.engine.stop().await;
}

/// Killed between the conversion's end and the record of it, the octree is
/// published at the next start without being converted again.
#[tokio::test]
async fn a_crash_between_conversion_and_publishing_costs_no_second_conversion() {
    use std::os::unix::fs::MetadataExt;
    for swapped in [false, true] {
        let mut house = House::new(PLAIN).await;
        let old = id(house.drop_file("a", "old").await);
        house.turn_until(old, State::Done).await;
        house.acts("a", &[Act::Hang]);
        let job = id(house.drop_file("a", "new").await);
        house.at_work(job, 2).await;
        // As the engine does it, up to where the crash comes.
        let staged = house.folder.path().join(format!("octrees/.staged/{job}"));
        std::fs::create_dir_all(&staged).unwrap();
        std::fs::write(staged.join("metadata.json"), "new").unwrap();
        let inode = std::fs::metadata(&staged).unwrap().ino();
        assert!(house.tools.store.stage(job, "life-0", (inode, None), "{}", 0).await.unwrap());
        if swapped {
            let target = house.folder.path().join("octrees/a");
            let flags = rustix::fs::RenameFlags::EXCHANGE;
            rustix::fs::renameat_with(rustix::fs::CWD, &staged, rustix::fs::CWD, &target, flags).unwrap();
        }
        house.crash().await;
        assert_eq!(house.job(job).await.state, State::Done);
        assert_eq!(house.octree("a").as_deref(), Some("new"));
        assert_eq!(house.runs(), ["a", "a"]);
        assert_eq!(house.left_over(), 0);
    }
}

#[tokio::test]
async fn a_lost_lease_throws_the_result_away() {
    let house = House::new(PLAIN).await;
    let job = id(house.drop_file("a", "x").await);
    let store = &house.tools.store;
    assert!(store.claim(job, "one", 0).await.unwrap().is_some());
    assert!(store.claim(job, "two", 0).await.unwrap().is_none(), "claimed once");
    assert!(!store.stage(job, "two", (7, None), "{}", 0).await.unwrap());
    let ending = lodestone::serve::queue::AttemptResult {
        end: lodestone::serve::job::retry_policy::AttemptEnd::Published,
        error: None,
    };
    let policy = lodestone::serve::job::retry_policy::Policy::default();
    assert_eq!(store.finish(job, "two", &ending, &policy, 0).await.unwrap(), None);
    assert_eq!(house.job(job).await.state, State::Running);
}

#[tokio::test]
async fn the_queue_outlives_its_process_and_a_newer_schema_is_refused() {
    let house = House::new(PLAIN).await;
    let job = id(house.drop_file("a", "x").await);
    let path: &Path = &house.tools.config.database();
    let again = Store::open(path).await.unwrap();
    assert_eq!(again.job(job).await.unwrap().name, "a");
    assert_eq!(again.stamps().await.unwrap().len(), 1);
    again.close().await;
    let raw = sqlx::SqlitePool::connect(&format!("sqlite:{}", path.display())).await.unwrap();
    sqlx::query("UPDATE _sqlx_migrations SET version = 999 WHERE version = 1").execute(&raw).await.unwrap();
    raw.close().await;
    let refused = Store::open(path).await.unwrap_err().to_string();
    assert!(refused.contains("newer Lodestone"), "{refused}");
}
