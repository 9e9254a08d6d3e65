//! Speed against accuracy: every sampler and every renderer on the same scenes,
//! what it costs and how good it is (the measures of MEASURES: pictures held
//! against those of all points, spacing, coverage and spectrum of samples).
//!
//! ```text
//! scene ─┬▶ conversions in turns, a process each ──▶ octrees ─┬▶ spacing, holes
//!        └▶ samplers alone, in turns                          ├▶ pictures of coarse levels
//!                                                             └▶ renderers by budget
//! plane of noise ──▶ samplers ──▶ patterns, spectra
//! ```
//!
//! All is data first ([`ComparisonReport`], written as JSON); the page is made from that.

mod cloud;
mod conversion;
mod machine;
mod method;
mod options;
mod page;
mod pattern;
mod pictures;
mod report;
mod sampler;
mod steps;
mod verdict;

use super::settings::{Result, Step, WorkFolder};
pub use method::Method;
pub use options::CompareOptions;
use options::VIEWS;
pub use page::{main_chart, page};
pub use report::{ComparisonReport, read};
use steps::Steps;
pub use verdict::{Claim, findings};

/// Measures all that is wished for. `say` is told before each step.
pub fn measure(options: &CompareOptions, say: &dyn Fn(Step)) -> Result<ComparisonReport> {
    let place = WorkFolder::new(&options.means)?;
    let clouds = cloud::all(options);
    // A cloud is made, converted, sampled, looked at, and drawn.
    let of_cloud = 1 + options.means.rounds * (1 + Method::ALL.len()) + Method::ALL.len() + VIEWS.len();
    let of = clouds.len() * of_cloud + Method::samplers().count();
    let steps = Steps { done: Default::default(), of, say };
    let mut report = ComparisonReport::new(options);
    for method in Method::samplers() {
        steps.next(format!("patterns of {}", method.name()));
        report.patterns.push(pattern::measure(method, options.patterns));
        options.means.go_on()?;
    }
    for cloud in &clouds {
        report.scenes.push(cloud::measure(options, cloud, &place, &steps)?);
    }
    Ok(report)
}
