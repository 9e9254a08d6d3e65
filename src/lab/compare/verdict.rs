//! What the figures say of the default method: whether it is the one that the
//! charts speak for.

use super::report::{ComparisonReport, MethodReport, SceneReport};
use crate::words::grouped;

/// Share of the samples that may have one of another node too near.
pub const MOST_ACROSS: f64 = 0.0005;
/// Times as fast as the paper's shells that the default is to be.
pub const LEAST_SPEEDUP: f64 = 4.0;
/// Most that a single frequency may stand out of its ring and be no line: the
/// mean of a few patterns of noise comes to less.
pub const MOST_LINE: f64 = 8.0;

/// A claim about the default, and whether the figures bear it out.
#[derive(Debug, Clone, PartialEq)]
pub struct Claim {
    pub holds: bool,
    pub words: String,
}

pub fn findings(report: &ComparisonReport) -> Vec<Claim> {
    let mut findings = Vec::new();
    for scene in &report.scenes {
        let Some(default) = scene.default_method() else { continue };
        let name = &scene.name;
        findings.push(on_the_front(scene, default, &report.budgets));
        let even = default.even;
        let words = format!(
            "{name}: of {} samples, {} have one of their node too near, {} ({:.3} %) one of another node",
            grouped(even.samples),
            grouped(even.inside),
            grouped(even.across),
            100.0 * even.across_share()
        );
        findings.push(Claim { holds: even.inside == 0 && even.across_share() <= MOST_ACROSS, words });
        let speed = |method: &MethodReport| method.sampler_ns.map(|spread| spread.median);
        if let (Some(shells), Some(own)) = (scene.method("shells").and_then(speed), speed(default)) {
            let times = shells / own;
            let words = format!("{name}: its sampler is {times:.1} times as fast as the paper's shells");
            findings.push(Claim { holds: times >= LEAST_SPEEDUP, words });
        }
    }
    if let Some(pattern) = report.patterns.first() {
        let line = pattern.spectrum.line;
        let words = format!("on a plane, its strongest frequency stands {line:.1} × out of its ring");
        findings.push(Claim { holds: line <= MOST_LINE, words });
    }
    findings
}

fn good(words: String) -> Claim {
    Claim { holds: true, words }
}

fn bad(words: String) -> Claim {
    Claim { holds: false, words }
}

/// Whether no method is both faster and truer than the default, in pictures of few
/// points as in those of many. Where one is at some budgets only, that is told too.
fn on_the_front(scene: &SceneReport, default: &MethodReport, budgets: &[u64]) -> Claim {
    let by = |budget: &u64| beaten_by(scene, default, *budget);
    let (beaten, front): (Vec<u64>, Vec<u64>) = budgets.iter().copied().partition(|b| !by(b).is_empty());
    let mut names: Vec<&str> = beaten.iter().flat_map(by).collect();
    names.sort_unstable();
    names.dedup();
    let (name, own, names) = (&scene.name, &default.method, names.join(" and "));
    let points = |budgets: &[u64]| budgets.iter().map(|b| grouped(*b)).collect::<Vec<_>>().join(" and ");
    if beaten.is_empty() {
        good(format!("{name}: no method is both faster and truer than {own}"))
    } else if front.is_empty() {
        bad(format!("{name}: {names} is both faster and truer than {own}"))
    } else {
        good(format!(
            "{name}: no method is both faster and truer than {own} in pictures of {} points; in those of {}, {names} is",
            points(&front),
            points(&beaten),
        ))
    }
}

/// Methods that cost less and err less, clearly: the machine is noisy, and so are
/// pictures.
fn beaten_by<'a>(scene: &'a SceneReport, default: &MethodReport, budget: u64) -> Vec<&'a str> {
    let better = |method: &&MethodReport| {
        method.cpu.median < 0.97 * default.cpu.median && method.error(budget) < 0.97 * default.error(budget)
    };
    scene.methods.iter().filter(better).map(|method| method.method.as_str()).collect()
}

#[cfg(test)]
mod tests {
    use super::super::report::tests_support::{method, report};
    use super::*;

    #[test]
    fn a_default_that_is_beaten_or_uneven_or_slow_is_told() {
        let good =
            report(vec![method("poisson", 1.0, 2.0), method("random", 0.7, 4.0), method("shells", 1.5, 2.0)]);
        assert!(findings(&good).iter().all(|finding| finding.holds), "{:?}", findings(&good));
        assert_eq!(findings(&good).len(), 4);

        let mut beaten = good.clone();
        beaten.scenes[0].methods[1] = method("random", 0.7, 1.5);
        let told = findings(&beaten);
        assert!(!told[0].holds && told[0].words.contains("random is both"), "{told:?}");

        let mut beaten_once = good.clone();
        let pictures = &mut beaten_once.scenes[0].methods[1].pictures;
        pictures.iter_mut().filter(|p| p.budget == 50_000).for_each(|p| p.error = 1.5);
        let told = findings(&beaten_once);
        assert!(told[0].holds && told[0].words.ends_with("in those of 50 000, random is"), "{told:?}");

        let mut uneven = good.clone();
        uneven.scenes[0].methods[0].even.across = 100;
        assert!(!findings(&uneven)[1].holds);
        let mut slow = good.clone();
        slow.scenes[0].methods[0].sampler_ns = slow.scenes[0].methods[2].sampler_ns;
        assert!(!findings(&slow)[2].holds);
        let mut lined = good;
        lined.patterns[0].spectrum.line = 50.0;
        assert!(!findings(&lined)[3].holds);
    }
}
