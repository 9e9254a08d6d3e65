//! Who is blamed when the daemon dies, and what becomes of what somebody took away
//! under it.

use std::collections::HashSet;
use std::fs;
use std::path::Path;
use std::sync::Mutex;
use std::time::Duration;

use lodestone::convert::context::Context;
use lodestone::convert::preview::{PreviewManifest, PreviewOptions};
use lodestone::render::RenderError;
use lodestone::serve::job::State;
use lodestone::serve::scheduler::converter::{ConversionResult, Converter, Failure, Work};

use crate::common::{self, mix};
use crate::daemon_support::{Daemon, las, wait_for};
use crate::engine_support::{self, wait};

type House = engine_support::House<Works>;

/// Conversions and drawings of the names in `hangs` go on until they are stopped.
#[derive(Default)]
struct Works {
    hangs: Mutex<HashSet<String>>,
    at_work: Mutex<Vec<String>>,
}

impl Works {
    fn run(&self, name: &str, context: &Context) -> bool {
        self.at_work.lock().unwrap().push(name.to_string());
        while self.hangs.lock().unwrap().contains(name) {
            if context.cancel.is_cancelled() {
                return false;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        true
    }

    fn hang(&self, names: &[&str]) {
        *self.hangs.lock().unwrap() = names.iter().map(|name| name.to_string()).collect();
    }
}

impl Converter for Works {
    fn convert(&self, work: &Work, context: &Context) -> Result<ConversionResult, Failure> {
        let name = work.options.name.clone().unwrap_or_default();
        if !self.run(&name, context) {
            return Err(Failure { message: "stopped".into(), may_pass: true, panicked: false });
        }
        fs::create_dir_all(&work.output).unwrap();
        fs::write(work.output.join("metadata.json"), name).unwrap();
        Ok(ConversionResult { points_in: 10, points_out: 10, ..ConversionResult::default() })
    }

    fn preview(
        &self,
        octree: &Path,
        _: &Path,
        _: &PreviewOptions,
        context: &Context,
    ) -> lodestone::render::Result<PreviewManifest> {
        let name = format!("picture of {}", octree.file_name().unwrap().to_str().unwrap());
        self.run(&name, context);
        Err(RenderError::Nothing { folder: octree.to_path_buf() })
    }
}

const THREE: &str = "disk_reserve = 0\nlight_jobs = 3\nshutdown_seconds = 5";

/// Turns the wheel until these are at work, in any order.
async fn at_work(house: &mut House, names: &[&str]) {
    let converter = house.converter.clone();
    let mut wanted: Vec<&str> = names.to_vec();
    wanted.sort_unstable();
    for _ in 0..20_000 {
        house.engine.tick().await.unwrap();
        let mut there = converter.at_work.lock().unwrap().clone();
        there.sort_unstable();
        if there == wanted {
            return;
        }
        tokio::time::sleep(Duration::from_millis(2)).await;
    }
    panic!("{names:?} and not {:?}", converter.at_work.lock().unwrap());
}

async fn crash(house: &mut House) {
    house.crash().await;
    house.converter.at_work.lock().unwrap().clear();
    house.advance(3_600_000);
}

#[tokio::test]
async fn only_who_ran_alone_is_blamed_for_a_crash() {
    let mut house = House::new(THREE).await;
    house.converter.hang(&["poison", "one", "two"]);
    let mut jobs = Vec::new();
    for name in ["one", "poison", "two"] {
        jobs.push(house.drop_file(name, name).await.job());
    }
    at_work(&mut house, &["one", "poison", "two"]).await;
    crash(&mut house).await;
    for job in &jobs {
        let job = house.job(*job).await;
        assert_eq!((job.state, job.strikes), (State::Queued, 0), "{job:?}");
    }
    // A newcomer waits until they have run.
    house.drop_file("new", "new").await;
    at_work(&mut house, &["one"]).await;
    house.converter.hang(&["poison", "two"]);
    assert_eq!(house.turn_until(jobs[0], State::Done).await.strikes, 0);
    // The next may be at work by now.
    house.converter.at_work.lock().unwrap().retain(|name| *name != "one");
    for strike in 1..=3 {
        at_work(&mut house, &["poison"]).await;
        crash(&mut house).await;
        assert_eq!(house.job(jobs[1]).await.strikes, strike);
    }
    assert_eq!(house.job(jobs[1]).await.state, State::Quarantined);
    house.converter.hang(&[]);
    for job in [jobs[2], jobs[2] + 1] {
        assert_eq!(house.turn_until(job, State::Done).await.strikes, 0);
    }
}

#[tokio::test]
async fn pictures_and_conversions_do_not_strike_each_other() {
    let mut house = House::new(&format!("{THREE}\npreview = true")).await;
    let drawn = house.drop_file("drawn", "drawn").await.job();
    house.converter.hang(&["picture of drawn", "other"]);
    house.turn_until(drawn, State::Done).await;
    let other = house.drop_file("other", "other").await.job();
    at_work(&mut house, &["drawn", "other", "picture of drawn"]).await;
    crash(&mut house).await;
    let job = house.job(other).await;
    assert_eq!((job.state, job.strikes), (State::Queued, 0));
    let preview = house.tools.store.previews(&[drawn]).await.unwrap().remove(&drawn).unwrap();
    assert_eq!(preview.attempts, 0, "an attempt beside others does not count");
    // The conversion alone, then the pictures alone.
    at_work(&mut house, &["other"]).await;
    house.converter.hang(&["picture of drawn"]);
    house.turn_until(other, State::Done).await;
    for attempt in 1..=3 {
        let converter = house.converter.clone();
        converter.at_work.lock().unwrap().retain(|name| name == "picture of drawn");
        at_work_alone(&mut house, "picture of drawn").await;
        let blocked = house.drop_file(&format!("late{attempt}"), &format!("late{attempt}")).await.job();
        house.engine.tick().await.unwrap();
        assert_eq!(house.job(blocked).await.state, State::Queued, "it waits for what is drawn alone");
        crash(&mut house).await;
        let preview = house.tools.store.previews(&[drawn]).await.unwrap().remove(&drawn).unwrap();
        assert_eq!(preview.attempts, attempt);
        house.turn_until(blocked, State::Done).await;
    }
}

async fn at_work_alone(house: &mut House, name: &str) {
    let converter = house.converter.clone();
    for _ in 0..20_000 {
        house.engine.tick().await.unwrap();
        if converter.at_work.lock().unwrap().iter().any(|at_work| at_work == name) {
            return;
        }
        tokio::time::sleep(Duration::from_millis(2)).await;
    }
    panic!("{name} is not drawn");
}

/// Receipts vouch for bytes that a disk lost which went away and came back.
#[test]
fn a_run_that_goes_on_from_damaged_scratch_begins_anew() {
    use lodestone::convert::options::Options;
    use lodestone::convert::run;
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("cloud.las");
    fs::write(&input, las(1_500_000, 3)).unwrap();
    let expected = folder.path().join("expected");
    let named = Options { name: Some("octree".into()), ..Options::default() };
    common::convert(std::slice::from_ref(&input), &expected, &named).unwrap();
    let request = common::request(&[input], &folder.path().join("octree"), &named);
    for damage in 0..4u64 {
        let context = common::context(folder.path(), 2, 24 << 20);
        let (cancel, scratch) = (context.cancel.clone(), context.scratch.clone());
        let stop = std::thread::spawn(move || {
            wait_for("receipts", || {
                let units = lodestone::convert::checkpoint::scratch::units_done(&scratch);
                (units > 20 || cancel.is_cancelled()).then(|| cancel.cancel())
            })
        });
        let ended = run::convert(&request, &context);
        context.cancel.cancel();
        stop.join().unwrap();
        if ended.is_err() {
            damage_scratch(&context.scratch, damage);
        }
        run::convert(&request, &common::context(folder.path(), 2, 24 << 20)).unwrap();
        assert!(
            common::octree_bytes(&folder.path().join("octree")) == common::octree_bytes(&expected),
            "{damage}"
        );
        fs::remove_dir_all(folder.path().join("octree")).unwrap();
    }
}

/// Noise in the middle of every file but the journal: positions from anywhere.
fn damage_scratch(scratch: &Path, damage: u64) {
    for entry in fs::read_dir(scratch).unwrap().flatten() {
        if entry.file_name() == "journal" {
            continue;
        }
        let mut bytes = fs::read(entry.path()).unwrap();
        let (from, to) = (bytes.len() / 4, bytes.len() * 3 / 4);
        for (n, byte) in bytes[from..to].iter_mut().enumerate() {
            *byte = if damage == 0 { 0xFF } else { mix(damage << 32 | n as u64) as u8 };
        }
        fs::write(entry.path(), bytes).unwrap();
    }
}

#[test]
fn folders_taken_away_under_the_daemon_are_made_again() {
    let root = tempfile::tempdir().unwrap();
    let daemon = Daemon::start(&root.path().join("data"));
    fs::write(daemon.inbox().join("a.las"), las(500, 1)).unwrap();
    daemon.wait("a", "done");
    for (n, gone) in ["scratch", "octrees", "octrees/.staged"].into_iter().enumerate() {
        fs::remove_dir_all(daemon.root.join(gone)).unwrap();
        if !gone.contains('/') {
            let (status, text) = daemon.get("/readyz");
            assert!(status == 503 && text.contains(gone), "{status} {text}");
        }
        assert_eq!(daemon.get("/healthz").0, 200);
        let name = format!("after{n}");
        fs::write(daemon.inbox().join(format!("{name}.las")), las(500, n as u64 + 10)).unwrap();
        daemon.wait(&name, "done");
        assert_eq!(daemon.get("/readyz").0, 200);
    }
}

#[tokio::test]
async fn a_held_job_is_told_once_whatever_else_the_disk_does() {
    let mut house = House::new("disk_reserve = \"1000000G\"").await;
    let job = house.drop_file("waits", "waits").await.job();
    house.engine.tick().await.unwrap();
    let held = house.job(job).await;
    assert!(held.hold.as_deref().unwrap_or_default().contains("needs up to"), "{held:?}");
    let told = house.tools.store.history(job).await.unwrap().len();
    let ballast = house.folder.path().join("ballast");
    for round in 1..10usize {
        fs::write(&ballast, vec![1u8; round << 20]).unwrap();
        house.advance(1000);
        house.engine.tick().await.unwrap();
    }
    assert_eq!(house.job(job).await.updated_at, held.updated_at, "nothing is written anew");
    assert_eq!(house.tools.store.history(job).await.unwrap().len(), told);
    wait("nothing", || true).await;
}
