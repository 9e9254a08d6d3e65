//! What a verification found, on a job's page.

use maud::{Markup, html};
use serde_json::Value;

use super::{parts, words};
use crate::platform::clock::Millis;
use crate::serve::queue::{Verification, Verified};

pub(super) fn section(verification: &Verification, now: Millis) -> Markup {
    html! {
        section.card #verification aria-labelledby="verification-title" {
            h2 #verification-title { "Verification" }
            @match (verification.state, &verification.report) {
                (Verified::Queued, _) => {
                    p.banner.warn { "Ordered " (parts::time(verification.asked_at, now)) ". It runs as soon as there is time for it, at low priority." }
                }
                (Verified::Failed, _) => {
                    p.banner.bad { "It could not be verified: " (verification.error.as_deref().unwrap_or("no reason was told")) }
                }
                (Verified::Done, Some(report)) => { (found(report, verification.ended_at.unwrap_or(now), now)) }
                (Verified::Done, None) => p.dim { "Its report cannot be read any more." },
            }
        }
    }
}

fn found(report: &Value, at: Millis, now: Millis) -> Markup {
    let against = &report["against"];
    let checks = |value: &Value| value["checks"].as_array().cloned().unwrap_or_default();
    let all = [checks(report), checks(against)].concat();
    html! {
        @if report["ok"] == true {
            p.banner.good {
                strong { "It is right." } " "
                @if against.is_object() {
                    "Every one of " (words::grouped(against["points"].as_u64().unwrap_or_default()))
                    " points of its files is there, with all its attributes, to the last bit."
                } @else { "Nothing is wrong with it." }
            }
        } @else {
            p.banner.bad { strong { "Something is wrong with it." } " The checks below say what; convert it anew." }
        }
        @if !against.is_object() {
            p.dim { "Its files are no longer what or where they were, so it was checked on its own." }
        }
        p.dim {
            "Checked " (parts::time(at, now))
            @if let Some(seconds) = report["seconds"].as_f64() { ", in " (words::duration((1000.0 * seconds) as i64)) }
        }
        details open[report["ok"] != true] {
            summary { (words::counted(all.len() as u64, "check", "checks")) }
            table {
                thead { tr { th scope="col" { "Check" } th scope="col" { "Outcome" } th scope="col" { "What was found" } } }
                tbody {
                    @for check in &all {
                        @let outcome = check["outcome"].as_str().unwrap_or("");
                        tr {
                            td { (check["name"].as_str().unwrap_or("")) }
                            td { span class={ "badge " (kind(outcome)) } { (outcome) } }
                            td {
                                (check["summary"].as_str().unwrap_or(""))
                                @for example in check["examples"].as_array().into_iter().flatten() {
                                    div.dim { (example.as_str().unwrap_or("")) }
                                }
                            }
                        }
                    }
                }
            }
        }
    }
}

fn kind(outcome: &str) -> &'static str {
    match outcome {
        "ok" => "done",
        "wrong" => "failed",
        "note" => "owed",
        _ => "",
    }
}
