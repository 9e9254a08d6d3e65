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

use serde::Serialize;

use super::settings::{Means, Place, Result, Step};
use crate::convert::options::Sampling;
use crate::lab::synth::Kind;
use cases::Case;
pub use page::{markdown, plain};
pub use row::Row;

/// What lies in the folder for temporary files.
const BENIGN: &str = "benign";
const CLOUD: &str = "cloud";
const OCTREE: &str = "octree";
const WORDS: &str = "words";
const VERDICT: &str = "verdict";

/// Most that a scene may cost, in multiples of the benign one.
pub const MOST_TIME: f64 = 2.0;
pub const MOST_MEMORY: f64 = 1.5;
/// Levels that an octree may have below what the cloud asks for.
pub const MOST_LEVELS: u32 = 1;

/// What is to be measured, and by what means.
#[derive(Debug, Clone)]
pub struct Wishes {
    pub means: Means,
    /// Points of every scene.
    pub points: u64,
    /// Also the failing scenes as large as the papers have them.
    pub full: bool,
    /// Only these scenes; all where empty.
    pub scenes: Vec<Kind>,
}

#[derive(Debug, Serialize)]
pub struct Table {
    pub version: &'static str,
    pub threads: usize,
    pub rounds: usize,
    pub rows: Vec<Row>,
}

/// Measures all scenes that are wished for. `say` is told before each step;
/// `shown` gets each row when it is there.
pub fn measure(wishes: &Wishes, say: &dyn Fn(Step), shown: &dyn Fn(&Row)) -> Result<Table> {
    let cases = cases::wished(wishes);
    let samplings = [Sampling::Poisson, Sampling::Random];
    let of = cases.len() * samplings.len();
    let means = &wishes.means;
    let place = Place::new(means)?;
    let mut table = Table {
        version: env!("CARGO_PKG_VERSION"),
        threads: means.threads,
        rounds: means.rounds,
        rows: Vec::new(),
    };
    let mut benign: Option<Case> = None;
    for case in &cases {
        let step = |what: String, done: usize| say(Step { done, of, what });
        let done = table.rows.len();
        if benign.as_ref().is_none_or(|b| b.recipe.points != case.recipe.points) {
            let next = Case::benign(case.recipe.points);
            step(format!("making {}", next.title), done);
            means.synthesise(&next.recipe, &next.title, &place.at(BENIGN))?;
            benign = Some(next);
        }
        step(format!("making {}", case.title), done);
        means.synthesise(&case.recipe, &case.title, &place.at(CLOUD))?;
        let own = depth::asked(&place.at(CLOUD))?;
        means.go_on()?;
        for sampling in samplings {
            let done = table.rows.len();
            let row = row::measure(means, case, sampling, &place, own, &|what| step(what, done))?;
            shown(&row);
            table.rows.push(row);
        }
        place.clear(CLOUD)?;
    }
    Ok(table)
}
