//! What stands around the list: how the daemon is, what it may do, where files go
//! and what waits there.

use super::super::refusal::ApiError;
use super::super::shared::AppState;
use super::figures::JobTotals;
use super::{charts, figures, frame, parts, words};
use crate::serve::job::State;
use crate::serve::queue::{QueueMode, Shown};
use crate::serve::watch::events::NotifyMode as News;
use crate::words::Lines;
use maud::{Markup, html};

/// Things that wait and are told of.
const WAITING: usize = 200;

/// What somebody must know before all else.
pub(super) async fn banners(shared: &AppState) -> Result<Markup, ApiError> {
    let health = shared.health();
    let free = shared.disk.free_space(&shared.config.octrees()).ok();
    let reserve = shared.config.disk_reserve;
    let mode = shared.store.mode().await?;
    let base = frame::base(shared);
    Ok(html! {
        div #banners {
            @if mode != QueueMode::Run {
                div.banner.warn {
                    @if mode == QueueMode::Pause {
                        "Everything is paused: nothing runs until it is resumed."
                    } @else {
                        "Draining: what runs goes on to its end, nothing new is started."
                    }
                    form method="post" action={ (base) "/queue/order" } {
                        button.primary name="mode" value="run" { "Resume" }
                    }
                }
            }
            @for missing in &health.missing {
                p.banner.bad {
                    (missing.to_string_lossy()) " is not there. Is the disk or share mounted? Nothing is done about \
                    its files until it is back."
                }
            }
            @if let Some(error) = &health.queue_error { p.banner.bad { "The queue: " (parts::text(error)) } }
            @if let Some(free) = free {
                @if free < reserve {
                    p.banner.bad {
                        "Only " (words::bytes(free)) " of disk are free, less than the reserve of "
                        (words::bytes(reserve)) ": jobs wait until there is room."
                    }
                }
            }
        }
    })
}

/// Figures of the whole daemon, and what steers it.
pub(super) async fn strip(shared: &AppState, totals: &JobTotals) -> Result<Markup, ApiError> {
    let now = shared.clock.now();
    let of = |state: State| {
        totals
            .counts
            .iter()
            .find(|(shown, _)| *shown == Shown::In(state))
            .map_or(0, |(_, jobs)| (*jobs).max(0) as u64)
    };
    let free = shared.disk.free_space(&shared.config.octrees()).ok();
    let hours = &totals.hours;
    let this = now / figures::HOUR;
    let by_hour: Vec<f64> = (0..=figures::HOURS)
        .map(|at| this - figures::HOURS + at)
        .map(|hour| hours.iter().find(|(h, ..)| *h == hour).map_or(0.0, |(_, jobs, _)| *jobs as f64))
        .collect();
    let done: i64 = hours.iter().map(|(_, jobs, _)| jobs).sum();
    let rates = shared.board.rates();
    let points: f64 = shared.board.readings(now).iter().map(|(_, reading)| reading.points_per_second).sum();
    let mode = shared.store.mode().await?;
    let base = frame::base(shared);
    Ok(html! {
        section.strip #strip aria-label="The daemon" {
            dl.figures {
                div { dt { "running" } dd { (words::grouped(of(State::Running))) } }
                div { dt { "waiting" } dd { (words::grouped(of(State::Queued))) } }
                div { dt { "disk free" } dd { (free.map_or("unknown".to_string(), words::bytes)) } }
                div { dt { "memory" } dd {
                    @match resident() { Some(bytes) => (words::bytes(bytes)), None => "unknown" }
                    span.dim { " of " (words::bytes(shared.config.memory_limit)) }
                } }
                div.chart {
                    dt { "points a second" }
                    dd { (words::points(points as u64)) (charts::line(&rates, "Points a second in the last half hour")) }
                }
                div.chart {
                    dt { "jobs done" }
                    dd {
                        (words::grouped(done.max(0) as u64)) span.dim { " in 24 h" }
                        (charts::bars(&by_hour, "Jobs that were done in each of the last 24 hours"))
                    }
                }
            }
            form.modes method="post" action={ (base) "/queue/order" } {
                @for (each, text, what) in [
                    (QueueMode::Run, "Run", "Start jobs as they come"),
                    (QueueMode::Drain, "Drain", "Let what runs end, start nothing new"),
                    (QueueMode::Pause, "Pause all", "Stop what runs for now, start nothing new"),
                ] {
                    button name="mode" value=(each.name()) title=(what)
                        aria-pressed=(if each == mode { "true" } else { "false" }) { (text) }
                }
            }
        }
    })
}

/// Memory that this process has, in bytes.
fn resident() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
    line.trim().trim_end_matches("kB").trim().parse::<u64>().ok().map(|kib| kib * 1024)
}

/// Where files are handed in.
pub(super) fn upload(shared: &AppState, base: &str) -> Markup {
    if !shared.config.upload {
        return html! {};
    }
    html! {
        section.drop #drop aria-labelledby="drop-title" {
            strong #drop-title { "Drop LAS or LAZ files here, or folders of tiles" }
            form method="post" action={ (base) "/upload" } enctype="multipart/form-data" {
                label.chooser { span { "Choose files" } input type="file" name="files" multiple accept=".las,.laz"; }
                label.chooser { span { "Choose a folder" } input type="file" name="files" webkitdirectory; }
                button { "Upload" }
            }
            ul.uploads aria-label="Uploads" aria-live="polite" {}
        }
    }
}

/// What a newcomer does first.
pub(super) fn welcome(shared: &AppState) -> Markup {
    html! {
        section.card.welcome {
            h2 { "Nothing here yet. Give it a point cloud." }
            ol {
                li {
                    @if shared.config.upload { "Drop a LAS or LAZ file, or a folder of tiles, onto this page, or copy it into " }
                    @else { "Copy a LAS or LAZ file, or a folder of tiles, into " }
                    code { (shared.config.inbox().to_string_lossy()) } "."
                }
                li { "Lodestone waits until it is whole, converts it, and checks every point." }
                li { "It appears here with a picture that turns, and as an octree for Potree and other viewers." }
            }
            p.dim {
                "Nothing at hand? " code { "lodestone synth town --points 5M -o " (shared.config.inbox().to_string_lossy()) "/town.laz" }
                " makes one up."
            }
        }
    }
}

/// The watched folders, and what waits in them and why.
pub(super) fn waiting(shared: &AppState) -> Markup {
    let health = shared.health();
    html! {
        section.card #waiting aria-labelledby="folders-title" {
            h2 #folders-title { "Watched folders" }
            ul.folders {
                @for (path, mode) in &health.watched {
                    li {
                        code { (path.to_string_lossy()) } " "
                        span.dim {
                            @if health.missing.contains(path) { "is not there" }
                            @else if *mode == News::Events { "news comes at once" }
                            @else { "looked at every few seconds, for the file system tells no news" }
                        }
                    }
                }
            }
            @if health.waiting.is_empty() {
                p.dim { "Nothing waits there: all that was dropped is in the list." }
            } @else {
                h3 { "Seen, not taken" }
                table.waits {
                    thead { tr { th scope="col" { "File" } th scope="col" { "Why, and what to do" } } }
                    tbody {
                        @for waiting in health.waiting.iter().take(WAITING) {
                            tr {
                                td { (Lines(waiting.path.to_string_lossy())) }
                                td {
                                    @if !waiting.kind.may_pass() { span.badge.owed { "not taken" } " " }
                                    (parts::text(waiting.why.strip_prefix("is not taken: ").unwrap_or(&waiting.why)))
                                    @if let Some((bytes, all)) = waiting.bytes.zip(waiting.expected_bytes) {
                                        progress max=(all) value=(bytes) aria-label="Bytes that have arrived" {
                                            (words::bytes(bytes)) " of " (words::bytes(all))
                                        }
                                    }
                                    @if let Some(job) = waiting.job {
                                        " " a href={ (frame::base(shared)) "/jobs/" (job) } { "job " (job) }
                                    }
                                }
                            }
                        }
                    }
                }
                @if health.waiting.len() > WAITING {
                    p.dim { "and " (health.waiting.len() - WAITING) " more" }
                }
            }
        }
    }
}
