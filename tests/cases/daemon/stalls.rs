//! Runs that stand still, and records that grow old: the engine on a real SQLite
//! file, with conversions that hang and a clock that is set by hand.

use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicI64, AtomicU32, Ordering};
use std::time::{Duration, Instant};

use crate::engine_support::{PATIENCE, wait};
use lodestone::convert::context::{Context, Stage};
use lodestone::serve::job::{Event, State};
use lodestone::serve::queue::EnqueueResult;
use lodestone::serve::scheduler::converter::{ConversionResult, Converter, Failure, Work};

type House = crate::engine_support::House<Puppet>;

/// Does as it is told from outside.
#[derive(Default)]
struct Puppet {
    /// Names of data sets whose conversion hangs.
    hang: Mutex<Vec<String>>,
    /// Whether a hanging one hears that it is told to stop.
    deaf: AtomicBool,
    /// Lets all that hang go on, to their success.
    release: AtomicBool,
    /// Points that a hanging one is to get further.
    points: AtomicI64,
    runs: AtomicU32,
    ended: AtomicU32,
}

impl Converter for Puppet {
    fn convert(&self, work: &Work, context: &Context) -> Result<ConversionResult, Failure> {
        let name = work.options.name.clone().unwrap_or_default();
        context.progress.begin(Stage::Index, 1_000_000);
        self.runs.fetch_add(1, Ordering::SeqCst);
        let hangs = self.hang.lock().unwrap().contains(&name);
        while hangs && !self.release.load(Ordering::SeqCst) {
            let points = self.points.load(Ordering::SeqCst);
            context.progress.advance(points as u64);
            // After it has moved, for this is what a test waits for.
            self.points.fetch_sub(points, Ordering::SeqCst);
            if context.cancel.is_cancelled() && !self.deaf.load(Ordering::SeqCst) {
                return Err(Failure { message: "cancelled".into(), may_pass: true, panicked: false });
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        std::fs::create_dir_all(&work.output).unwrap();
        std::fs::write(work.output.join("metadata.json"), std::fs::read(&work.inputs[0]).unwrap()).unwrap();
        self.ended.fetch_add(1, Ordering::SeqCst);
        Ok(ConversionResult { points_in: 1, points_out: 1, ..ConversionResult::default() })
    }
}

impl House {
    async fn with_limit(settings: &str) -> House {
        House::new(&format!("disk_reserve = 0\nlight_jobs = 0\n{settings}")).await
    }

    fn hang(&self, name: &str) {
        self.converter.hang.lock().unwrap().push(name.into());
    }

    /// Time goes by, second by second as in life.
    async fn live(&mut self, seconds: i64) {
        for _ in 0..seconds {
            self.advance(1000);
            self.engine.tick().await.unwrap();
        }
    }

    /// Turns the wheel until the job's run, which is the `nth` of all, hangs.
    async fn started(&mut self, id: i64, nth: u32) {
        self.turn_until(id, State::Running).await;
        let puppet = self.converter.clone();
        wait("the run", || puppet.runs.load(Ordering::SeqCst) == nth).await;
        // Its first step counts as a movement: it is seen before time goes on.
        self.engine.tick().await.unwrap();
    }

    /// The puppet gets further, which the next look sees.
    async fn get_further(&mut self) {
        let puppet = self.converter.clone();
        puppet.points.store(1, Ordering::SeqCst);
        wait("a step", || puppet.points.load(Ordering::SeqCst) == 0).await;
    }

    fn stalled(&self) -> u64 {
        self.tools.metrics.jobs_stalled.get()
    }
}

#[tokio::test]
async fn a_job_that_stands_still_is_stopped_and_struck_and_three_times_is_quarantine() {
    let mut house = House::with_limit("stall_minutes = 1").await;
    house.hang("a");
    let job = house.drop_file("a", "x").await.job();
    for strike in 1..=3 {
        house.started(job, strike).await;
        house.live(59).await;
        assert_eq!(house.job(job).await.state, State::Running, "not a second too early");
        house.live(5).await;
        let state = if strike < 3 { State::Queued } else { State::Quarantined };
        let stopped = house.turn_until(job, state).await;
        assert_eq!((stopped.strikes, house.stalled()), (strike, u64::from(strike)));
        assert!(stopped.error.as_ref().unwrap().contains("made no progress for 60 s"), "{:?}", stopped.error);
        house.advance(10_000);
    }
}

#[tokio::test]
async fn a_job_that_moves_is_never_touched_however_long_it_takes_and_however_clocks_jump() {
    let mut house = House::with_limit("stall_minutes = 1").await;
    house.hang("a");
    let job = house.drop_file("a", "x").await.job();
    house.started(job, 1).await;
    for hour in 0..24 {
        // One point in fifty seconds; then a night's sleep, then a clock set back.
        house.live(50).await;
        house.get_further().await;
        house.live(1).await;
        house.advance(if hour % 2 == 0 { 36_000_000 } else { -30_000_000 });
    }
    assert_eq!((house.job(job).await.state, house.stalled()), (State::Running, 0));
    house.converter.release.store(true, Ordering::SeqCst);
    assert_eq!(house.turn_until(job, State::Done).await.attempts, 1);
}

#[tokio::test]
async fn a_run_that_does_not_stop_is_given_up_and_its_late_result_thrown_away() {
    let mut house = House::with_limit("stall_minutes = 1").await;
    house.hang("a");
    house.converter.deaf.store(true, Ordering::SeqCst);
    let job = house.drop_file("a", "x").await.job();
    house.started(job, 1).await;
    house.live(100).await;
    assert_eq!(house.job(job).await.state, State::Running, "told to stop, and given a minute");
    house.live(30).await;
    let given_up = house.job(job).await;
    assert_eq!((given_up.state, given_up.strikes), (State::Queued, 1));

    // Its lane is free for others, but not for itself while the old run lives.
    let other = house.drop_file("b", "y").await.job();
    house.turn_until(other, State::Done).await;
    house.live(20).await;
    let held = house.job(job).await;
    assert!(held.hold.as_ref().is_some_and(|hold| hold.contains("hangs")), "{held:?}");
    assert_eq!(house.converter.runs.load(Ordering::SeqCst), 2);

    // It wakes up and brings a result; nobody wants it. Then the job has its turn.
    house.converter.release.store(true, Ordering::SeqCst);
    wait("the late end", || house.converter.ended.load(Ordering::SeqCst) == 2).await;
    let done = house.turn_until(job, State::Done).await;
    assert_eq!((done.attempts, house.converter.runs.load(Ordering::SeqCst)), (2, 3), "converted anew");
}

#[tokio::test]
async fn new_content_waits_for_the_run_of_the_old_to_end_and_not_for_ever() {
    for (stall, long, longer) in [("stall_minutes = 1", 50, 30), ("stall_minutes = 0", 1700, 200)] {
        let mut house = House::new(&format!("disk_reserve = 0\nlight_jobs = 2\n{stall}")).await;
        let run = |house: &House| house.converter.runs.load(Ordering::SeqCst);
        house.hang("a");
        house.converter.deaf.store(true, Ordering::SeqCst);
        let old = house.drop_file("a", "x").await.job();
        house.started(old, 1).await;
        let new = house.drop_file("a", "y").await.job();
        let held = house.turn_until_so(new, "held", |job| job.hold.is_some()).await;
        assert!(held.hold.as_ref().is_some_and(|hold| hold.contains("other content")), "{held:?}");
        // There is a place: others run.
        let other = house.drop_file("b", "z").await.job();
        house.turn_until(other, State::Done).await;
        assert_eq!((house.job(new).await.state, run(&house)), (State::Queued, 2));

        house.converter.deaf.store(false, Ordering::SeqCst);
        house.turn_until(old, State::Cancelled).await;
        house.started(new, 3).await;
        // The next one finds a run that does not hear.
        house.converter.deaf.store(true, Ordering::SeqCst);
        let newest = house.drop_file("a", "w").await.job();
        house.live(long).await;
        assert_eq!((house.job(newest).await.state, run(&house)), (State::Queued, 3));
        house.live(longer).await;
        house.started(newest, 4).await;
        house.converter.release.store(true, Ordering::SeqCst);
        house.turn_until(newest, State::Done).await;
        house.turn_until(new, State::Cancelled).await;
    }
}

#[tokio::test]
async fn without_a_limit_nothing_is_stopped() {
    let mut house = House::with_limit("stall_minutes = 0").await;
    house.hang("a");
    let job = house.drop_file("a", "x").await.job();
    house.started(job, 1).await;
    house.live(4000).await;
    assert_eq!((house.job(job).await.state, house.stalled()), (State::Running, 0));
    house.engine.stop().await;
}

const DAY: i64 = 86_400_000;

#[tokio::test]
async fn old_records_go_but_never_one_that_stands_for_an_octree() {
    let mut house = House::with_limit("").await;
    let store = house.tools.store.clone();
    let octrees = house.tools.config.octrees();
    let standing = house.drop_file("a", "one").await.job();
    house.turn_until(standing, State::Done).await;
    let old = house.drop_file("b", "old").await.job();
    house.turn_until(old, State::Done).await;
    let new = house.drop_file("b", "new").await.job();
    house.turn_until(new, State::Done).await;
    let cancelled = house.drop_file("c", "three").await.job();
    store.order(cancelled, Event::Cancel, house.tools.clock.now()).await.unwrap();
    let removed = house.drop_file("d", "four").await.job();
    house.turn_until(removed, State::Done).await;
    std::fs::remove_dir_all(octrees.join("d")).unwrap();
    // No hook is configured, so nobody waits to be told of these.
    house.live(15).await;

    let now = house.tools.clock.now();
    assert_eq!(store.purge(now - DAY, &octrees).await.unwrap(), 0, "nothing is that old");
    let waiting = house.drop_file("e", "waits").await.job();
    assert_eq!(store.purge(now + DAY, &octrees).await.unwrap(), 3);
    for (job, stays) in
        [(standing, true), (old, false), (new, true), (cancelled, false), (removed, false), (waiting, true)]
    {
        assert_eq!(store.job(job).await.is_ok(), stays, "job {job}");
    }
    // What stands is known still; what went is a new job, should it come again.
    assert_eq!(house.drop_file("a", "one").await, EnqueueResult::Known(standing));
    assert_eq!(house.drop_file("copy", "one").await, EnqueueResult::Known(standing));
    assert!(matches!(house.drop_file("c", "three").await, EnqueueResult::New(_)));
    assert_eq!(store.purge(now - DAY, &octrees).await.unwrap(), 0);
}

/// Whoever asks what happened behind an event's number misses nothing.
#[tokio::test]
async fn numbers_of_events_are_not_given_away_again() {
    let mut house = House::with_limit("").await;
    let store = house.tools.store.clone();
    let octrees = house.tools.config.octrees();
    let mut jobs = Vec::new();
    for name in ["a", "b"] {
        let job = house.drop_file(name, name).await.job();
        house.turn_until(job, State::Done).await;
        jobs.push(job);
    }
    std::fs::remove_dir_all(octrees.join("a")).unwrap();
    house.live(15).await;
    let now = house.tools.clock.now();
    store.set_priority(jobs[0], 5, now).await.unwrap();
    let last = store.latest_event().await.unwrap();
    assert_eq!(store.purge(now + DAY, &octrees).await.unwrap(), 0, "the last event is its");
    let new = house.drop_file("c", "c").await.job();
    let since = store.jobs_since(last, 10).await.unwrap();
    assert!(since.iter().any(|job| job.id == new), "{since:?}");
    assert_eq!(store.purge(now + DAY, &octrees).await.unwrap(), 1);
    assert!(store.job(jobs[0]).await.is_err());
}

#[tokio::test]
async fn the_engine_removes_old_records_by_itself_and_histories_stay_short() {
    let mut house = House::with_limit("keep_days = 30").await;
    let store = house.tools.store.clone();
    let kept = house.drop_file("b", "two").await.job();
    let job = house.drop_file("a", "one").await.job();
    house.turn_until(job, State::Done).await;
    house.turn_until(kept, State::Done).await;
    for n in 0..600 {
        store.set_priority(kept, n, house.tools.clock.now()).await.unwrap();
    }
    let raw = sqlx::SqlitePool::connect(&format!("sqlite:{}", house.tools.config.database().display()))
        .await
        .unwrap();
    let (lines,): (i64,) = sqlx::query_as("SELECT count(*) FROM event").fetch_one(&raw).await.unwrap();
    assert!((500..520).contains(&lines), "{lines}");
    let new = house.drop_file("a", "newer").await.job();
    house.turn_until(new, State::Done).await;
    house.live(15).await;
    house.advance(31 * DAY);
    let start = Instant::now();
    while store.job(job).await.is_ok() && start.elapsed() < PATIENCE {
        house.engine.tick().await.unwrap();
        tokio::time::sleep(Duration::from_millis(2)).await;
    }
    assert!(store.job(job).await.is_err(), "superseded a month ago");
    assert!(store.job(kept).await.is_ok() && store.job(new).await.is_ok(), "their octrees stand");
}
