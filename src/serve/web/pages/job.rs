//! `/jobs/{id}`: all that is known of one job, by a link that lasts.

use axum::extract::{Extension, Path, Query, State as Extract};
use axum::response::Response;
use maud::{Markup, html};
use serde::Deserialize;

use super::super::api::{self, JobView};
use super::super::octrees;
use super::super::refusal::ApiError;
use super::super::session::Role;
use super::super::shared::AppState;
use super::{attributes, frame, parts, result, share, verified, view as viewer, words};
use crate::platform::clock::Millis;
use crate::serve::job::state_machine::next;
use crate::serve::job::time::iso8601;
use crate::serve::job::{Event, QueuedFile, State};
use crate::serve::log::LogLine;
use crate::serve::queue::{Attempt, Drawn, History};
use crate::words::Lines;

/// Inputs that are listed.
const INPUTS: usize = 200;

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct JobQuery {
    said: Option<String>,
}

pub(super) async fn page(
    Extract(shared): Extract<AppState>,
    Extension(role): Extension<Role>,
    Path(id): Path<i64>,
    Query(asked): Query<JobQuery>,
) -> Result<Response, ApiError> {
    let (base, now) = (frame::base(&shared), shared.clock.now());
    let view = api::one(&shared, id).await?;
    let inputs = shared.store.inputs(id).await?;
    let (attempts, history) = (shared.store.attempts(id).await?, shared.store.history(id).await?);
    let lines = shared.store.lines(id).await?;
    let verification = shared.store.verification(id).await?;
    let shares = shared.store.shares(&view.job.name).await?;
    let folder = shared.config.octrees().join(&view.job.name);
    let stands = view.stands();
    // Reading a few small files; the disk may be slow.
    let on_disk = tokio::task::spawn_blocking(move || stands.then(|| attributes::OnDisk::read(&folder)));
    let on_disk = on_disk.await.ok().flatten();
    let name = view.job.name.clone();
    let main = html! {
        p.crumbs { a href={ (base) "/" } { "‹ All jobs" } }
        div.title {
            h1 { bdi { (name) } }
            (parts::badge(&view))
        }
        (frame::said(asked.said.as_deref(), None))
        (state(base, &view, now))
        @if view.stands() { p { a #look.button.primary href=(viewer::url(base, &name)) { "Look around in 3D" } } }
        (pictures(&view))
        (orders(base, &view))
        @if let Some(verification) = &verification { (verified::section(verification, now)) }
        @if let Some(report) = view.job.result.as_ref().filter(|_| view.job.state == State::Done) {
            (result::all(report))
        }
        @if let Some(on_disk) = &on_disk { (attributes::table(on_disk)) }
        div.cards {
            div {
                @if let Some(on_disk) = &on_disk {
                    (attributes::files(on_disk, &view, &octrees::folder(base, &view.job.name)))
                    (share::section(base, &view, &shares, now))
                }
            }
            div { (sources(&view, &inputs, now)) (story(&attempts, &history, now)) }
        }
        (log(&lines))
    };
    Ok(frame::page(&shared, role, &format!("{name} · Lodestone"), main))
}

/// Where it is and what comes next, in a sentence.
fn state(base: &str, view: &JobView, now: Millis) -> Markup {
    let job = &view.job;
    let took = job.started_at.zip(job.finished_at).map(|(start, end)| words::duration(end - start));
    let sentence = match job.state {
        State::Queued if job.not_before > now => "It is tried again by itself, after a pause.".to_string(),
        State::Queued => "It waits for its turn and starts by itself.".to_string(),
        State::Running => "It is being converted. The page follows it; there is nothing to do.".to_string(),
        State::Paused => "It is paused; resume it, and it goes on from there.".to_string(),
        State::Done if job.superseded_by.is_some() => "Its octree was replaced by a newer one.".to_string(),
        State::Done => format!("Done{}.", took.map(|took| format!(" in {took}")).unwrap_or_default()),
        State::Failed => "It failed. Mend what the reason names, then try it again; a file that is written \
                          anew is tried by itself."
            .to_string(),
        State::Quarantined => {
            "It failed again and again and is left alone, until its file is written anew or \
                               somebody tries it again."
                .to_string()
        }
        State::Cancelled => {
            "It was called off. Try it again whenever you like; its files are where they were.".to_string()
        }
    };
    html! {
        section.state-box #state aria-label="State" {
            p { (sentence) }
            @if let Some(reading) = &view.progress { (parts::progress(job.id, reading)) }
            @if let Some(note) = parts::note(view, now) {
                p class=(if job.state.is_open() || job.state == State::Done { "banner warn" } else { "banner bad" }) {
                    (parts::text(&note))
                    @if let Some(by) = job.superseded_by { " " a href={ (base) "/jobs/" (by) } { "Go to job " (by) } }
                }
            }
            dl.figures {
                div { dt { "points" } dd { (parts::points(view)) } }
                div { dt { "files" } dd { (words::bytes(job.bytes)) } }
                div { dt { "came in" } dd { (parts::time(job.created_at, now)) } }
                @if let Some(at) = job.started_at { div { dt { "begun" } dd { (parts::time(at, now)) } } }
                @if let Some(at) = job.finished_at { div { dt { "ended" } dd { (parts::time(at, now)) } } }
                div { dt { "attempts" } dd { (job.attempts) } }
                div { dt { "job" } dd { "#" (job.id) @if job.revision > 1 { ", revision " (job.revision) } } }
            }
        }
    }
}

fn pictures(view: &JobView) -> Markup {
    let Some(preview) = &view.preview else { return html! {} };
    let name = &view.job.name;
    let overview = preview.assets.iter().filter(|asset| asset.frames <= 1).max_by_key(|asset| asset.width);
    let still = preview.still(500);
    html! {
        section.pictures #pictures aria-label="Pictures" {
            @if let Some(turntable) = preview.turntable() {
                figure.turntable {
                    picture {
                        @if let Some(still) = still {
                            source #turntable-still media="(prefers-reduced-motion: reduce)" srcset=(still.url);
                        }
                        img #turntable src=(turntable.url) data-still=[still.map(|still| still.url.as_str())]
                            width=(turntable.width) height=(turntable.height) alt={ (name) " from all sides" };
                    }
                    figcaption {
                        button #turn.quiet type="button" hidden aria-pressed="true" aria-controls="turntable" { "Stop turning" }
                    }
                }
            }
            @if let Some(overview) = overview {
                figure.overview {
                    a href=(overview.url) {
                        img src=(overview.url) width=(overview.width) height=(overview.height)
                            alt={ "Overview of " (name) };
                    }
                    @if let Some(shows) = &preview.shows { figcaption.dim { "colored by " (shows) } }
                }
            }
            @match preview.state {
                Drawn::Queued => {
                    p.banner.warn {
                        @if preview.assets.is_empty() { "Its pictures are still to come." }
                        @else { "New pictures are still to come; these are from before." }
                        @if let Some(error) = &preview.error { " The last try: " (parts::text(error)) }
                    }
                }
                Drawn::Failed => {
                    p.banner.bad {
                        "Its pictures could not be made: " (parts::text(preview.error.as_deref().unwrap_or("no reason was told")))
                        ". The octree is whole all the same; have new pictures made to try again."
                    }
                }
                Drawn::Nothing => {
                    p.dim { "No pictures: " (parts::text(preview.error.as_deref().unwrap_or("there is nothing to show"))) }
                }
                Drawn::Done => {}
            }
        }
    }
}

/// Buttons for what can be ordered in this state; what destroys asks first.
fn orders(base: &str, view: &JobView) -> Markup {
    let job = &view.job;
    let to = format!("{base}/jobs/{}/order", job.id);
    let can = |event: Event| next(job.state, event).is_some();
    let stands = view.stands();
    let gone = matches!(job.state, State::Failed | State::Quarantined | State::Cancelled)
        || (job.state == State::Done && job.superseded_by.is_some());
    let plain = |order: &str, text: &str| {
        html! { form method="post" action=(to) { button name="order" value=(order) { (text) } } }
    };
    let again = html! {
        form method="post" action=(to) { button.primary name="order" value="retry" { "Try again" } }
    };
    let asked = |order: &str, text: &str, warning: &str, yes: &str| {
        html! {
            details.confirm {
                summary.button { (text) "…" }
                form.asks method="post" action=(to) {
                    p { (warning) }
                    button.danger name="order" value=(order) { (yes) }
                }
            }
        }
    };
    html! {
        section.orders #orders aria-label="Orders" {
            @if can(Event::Retry) && job.state != State::Done { (again) }
            @if can(Event::Pause) { (plain("pause", "Pause")) }
            @if can(Event::Resume) { (plain("resume", "Resume")) }
            @if can(Event::Cancel) {
                (asked("cancel", "Cancel", "What was done of this conversion is lost. Its files stay.", "Yes, call it off"))
            }
            @if stands {
                (plain("verify", "Verify"))
                (plain("preview", "New pictures"))
                (asked("retry", "Convert anew", "The octree is made once more and then replaced. It is served until then.", "Yes, convert it anew"))
            }
            @if gone { (plain("dismiss", "Dismiss")) }
            @if job.state.is_open() {
                form.inline method="post" action=(to) {
                    label for="priority" { "Priority" }
                    input #priority type="number" name="priority" value=(job.priority) step="1" aria-describedby="priority-help";
                    span #priority-help.visually-hidden { "Higher goes first" }
                    button name="order" value="priority" { "Set" }
                }
            }
        }
    }
}

fn sources(view: &JobView, inputs: &[QueuedFile], now: Millis) -> Markup {
    html! {
        section.card #inputs aria-labelledby="inputs-title" {
            h2 #inputs-title { "What came in" }
            p { (parts::copyable(&view.job.source.to_string_lossy(), None)) }
            @if inputs.len() > 1 || inputs.first().is_some_and(|input| input.path != view.job.source) {
                details {
                    summary { (words::counted(inputs.len() as u64, "file", "files")) }
                    div.scroll tabindex="0" role="region" aria-label="Files that came in" {
                        table {
                            thead { tr { th scope="col" { "File" } th.num scope="col" { "Size" } th.num scope="col" { "Written" } } }
                            tbody {
                                @for input in inputs.iter().take(INPUTS) {
                                    tr {
                                        td { (Lines(input.path.strip_prefix(&view.job.source).unwrap_or(&input.path).to_string_lossy())) }
                                        td.num { (words::bytes(input.size)) }
                                        td.num { (parts::time(input.mtime_ns / 1_000_000, now)) }
                                    }
                                }
                            }
                        }
                    }
                    @if inputs.len() > INPUTS { p.dim { "and " (inputs.len() - INPUTS) " more" } }
                }
            }
            @if let Some(hash) = inputs.first().filter(|_| inputs.len() == 1).map(|input| input.hash.as_str()) {
                @if !hash.is_empty() { p.dim { "BLAKE3 " (parts::copyable(hash, None)) } }
            }
        }
    }
}

/// What happened to it.
fn story(attempts: &[Attempt], history: &[History], now: Millis) -> Markup {
    html! {
        section.card #story aria-labelledby="story-title" {
            h2 #story-title { "What happened" }
            @if !attempts.is_empty() {
                table {
                    caption.visually-hidden { "Attempts" }
                    thead { tr {
                        th scope="col" { "Attempt" } th scope="col" { "Begun" } th.num scope="col" { "Took" }
                        th scope="col" { "Ended" }
                    } }
                    tbody {
                        @for attempt in attempts.iter().take(20) {
                            tr {
                                td { (attempt.number) }
                                td { (parts::time(attempt.started_at, now)) }
                                td.num { (words::duration(attempt.ended_at.unwrap_or(now) - attempt.started_at)) }
                                td { (attempt.outcome.as_deref().map_or("runs", happened)) @if let Some(error) = &attempt.error { ": " (parts::text(error)) } }
                            }
                        }
                    }
                }
            }
            details open[attempts.is_empty()] {
                summary { "History" }
                ul.history {
                    @for line in history {
                        li {
                            (parts::time(line.at, now)) " " (happened(&line.kind))
                            @if let Some(detail) = line.detail.as_deref().filter(|detail| !detail.is_empty()) { ": " (parts::text(detail)) }
                        }
                    }
                }
            }
        }
    }
}

/// An event of a job, in words.
fn happened(kind: &str) -> &str {
    match kind {
        "queued" => "came in",
        "claim" => "started",
        "succeed" => "done",
        "fail" => "failed",
        "postpone" => "failed, which may pass; tried again later",
        "crash" => "the daemon died",
        "quarantine" => "failed once too often",
        "park" => "stopped, to go on later",
        "cancel" => "called off",
        "pause" => "paused",
        "resume" => "resumed",
        "retry" => "to be tried again",
        "preview" => "pictures made",
        other => other,
    }
}

fn log(lines: &[LogLine]) -> Markup {
    if lines.is_empty() {
        return html! {};
    }
    html! {
        section.card #log aria-labelledby="log-title" {
            h2 #log-title { "Log" }
            div.scroll.log tabindex="0" role="region" aria-labelledby="log-title" {
                table {
                    tbody {
                        @for line in lines {
                            tr class={ "level-" (line.level) } {
                                td { time datetime=(iso8601(line.at)) { (iso8601(line.at).replace('T', " ")) } }
                                td { (line.level) }
                                td { (Lines(&line.text)) }
                            }
                        }
                    }
                }
            }
        }
    }
}
