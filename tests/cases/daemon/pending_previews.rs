//! Pictures as a debt of the queue, with a painter that fails, panics, hangs or
//! finds nothing, and a clock that is set by hand.

use std::collections::HashMap;
use std::fs;
use std::path::Path;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use crate::engine_support::{House, PATIENCE};
use lodestone::convert::context::Context;
use lodestone::convert::preview::{PreviewManifest, PreviewOptions};
use lodestone::render::color::ColorBy;
use lodestone::render::{self, RenderError};
use lodestone::serve::config::Config;
use lodestone::serve::job::{Event, State};
use lodestone::serve::queue::{self, Drawn};
use lodestone::serve::scheduler::converter::{ConversionResult, Converter, Failure, Work};

/// What the painter does with an octree, attempt after attempt; the last for ever.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Act {
    Draw,
    Fail,
    Panic,
    Nothing,
    /// Paints until it is told to stop.
    Hang,
    /// Has no such colour as is asked for.
    NoColour,
}

#[derive(Default)]
struct Painter {
    acts: Mutex<HashMap<String, Vec<Act>>>,
    /// Names of octrees, in the order in which they were begun.
    begun: Mutex<Vec<String>>,
}

impl Converter for Painter {
    fn convert(&self, work: &Work, _: &Context) -> Result<ConversionResult, Failure> {
        fs::create_dir_all(&work.output).unwrap();
        fs::copy(&work.inputs[0], work.output.join("metadata.json")).unwrap();
        Ok(ConversionResult::default())
    }

    fn preview(
        &self,
        octree: &Path,
        into: &Path,
        options: &PreviewOptions,
        context: &Context,
    ) -> render::Result<PreviewManifest> {
        let name = octree.file_name().unwrap().to_str().unwrap().to_string();
        let act = {
            let mut acts = self.acts.lock().unwrap();
            let acts = acts.entry(name.clone()).or_insert_with(|| vec![Act::Draw]);
            if acts.len() > 1 { acts.remove(0) } else { acts[0] }
        };
        let shows = fs::read_to_string(octree.join("metadata.json")).unwrap();
        fs::create_dir_all(into).unwrap();
        fs::write(into.join("preview.json"), &shows).unwrap();
        self.begun.lock().unwrap().push(name);
        let folder = octree.to_path_buf();
        match act {
            Act::Draw => {}
            Act::Fail => return Err(RenderError::Encode { what: "a test", reason: "it is to fail".into() }),
            Act::Panic => panic!("a painter's panic, on purpose"),
            Act::Nothing => return Err(RenderError::Nothing { folder }),
            Act::NoColour if options.color != ColorBy::Auto => {
                return Err(RenderError::NoAttribute { folder, attribute: "rgb" });
            }
            Act::NoColour => {}
            Act::Hang => {
                while !context.cancel.is_cancelled() {
                    std::thread::sleep(Duration::from_millis(1));
                }
                return Err(RenderError::Cancelled);
            }
        }
        let made = serde_json::json!({ "shows": shows, "renderer": "none", "assets": [], "seconds": 0.5 });
        Ok(serde_json::from_value(made).unwrap())
    }
}

const PLAIN: &str = "disk_reserve = 0\nshutdown_seconds = 5\nretry_seconds = 5\nthreads = 1\npreview = true";

trait Gallery {
    fn acts(&self, name: &str, acts: &[Act]);
    fn begun(&self) -> usize;
    fn hangs(&self, name: &str) -> Option<String>;
    async fn published(&mut self, name: &str, content: &str) -> i64;
    async fn preview(&self, job: i64) -> Option<queue::Preview>;
    /// Turns the wheel until it is so.
    async fn until(
        &mut self,
        job: i64,
        is: impl Fn(Option<&queue::Preview>) -> bool,
    ) -> Option<queue::Preview>;
    async fn turn_until_begun(&mut self, times: usize);
}

impl Gallery for House<Painter> {
    fn acts(&self, name: &str, acts: &[Act]) {
        self.converter.acts.lock().unwrap().insert(name.into(), acts.to_vec());
    }

    fn begun(&self) -> usize {
        self.converter.begun.lock().unwrap().len()
    }

    fn hangs(&self, name: &str) -> Option<String> {
        let octree = self.folder.path().join("octrees").join(name);
        fs::read_to_string(octree.join("preview/preview.json")).ok()
    }

    async fn published(&mut self, name: &str, content: &str) -> i64 {
        let job = self.drop_file(name, content).await.job();
        self.turn_until(job, State::Done).await;
        job
    }

    async fn preview(&self, job: i64) -> Option<queue::Preview> {
        self.tools.store.previews(&[job]).await.unwrap().remove(&job)
    }

    async fn until(
        &mut self,
        job: i64,
        is: impl Fn(Option<&queue::Preview>) -> bool,
    ) -> Option<queue::Preview> {
        let start = Instant::now();
        loop {
            self.engine.tick().await.unwrap();
            let preview = self.preview(job).await;
            if is(preview.as_ref()) {
                return preview;
            }
            assert!(start.elapsed() < PATIENCE, "waited in vain: {preview:?}");
            tokio::time::sleep(Duration::from_millis(2)).await;
        }
    }

    async fn turn_until_begun(&mut self, times: usize) {
        let start = Instant::now();
        while self.begun() < times {
            self.engine.tick().await.unwrap();
            assert!(start.elapsed() < PATIENCE, "not begun");
            tokio::time::sleep(Duration::from_millis(2)).await;
        }
    }
}

fn is(state: Drawn) -> impl Fn(Option<&queue::Preview>) -> bool {
    move |preview| preview.is_some_and(|preview| preview.state == state)
}

/// So often, and at last for this reason.
fn failed(times: u32, why: &str) -> impl Fn(Option<&queue::Preview>) -> bool {
    move |preview| {
        preview.is_some_and(|preview| {
            preview.attempts == times && preview.error.as_ref().is_some_and(|error| error.contains(why))
        })
    }
}

#[tokio::test]
async fn pictures_hang_beside_the_octree_and_leave_nothing_behind() {
    let mut house = House::<Painter>::new(PLAIN).await;
    let job = house.published("a", "one").await;
    let preview = house.until(job, is(Drawn::Done)).await.unwrap();
    assert_eq!((preview.attempts, preview.receipt.unwrap()["shows"].as_str()), (1, Some("one")));
    assert_eq!(house.hangs("a").as_deref(), Some("one"));
    assert_eq!(fs::read_dir(house.folder.path().join("octrees/.previews")).unwrap().count(), 0);
    assert_eq!(house.tools.store.previews_waiting().await.unwrap(), 0);
}

#[tokio::test]
async fn failures_and_panics_are_tried_again_later_and_then_no_more() {
    let mut house = House::<Painter>::new(PLAIN).await;
    house.acts("a", &[Act::Fail, Act::Panic, Act::Fail]);
    let job = house.published("a", "one").await;
    house.until(job, failed(1, "it is to fail")).await;
    // Another octree's turn comes meanwhile, and its own only after five seconds.
    let other = house.published("b", "two").await;
    house.until(other, is(Drawn::Done)).await;
    assert_eq!(house.begun(), 2);
    house.advance(5_000);
    house.until(job, failed(2, "on purpose")).await;
    // The wait is longer now; a clock that is set back makes it none.
    house.advance(9_000);
    house.engine.tick().await.unwrap();
    assert_eq!(house.begun(), 3);
    house.advance(-10_000_000);
    let preview = house.until(job, is(Drawn::Failed)).await.unwrap();
    assert_eq!(preview.attempts, 3);
    assert_eq!((house.job(job).await.state, house.hangs("a")), (State::Done, None));
    house.advance(100_000_000);
    house.engine.tick().await.unwrap();
    assert_eq!(house.begun(), 4);
    // By order it is begun anew.
    house.acts("a", &[Act::Draw]);
    house.tools.store.order_preview(job, 0).await.unwrap();
    assert_eq!(house.until(job, is(Drawn::Done)).await.unwrap().attempts, 1);
}

#[tokio::test]
async fn nothing_to_show_is_an_end_and_a_missing_colour_none() {
    let mut house = House::<Painter>::new(&format!("{PLAIN}\npreview_color = 'rgb'")).await;
    house.acts("a", &[Act::Nothing]);
    house.acts("b", &[Act::NoColour]);
    let (nothing, grey) = (house.published("a", "one").await, house.published("b", "two").await);
    house.until(grey, is(Drawn::Done)).await;
    let preview = house.until(nothing, is(Drawn::Nothing)).await.unwrap();
    assert!(preview.error.unwrap().contains("nothing to show"));
    house.advance(100_000_000);
    house.engine.tick().await.unwrap();
    assert_eq!(house.begun(), 3, "twice for the colour");
    assert_eq!(house.hangs("a"), None);
}

#[tokio::test]
async fn pictures_of_what_was_replaced_meanwhile_are_thrown_away() {
    let mut house = House::<Painter>::new(PLAIN).await;
    house.acts("a", &[Act::Hang, Act::Draw]);
    let old = house.published("a", "one").await;
    house.turn_until_begun(1).await;
    // The conversion does not wait for the picture.
    let new = house.published("a", "two").await;
    assert_eq!(house.preview(old).await, None, "nothing is owed of the old one");
    // What hangs is given up after an hour.
    house.advance(3_600_000);
    house.until(new, is(Drawn::Done)).await;
    assert_eq!(house.hangs("a").as_deref(), Some("two"));
    assert!(matches!(house.tools.store.order_preview(old, 0).await, Err(queue::StoreError::Illegal { .. })));
}

#[tokio::test]
async fn made_anew_an_octree_gets_new_pictures_though_old_ones_are_being_drawn() {
    let mut house = House::<Painter>::new(PLAIN).await;
    house.acts("a", &[Act::Hang, Act::Draw]);
    let job = house.published("a", "one").await;
    house.turn_until_begun(1).await;
    house.tools.store.order(job, Event::Retry, 0).await.unwrap();
    house.turn_until_so(job, "done again", |job| job.state == State::Done && job.attempts == 2).await;
    assert_eq!(house.preview(job).await.unwrap().attempts, 0, "owed anew");
    house.advance(3_600_000);
    let preview = house.until(job, is(Drawn::Done)).await.unwrap();
    assert_eq!((preview.attempts, house.begun()), (1, 2));
}

#[tokio::test]
async fn a_stop_counts_no_attempt_and_crashes_are_counted_until_it_is_too_many() {
    let mut house = House::<Painter>::new(PLAIN).await;
    house.acts("a", &[Act::Hang]);
    let job = house.published("a", "one").await;
    house.turn_until_begun(1).await;
    house.engine.stop().await;
    let preview = house.preview(job).await.unwrap();
    assert_eq!((preview.state, preview.attempts), (Drawn::Queued, 0));
    for crash in 1..=3 {
        house.crash().await;
        house.turn_until_begun(1 + crash).await;
        assert_eq!(house.preview(job).await.unwrap().attempts as usize, crash);
        house.advance(100_000);
    }
    house.crash().await;
    let preview = house.until(job, is(Drawn::Failed)).await.unwrap();
    assert!(preview.error.unwrap().contains("died"));
    assert_eq!((house.begun(), house.job(job).await.state), (4, State::Done));
}

#[tokio::test]
async fn what_is_switched_off_or_has_no_room_waits() {
    async fn start(house: &mut House<Painter>, preview: bool, disk_reserve: u64) {
        let config = Config { preview, disk_reserve, ..(*house.tools.config).clone() };
        house.tools.config = Arc::new(config);
        house.crash().await;
    }
    for (preview, disk_reserve) in [(false, 0), (true, u64::MAX)] {
        let mut house = House::<Painter>::new(PLAIN).await;
        start(&mut house, false, 0).await;
        let job = house.published("a", "one").await;
        start(&mut house, preview, disk_reserve).await;
        for _ in 0..5 {
            house.engine.tick().await.unwrap();
        }
        let waiting = house.preview(job).await.unwrap();
        assert_eq!((house.begun(), waiting.state, waiting.attempts), (0, Drawn::Queued, 0));
        start(&mut house, true, 0).await;
        house.until(job, is(Drawn::Done)).await;
    }
}
