//! The page: what the figures are made into for people.

mod drawing;
mod methods;
mod samples;

use super::report::ComparisonReport;
use super::verdict::{Claim, findings};
use crate::lab::chart::{Chart, Page};
use crate::words::grouped;

/// The page of a report, beside an earlier one where there is one.
pub fn page(report: &ComparisonReport, before: Option<&ComparisonReport>) -> Page {
    Page {
        title: "Lodestone: speed against accuracy".into(),
        lead: lead(report),
        sections: vec![
            methods::section(report, before),
            samples::section(report, before),
            drawing::section(report, before),
        ],
        foot: foot(report, before),
    }
}

/// The chart that says most: what the first scene costs by each method, and how
/// true its coarse levels are.
pub fn main_chart(report: &ComparisonReport) -> Option<Chart> {
    Some(methods::speed_accuracy(report, report.scenes.first()?, None).into())
}

fn lead(report: &ComparisonReport) -> String {
    let findings = findings(report);
    let missed: Vec<&str> = findings.iter().filter(|f| !f.holds).map(|f| f.words.as_str()).collect();
    let verdict = match missed.as_slice() {
        [] => "all that is claimed for it below holds".to_string(),
        missed => format!("not all that is claimed for it holds ({})", missed.join("; ")),
    };
    format!(
        "Which method should I use for my cloud, and what does it cost me? {} scenes were converted and drawn \
         by every method on this machine. The default is poisson sampling with high-quality shading, and \
         {verdict}.",
        report.scenes.len()
    )
}

fn foot(report: &ComparisonReport, before: Option<&ComparisonReport>) -> Vec<(String, String)> {
    let pair = |name: &str, value: String| (name.to_string(), value);
    let commit = if report.commit.is_empty() { "unknown" } else { &report.commit };
    let budgets: Vec<String> = report.budgets.iter().map(|budget| grouped(*budget)).collect();
    let mut foot = vec![
        pair("machine", report.machine.clone()),
        pair("lodestone", format!("{}, commit {commit}", report.version)),
        pair("threads", report.threads.to_string()),
        pair("conversions a method", format!("{} in turns; medians", report.rounds)),
        pair("seed of the scenes", report.seed.to_string()),
        pair("budgets of the methods' pictures", format!("{} points", budgets.join(", "))),
    ];
    if let Some(before) = before {
        foot.push(pair(
            "beside",
            format!("{}, commit {}, {}", before.version, before.commit, before.machine),
        ));
    }
    let say = |finding: &Claim| {
        format!("{}: {}", if finding.holds { "holds" } else { "does not hold" }, finding.words)
    };
    foot.extend(findings(report).iter().map(|finding| pair("claim", say(finding))));
    foot
}

#[cfg(test)]
mod tests {
    use super::super::report::tests_support::{method, report};
    use super::*;

    #[test]
    fn the_page_has_every_chart_and_every_method() {
        let now = report(vec![method("poisson", 1.0, 2.0), method("random", 0.7, 4.0)]);
        let mut before = now.clone();
        before.scenes[0].methods[1] = method("random", 0.9, 5.0);
        for before in [None, Some(&before)] {
            let html = page(&now, before).html();
            assert_eq!(html.matches("<svg").count(), 6, "{html}");
            assert!(html.contains("a &lt;machine&gt;") && html.contains("0123456789ab"));
            assert!(html.contains("random takes 0.70 × the processor time of poisson"), "{html}");
            assert!(!html.contains("NaN") && !html.contains("inf "), "{html}");
        }
        assert!(main_chart(&now).is_some_and(|chart| chart.svg_standalone().contains("poisson")));
    }

    #[test]
    fn a_report_is_read_again_as_it_was_written() {
        let folder = tempfile::tempdir().unwrap();
        let (path, now) = (folder.path().join("report.json"), report(vec![method("poisson", 1.0, 2.0)]));
        std::fs::write(&path, serde_json::to_vec(&now).unwrap()).unwrap();
        let back = super::super::read(&path).unwrap();
        assert_eq!(page(&back, None).html(), page(&now, None).html());
        std::fs::write(&path, "{}").unwrap();
        let error = super::super::read(&path).unwrap_err().to_string();
        assert!(error.contains("report.json") && error.contains("no report"), "{error}");
    }
}
