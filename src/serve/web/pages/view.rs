//! `/view/{name}` and `/share/{token}/view`: the viewer, in which an octree is looked at from
//! wherever one likes. What it shows is drawn by its scripts (`assets/viewer/`); without
//! them, or without WebGPU, the octree's turntable is there to be turned.

use axum::extract::{Path, State as Extract};
use axum::http::StatusCode;
use axum::response::Response;
use maud::{Markup, html};

use super::super::api;
use super::super::previews::PreviewView;
use super::super::refusal::ApiError;
use super::super::shared::AppState;
use super::super::{files, octrees};
use super::{frame, share};

/// What the page is told of the octree.
struct Shown<'a> {
    name: &'a str,
    /// Where its data is asked for.
    data: String,
    /// What is left by the way back, and how that is called.
    back: Option<(String, &'static str)>,
    preview: Option<PreviewView>,
}

/// Where people look at an octree.
pub(super) fn url(base: &str, name: &str) -> String {
    format!("{base}/view/{}", octrees::encoded_part(name))
}

/// For whoever may read.
pub(super) async fn page(
    Extract(shared): Extract<AppState>,
    Path(name): Path<String>,
) -> Result<Response, ApiError> {
    let none = || ApiError::new(StatusCode::NOT_FOUND, format!("there is no octree called {name}"));
    let folder = files::below(&shared.config.octrees(), &name).filter(|_| !name.contains('/'));
    let folder = folder.ok_or_else(none)?;
    if !tokio::fs::metadata(&folder).await.is_ok_and(|folder| folder.is_dir()) {
        return Err(none());
    }
    let base = frame::base(&shared);
    // One that no job of ours made can be looked at too.
    let job = shared.store.standing(&name).await?;
    let back =
        job.as_ref().map_or((format!("{base}/"), "Jobs"), |job| (format!("{base}/jobs/{}", job.id), "Job"));
    let preview = match &job {
        Some(job) => api::one(&shared, job.id).await?.preview,
        None => None,
    };
    let data = format!("{base}/api/octrees/{}", octrees::encoded_part(&name));
    Ok(answer(base, &Shown { name: &name, data, back: Some(back), preview }))
}

/// For whoever has a link.
pub(super) async fn shared_page(
    Extract(shared): Extract<AppState>,
    Path(token): Path<String>,
) -> Result<Response, ApiError> {
    let Some(name) = shared.store.shared(&token).await? else { return Ok(share::nothing(&shared)) };
    let Some(job) = shared.store.standing(&name).await? else { return Ok(share::nothing(&shared)) };
    let base = frame::base(&shared);
    let link = format!("{base}/share/{token}");
    let mut preview = api::one(&shared, job.id).await?.preview;
    // The pictures' addresses are those of people who are let in.
    let folder = octrees::folder(base, &name);
    for asset in preview.iter_mut().flat_map(|preview| &mut preview.assets) {
        if let Some(rest) = asset.url.strip_prefix(&folder) {
            asset.url = format!("{link}/octree{rest}");
        }
    }
    let back = Some((link.clone(), "Back"));
    Ok(answer(base, &Shown { name: &name, data: format!("{link}/data"), back, preview }))
}

fn answer(base: &str, shown: &Shown) -> Response {
    let preview = shown.preview.as_ref();
    let turntable = preview.and_then(|preview| preview.turntable().or_else(|| preview.still(500)));
    let body = html! {
        body.viewer data-data=(shown.data) data-name=(shown.name) {
            a.skip href="#picture" { "Skip to the picture" }
            header.view-top {
                @if let Some((href, text)) = &shown.back { a href=(href) { "‹ " (text) } }
                h1 { bdi { (shown.name) } }
                button #panel-toggle type="button" aria-expanded="false" aria-controls="panel" { "Settings" }
            }
            main #main {
                div #stage {
                canvas #picture tabindex="0" role="application" aria-describedby="keys-short"
                    aria-label={ "The point cloud " (shown.name) ", in three dimensions" } {}
                p #keys-short.visually-hidden {
                    "Arrow keys turn, with Shift they move, plus and minus go nearer and away. The settings list all keys."
                }
                svg #marks aria-hidden="true" {}
                (tools())
                div #legend aria-label="Legend" role="group" hidden {}
                section #picked aria-label="Picked point" hidden {
                    div #picked-text tabindex="0" role="group" aria-label="Its values" {}
                    button #picked-close.quiet type="button" { "Close" }
                }
                div #notices {
                    p #says role="status" { "Opening…" }
                    div #trouble.banner.warn role="alert" hidden {
                        span #trouble-text {} " "
                        button #trouble-retry type="button" hidden { "Try again" }
                        button #trouble-close.quiet type="button" { "Close" }
                    }
                }
                }
                (panel())
                section #fallback aria-label="Turntable" {
                    p #fallback-why { "The viewer needs scripts and WebGPU." }
                    @if let Some(asset) = turntable {
                        div #turntable-box {
                            img #turntable src=(asset.url) data-type=(asset.media_type) alt={ (shown.name) " from all sides" }
                                width=(asset.width) height=(asset.height);
                            canvas #turntable-hand hidden width=(asset.width) height=(asset.height)
                                aria-hidden="true" {}
                        }
                        label #turntable-label hidden { "Turn it " input #turntable-angle type="range" min="0" max="1" value="0" step="1"; }
                    } @else { p { "It has no pictures that could be shown instead." } }
                }
                noscript { p.banner.warn { "The viewer draws by scripts, which are switched off here." } }
            }
        }
    };
    frame::full(base, &format!("{} · Lodestone", shown.name), body)
}

/// What is done often, one press away.
fn tools() -> Markup {
    html! {
        div #tools role="toolbar" aria-label="View" {
            button type="button" data-view="home" title="All of it (Home)" { "Whole" }
            button type="button" data-view="top" title="From above, north up (T)" { "Top" }
            label { span.visually-hidden { "From the side of" }
                select #side {
                    option value="" { "Side…" }
                    option value="-90" { "from the south" }
                    option value="180" { "from the west" }
                    option value="90" { "from the north" }
                    option value="0" { "from the east" }
                }
            }
            button #walk type="button" aria-pressed="false" title="Walk and look around (G)" { "Walk" }
            button #measure type="button" aria-pressed="false" title="Distance between two points (M)" { "Measure" }
            button #copy-link type="button" title="A link to this view" { "Copy link" }
            button #save type="button" title="This view as a PNG" { "Save picture" }
        }
    }
}

fn panel() -> Markup {
    html! {
        aside #panel aria-label="Settings" hidden {
            label { "Color by" select #by {} }
            label { "Points at most"
                select #budget {
                    @for (value, text) in [
                        (200_000, "200 thousand"), (500_000, "500 thousand"), (1_000_000, "1 million"), (2_000_000, "2 million"),
                        (5_000_000, "5 million"),
                    ] { option value=(value) { (text) } }
                }
            }
            label { "Size of points " input #point-size type="range" min="0.5" max="3" step="0.1" value="1"; }
            label.check { input #lighting type="checkbox" checked; "Shade by depth" }
            fieldset {
                legend { "Slice by height" }
                label { "from " output #low-text {} input #low type="range" min="0" max="1000" value="0"; }
                label { "to " output #high-text {} input #high type="range" min="0" max="1000" value="1000"; }
                button #slice-off.quiet type="button" { "All heights" }
            }
            p #stats.dim {}
            details {
                summary { "Mouse, touch and keys" }
                dl.keys {
                    dt { "Turn" } dd { "drag, one finger, arrow keys" }
                    dt { "Move" } dd { "drag with the right button or Shift, two fingers, Shift and arrow keys" }
                    dt { "Nearer, away" } dd { "wheel, pinch, + and −" }
                    dt { "Go to a point" } dd { "double click, double tap" }
                    dt { "Pick a point" } dd { "click, tap, Enter for the middle" }
                    dt { "Walk" } dd { "G; then W A S D, E up, Q down, drag to look around" }
                    dt { "Whole, top" } dd { "Home, T" }
                    dt { "Measure" } dd { "M; Escape ends it" }
                }
            }
        }
    }
}
