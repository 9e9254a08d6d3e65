//! The stability table: every scene known to break converters, by both samplers,
//! beside a benign one of as many points. It tells what became of it and what it
//! cost; a row that misses a target says so.
//!
//! Scene and benign scene take turns (A B A B …), so that a busy minute of the
//! machine strikes both, and the medians are compared.

mod cases;
mod depth;
mod page;
mod row;

use std::io;
use std::path::{Path, PathBuf};

use serde::Serialize;

use crate::format::inputs::InputsError;
use crate::format::las::LasError;
use crate::format::potree::PotreeError;
use crate::stage::context::Cancel;
use crate::stage::options::Sampling;
use crate::synth::Kind;
use cases::Case;
pub use page::{markdown, plain};
pub use row::Row;

/// Most that a scene may cost, in multiples of the benign one.
pub const MOST_TIME: f64 = 2.0;
pub const MOST_MEMORY: f64 = 1.5;
/// Levels that an octree may have below what the cloud asks for.
pub const MOST_LEVELS: u32 = 1;

/// What is to be measured, and by what means.
#[derive(Debug, Clone)]
pub struct Wishes {
    /// The program that converts: this one.
    pub program: PathBuf,
    /// Points of every scene.
    pub points: u64,
    /// Also the failing scenes as large as the papers have them.
    pub full: bool,
    /// Only these scenes; all where empty.
    pub scenes: Vec<Kind>,
    /// Conversions a row.
    pub rounds: usize,
    /// Clouds and octrees go below this folder, and are removed after each scene.
    pub folder: PathBuf,
    pub threads: usize,
    /// Stops it all, and leaves nothing behind.
    pub cancel: Cancel,
}

impl Wishes {
    fn go_on(&self) -> Result<()> {
        if self.cancel.is_cancelled() { Err(StabilityError::Stopped) } else { Ok(()) }
    }

    /// What became of a process, unless it was called off.
    fn ended<T>(&self, what: &str, ended: io::Result<T>) -> Result<T> {
        self.go_on()?;
        ended.map_err(|source| StabilityError::Run { what: what.to_string(), source })
    }
}

/// How far it is.
#[derive(Debug, Clone)]
pub struct Step {
    pub done: usize,
    pub of: usize,
    pub what: String,
}

#[derive(Debug, Serialize)]
pub struct Table {
    pub version: &'static str,
    pub threads: usize,
    pub rounds: usize,
    pub rows: Vec<Row>,
}

/// Why there is no table. A conversion that fails is a row.
#[derive(Debug, thiserror::Error)]
pub enum StabilityError {
    #[error("could not work in {}: {source} (choose another place with --temp-dir)", path.display())]
    Folder { path: PathBuf, source: io::Error },
    #[error("the report was stopped on request; nothing was written")]
    Stopped,
    #[error("could not measure {what}: {source}")]
    Run { what: String, source: io::Error },
    #[error(transparent)]
    Inputs(#[from] InputsError),
    #[error(transparent)]
    Las(#[from] LasError),
    #[error(transparent)]
    Potree(#[from] PotreeError),
}

type Result<T> = std::result::Result<T, StabilityError>;

/// Measures all scenes that are wished for. `say` is told before each step;
/// `shown` gets each row when it is there.
pub fn measure(wishes: &Wishes, say: &dyn Fn(Step), shown: &dyn Fn(&Row)) -> Result<Table> {
    let cases = cases::wished(wishes);
    let samplings = [Sampling::Poisson, Sampling::Random];
    let of = cases.len() * samplings.len();
    let place = Place::new(&wishes.folder)?;
    let mut table = Table {
        version: env!("CARGO_PKG_VERSION"),
        threads: wishes.threads,
        rounds: wishes.rounds,
        rows: Vec::new(),
    };
    let mut benign: Option<Case> = None;
    for case in &cases {
        let step = |what: String, done: usize| say(Step { done, of, what });
        let done = table.rows.len();
        if benign.as_ref().is_none_or(|b| b.recipe.points != case.recipe.points) {
            let next = Case::benign(case.recipe.points);
            step(format!("making {}", next.title), done);
            next.make(wishes, &place.benign())?;
            benign = Some(next);
        }
        step(format!("making {}", case.title), done);
        case.make(wishes, &place.cloud())?;
        let own = depth::asked(&place.cloud())?;
        wishes.go_on()?;
        for sampling in samplings {
            let done = table.rows.len();
            let row = row::measure(wishes, case, sampling, &place, own, &|what| step(what, done))?;
            shown(&row);
            table.rows.push(row);
        }
        place.clear()?;
    }
    Ok(table)
}

/// The folder that all happens in; it goes when this does.
struct Place(PathBuf);

impl Place {
    fn new(folder: &Path) -> Result<Place> {
        let path = folder.join(format!(".lodestone-report-{}", std::process::id()));
        std::fs::create_dir_all(&path)
            .map_err(|source| StabilityError::Folder { path: path.clone(), source })?;
        Ok(Place(path))
    }

    fn benign(&self) -> PathBuf {
        self.0.join("benign")
    }

    fn cloud(&self) -> PathBuf {
        self.0.join("cloud")
    }

    fn octree(&self) -> PathBuf {
        self.0.join("octree")
    }

    fn words(&self) -> PathBuf {
        self.0.join("words")
    }

    fn verdict(&self) -> PathBuf {
        self.0.join("verdict")
    }

    fn clear(&self) -> Result<()> {
        std::fs::remove_dir_all(self.cloud())
            .map_err(|source| StabilityError::Folder { path: self.cloud(), source })
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        // Where this fails there is nobody left to tell but the log.
        if let Err(error) = std::fs::remove_dir_all(&self.0) {
            tracing::warn!(folder = %self.0.display(), %error, "left something behind");
        }
    }
}
