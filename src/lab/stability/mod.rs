//! The stability table: every scene known to break converters, by both samplers,
//! beside a benign one of as many points. It tells what became of it and what it
//! cost; a row that misses a target says so.
//!
//! Scene and benign scene take turns (A B A B …), so that a busy minute of the
//! machine strikes both, and the medians are compared.

mod cases;
mod depth;
mod options;
mod page;
mod row;

use serde::Serialize;

use super::settings::{Result, Step, WorkFolder};
use crate::convert::options::Sampling;
use cases::Case;
pub use options::StabilityOptions;
pub use page::{markdown, plain};
pub use row::Row;
use row::{BENIGN, CLOUD};

#[derive(Debug, Serialize)]
pub struct StabilityTable {
    pub version: &'static str,
    pub threads: usize,
    pub rounds: usize,
    pub rows: Vec<Row>,
}

/// Measures all scenes that are wished for. `say` is told before each step;
/// `shown` gets each row when it is there.
pub fn measure(
    options: &StabilityOptions,
    say: &dyn Fn(Step),
    shown: &dyn Fn(&Row),
) -> Result<StabilityTable> {
    let cases = cases::wished(options);
    let samplings = [Sampling::Poisson, Sampling::Random];
    let of = cases.len() * samplings.len();
    let means = &options.means;
    let place = WorkFolder::new(means)?;
    let mut table = StabilityTable {
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
