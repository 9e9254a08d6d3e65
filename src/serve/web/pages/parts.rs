//! What several pages are made of: a job's state, its progress, its picture.

use maud::{Markup, html};

use super::super::api::JobView;
use super::words;
use crate::platform::clock::Millis;
use crate::serve::job::time::iso8601;
use crate::serve::job::{JobId, State};
use crate::serve::queue::Drawn;
use crate::serve::queue::progress::ProgressReading;
use crate::words::Lines;

/// What a stage does, in a word or two.
pub(super) fn stage(name: &str) -> &'static str {
    match name {
        "queued" => "beginning",
        "survey" => "counting points",
        "distribute" => "sorting into chunks",
        "index" => "building the octree",
        "merge" => "joining levels",
        "publish" => "publishing",
        _ => "finishing",
    }
}

/// A job's state: its kind for the colour, and its words.
pub(super) fn state(view: &JobView) -> (&'static str, &'static str) {
    let job = &view.job;
    match job.state {
        State::Done if job.superseded_by.is_some() => ("replaced", "replaced"),
        state => (state.name(), state.name()),
    }
}

pub(super) fn badge(view: &JobView) -> Markup {
    let (kind, words) = state(view);
    html! {
        span class={ "badge " (kind) } { (words) }
        @if owes_picture(view) { " " span.badge.owed { "picture to come" } }
        @if let Some(wish) = view.job.wish { " " span.badge.owed { (wish.name()) " asked" } }
    }
}

/// Whether the octree is there and its picture is not.
pub(super) fn owes_picture(view: &JobView) -> bool {
    view.preview.as_ref().is_some_and(|preview| preview.state == Drawn::Queued)
}

/// What a running job's bars say in words.
pub(super) fn says(reading: &ProgressReading) -> String {
    let mut text = format!("{} {:.0} %", stage(reading.stage), reading.percent);
    if let Some(seconds) = reading.whole_seconds_left {
        text += &format!(" · {}", words::left(seconds));
    }
    if reading.points_per_second >= 1.0 {
        text += &format!(" · {} points/s", words::points(reading.points_per_second as u64));
    }
    text
}

/// Two bars: the whole conversion, and the stage it is in. The script moves them.
pub(super) fn progress(job: JobId, reading: &ProgressReading) -> Markup {
    let (whole, stage) = (format!("{:.1}", reading.whole_percent), format!("{:.1}", reading.percent));
    html! {
        div.progress data-progress=(job) {
            progress.whole max="100" value=(whole) aria-label="Whole conversion" { (whole) " %" }
            progress.stage max="100" value=(stage) aria-label="This stage" { (stage) " %" }
            span.says { (says(reading)) }
        }
    }
}

/// A text that may hold others' words, as an error with a path in it: what would turn
/// it around or cannot be seen is escaped, and what stands between backticks is code.
pub(super) fn text(text: &str) -> Markup {
    let text = Lines(text).to_string();
    let pieces: Vec<&str> = text.split('`').collect();
    let is_paired = pieces.len() % 2 == 1;
    html! {
        @for (at, piece) in pieces.iter().enumerate() {
            @if is_paired && at % 2 == 1 { code { (piece) } }
            @else { @if !is_paired && at > 0 { "`" } (piece) }
        }
    }
}

/// A text with the folders above a job's source left out: the list tells which file
/// it is about.
pub(super) fn without_folders(view: &JobView, text: &str) -> String {
    let source = view.job.source.to_string_lossy();
    match view.job.source.file_name() {
        Some(file) => text.replace(source.as_ref(), &file.to_string_lossy()),
        None => text.to_string(),
    }
}

/// Points of a job; none are known of one that failed before they were counted.
pub(super) fn points(view: &JobView) -> Markup {
    let job = &view.job;
    html! {
        @if job.points == 0 && job.state != State::Done { "—" }
        @else { span title=(words::grouped(job.points)) { (words::points(job.points)) } }
    }
}

/// Why a job is where it is, where that needs a word.
pub(super) fn note(view: &JobView, now: Millis) -> Option<String> {
    let job = &view.job;
    match job.state {
        State::Queued if job.not_before > now => {
            let wait = words::duration(job.not_before - now);
            let why = job.error.as_deref().map(|error| format!(": {error}")).unwrap_or_default();
            Some(format!("tried again in {wait}{why}"))
        }
        State::Queued => job.hold.as_deref().map(|hold| format!("waits: {hold}")),
        State::Failed | State::Quarantined => job.error.clone(),
        State::Done => job.superseded_by.map(|by| format!("job {by} made a newer octree of this name")),
        _ => None,
    }
}

/// A small picture that turns while it is looked at; a placeholder where there is
/// none yet.
pub(super) fn thumbnail(view: &JobView, wide: u64) -> Markup {
    let preview = view.preview.as_ref();
    let still = preview.and_then(|preview| preview.still(wide));
    let turning = preview.and_then(|preview| preview.turntable()).map(|asset| asset.url.as_str());
    let (kind, _) = state(view);
    html! {
        @match still {
            Some(still) => {
                img src=(still.url) data-turning=[turning] alt={ "Picture of " (view.job.name) }
                    width="96" height="96" loading="lazy";
            }
            None => span class={ "nopicture " (kind) @if owes_picture(view) { " owed" } } aria-hidden="true" {},
        }
    }
}

/// A time that people read and machines too.
pub(super) fn time(then: Millis, now: Millis) -> Markup {
    html! { time.ago datetime=(iso8601(then)) title=(iso8601(then)) { (words::ago(then, now)) } }
}

/// A text and a button that copies it. An address in it, `url`, is copied whole, with
/// the host under which the page was found.
pub(super) fn copyable(text: &str, url: Option<&str>) -> Markup {
    html! {
        span.copyable {
            code { (Lines(text)) } " "
            button.copy.quiet type="button" data-copy=(text) data-copy-url=[url] { "Copy" }
        }
    }
}
