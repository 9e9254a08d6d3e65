//! The fake converter: it succeeds, fails, panics, or hangs until the history
//! lets it go, decided by its input's nature and by seeded chance. One desk is
//! one life of the daemon; when that dies, its conversions are gone.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex};
use std::time::Duration;

use lodestone::convert::context::{Cancel, Context, Stage};
use lodestone::convert::preview::{PreviewManifest, PreviewOptions};
use lodestone::render::{self, RenderError};
use lodestone::serve::scheduler::converter::{ConversionResult, Converter, Failure, Work};

use crate::content::{self, Nature};
use crate::dice::Dice;

/// A conversion that was begun.
#[derive(Debug, Clone)]
pub struct Run {
    pub job: i64,
    pub content: String,
    pub name: String,
    /// What stood under the octree's name at that moment.
    pub stood: Option<String>,
}

/// What outlives the daemon: chance, and the log of all that was begun.
#[derive(Debug, Default)]
pub struct Script {
    pub seed: u64,
    pub runs: Mutex<Vec<Run>>,
    /// No more chance: good inputs succeed.
    pub calm: AtomicBool,
    /// Nothing can be written.
    pub disk_full: AtomicBool,
}

#[derive(Debug)]
pub struct Desk {
    script: Arc<Script>,
    dead: AtomicBool,
    hung: Mutex<BTreeMap<i64, Cancel>>,
    gate: Condvar,
}

impl Desk {
    pub fn new(script: Arc<Script>) -> Desk {
        Desk { script, dead: AtomicBool::new(false), hung: Mutex::default(), gate: Condvar::new() }
    }

    /// Conversions that will not end by themselves.
    pub fn hung(&self) -> Vec<i64> {
        let hung = self.hung.lock().unwrap();
        hung.iter().filter(|(_, cancel)| !cancel.is_cancelled()).map(|(job, _)| *job).collect()
    }

    pub fn let_go(&self, job: i64) {
        self.hung.lock().unwrap().remove(&job);
        self.gate.notify_all();
    }

    /// The process is gone, and all its threads.
    pub fn die(&self) {
        self.dead.store(true, Ordering::SeqCst);
        self.hung.lock().unwrap().clear();
        self.gate.notify_all();
    }

    fn hang(&self, job: i64, cancel: &Cancel) {
        let mut hung = self.hung.lock().unwrap();
        if self.dead.load(Ordering::SeqCst) {
            return;
        }
        hung.insert(job, cancel.clone());
        while hung.contains_key(&job) {
            if cancel.is_cancelled() {
                hung.remove(&job);
                return;
            }
            hung = self.gate.wait_timeout(hung, Duration::from_micros(200)).unwrap().0;
        }
    }
}

impl Converter for Desk {
    fn convert(&self, work: &Work, context: &Context) -> Result<ConversionResult, Failure> {
        let failure =
            |message: &str, may_pass| Failure { message: message.into(), may_pass, panicked: false };
        let job: i64 = work.output.file_name().unwrap().to_str().unwrap().parse().unwrap();
        let files: Option<Vec<Vec<u8>>> = work.inputs.iter().map(|input| fs::read(input).ok()).collect();
        let content = files.map(|files| files.iter().map(|f| content::hash(f)).collect::<Vec<_>>().join(","));
        let name = work.options.name.clone().unwrap_or_default();
        let octrees = work.output.parent().unwrap().parent().unwrap();
        let stood = fs::read_to_string(octrees.join(&name).join("metadata.json")).ok();
        let number = {
            let mut runs = self.script.runs.lock().unwrap();
            let content = content.clone().unwrap_or_default();
            runs.push(Run { job, content, name, stood });
            runs.iter().filter(|run| run.job == job).count() as u64
        };
        let mut dice = Dice::new(self.script.seed ^ (job as u64) << 20 ^ number << 40);
        let calm = self.script.calm.load(Ordering::SeqCst);
        context.progress.begin(Stage::Survey, 10);
        fs::create_dir_all(&context.scratch).unwrap();
        fs::create_dir_all(&work.output).unwrap();
        if !calm && dice.percent(30) {
            self.hang(job, &context.cancel);
        }
        if self.dead.load(Ordering::SeqCst) || context.cancel.is_cancelled() {
            return Err(failure("told to stop", true));
        }
        if self.script.disk_full.load(Ordering::SeqCst) || (!calm && dice.percent(8)) {
            return Err(failure("no room", true));
        }
        let Some(content) = content else { return Err(failure("an input is gone", true)) };
        match content::nature(&content) {
            Nature::Hopeless => return Err(failure("no cloud", false)),
            Nature::Panics => panic!("on purpose"),
            Nature::Good if !calm && dice.percent(5) => panic!("by chance"),
            Nature::Good => {}
        }
        fs::write(work.output.join("metadata.json"), &content).unwrap();
        Ok(ConversionResult {
            json: serde_json::json!({ "content": content }),
            ..ConversionResult::default()
        })
    }

    /// A picture says of which octree it is.
    fn preview(
        &self,
        octree: &Path,
        into: &Path,
        _: &PreviewOptions,
        context: &Context,
    ) -> render::Result<PreviewManifest> {
        let path = octree.join("metadata.json");
        let shows = fs::read_to_string(&path).map_err(|source| RenderError::Read { path, source })?;
        let throw = blake3::hash(format!("{shows} {}", self.script.seed).as_bytes()).as_bytes()[0];
        let calm = self.script.calm.load(Ordering::SeqCst);
        if self.dead.load(Ordering::SeqCst) || context.cancel.is_cancelled() {
            return Err(RenderError::Cancelled);
        }
        if self.script.disk_full.load(Ordering::SeqCst) {
            return Err(RenderError::Encode { what: "a picture", reason: "no room".into() });
        }
        match throw % 8 {
            0 if !calm => panic!("by chance"),
            1 => return Err(RenderError::Nothing { folder: octree.to_path_buf() }),
            _ => {}
        }
        fs::create_dir_all(into).unwrap();
        fs::write(into.join("preview.json"), &shows).unwrap();
        let made = serde_json::json!({ "shows": shows, "renderer": "none", "assets": [], "seconds": 0 });
        Ok(serde_json::from_value(made).unwrap())
    }
}
