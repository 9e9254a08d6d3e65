//! `/share/…`: one octree for whoever has the link, without the token, read-only.
//! The link is signed and can be taken back; it opens nothing else.

use axum::extract::{Path, State as Extract};
use axum::http::{HeaderMap, HeaderValue, StatusCode};
use axum::response::Response;
use maud::{Markup, html};

use super::super::api::{self, JobView};
use super::super::refusal::ApiError;
use super::super::shared::AppState;
use super::super::{files, octrees};
use super::{attributes, crs, frame, parts, words};
use crate::platform::clock::Millis;
use crate::serve::job::Job;
use crate::serve::queue::Share;

/// What an octree is made of, beside its pictures.
const FILES: [&str; 3] = ["metadata.json", "hierarchy.bin", "octree.bin"];

pub(super) fn nothing(shared: &AppState) -> Response {
    frame::bare(
        frame::base(shared),
        "Lodestone",
        StatusCode::NOT_FOUND,
        html! {
            div.card.login {
                h1 { "This link opens nothing" }
                p { "It was taken back, or is not whole. Ask whoever sent it for a new one." }
            }
        },
    )
}

/// A page with the octree's picture and where viewers find it.
pub(super) async fn page(
    Extract(shared): Extract<AppState>,
    Path(token): Path<String>,
) -> Result<Response, ApiError> {
    let Some(name) = shared.store.shared(&token).await? else { return Ok(nothing(&shared)) };
    let Some(job) = shared.store.standing(&name).await? else { return Ok(nothing(&shared)) };
    let base = frame::base(&shared);
    let view = api::one(&shared, job.id).await?;
    // The pictures' addresses are those of people who are let in; here they lie below the link.
    let below = format!("{base}/share/{token}/octree");
    let folder = octrees::folder(base, &name);
    let here = |url: &str| url.strip_prefix(&folder).map(|rest| format!("{below}{rest}"));
    let preview = view.preview.as_ref();
    let picture = preview.and_then(|preview| preview.turntable().or_else(|| preview.still(500)));
    let main = html! {
        div.card.shared {
            h1 { bdi { (name) } }
            @if let Some(url) = picture.and_then(|asset| here(&asset.url)) {
                img src=(url) alt={ (name) " from all sides" } width="512" height="512";
            }
            p { a.button.primary href={ (base) "/share/" (token) "/view" } { "Look around in 3D" } }
            p {
                (words::points(job.points)) " points, "
                @let wkt = job.result.as_ref().map_or("", crs::of);
                (crs::name(wkt).unwrap_or_else(|| "without a coordinate system".to_string()))
            }
            (attributes::addresses(
                view.octree.as_deref().and_then(here).as_deref(),
                view.copc.as_deref().and_then(here).as_deref(),
            ))
        }
    };
    Ok(frame::bare(base, &format!("{name} · Lodestone"), StatusCode::OK, main))
}

/// A file of the octree, whole or a part of it, for viewers on any page.
pub(super) async fn file(
    Extract(shared): Extract<AppState>,
    Path((token, path)): Path<(String, String)>,
    asked: HeaderMap,
) -> Result<Response, ApiError> {
    let Some(name) = shared.store.shared(&token).await? else { return Ok(nothing(&shared)) };
    let picture =
        path.strip_prefix("preview/").is_some_and(|rest| !rest.contains('/') && !rest.starts_with('.'));
    let is_copc = path.ends_with(".copc.laz") && !path.contains('/');
    if !FILES.contains(&path.as_str()) && !is_copc && !picture {
        return Ok(files::missing());
    }
    let place = shared.config.octrees().join(&name);
    let Some(file) = files::below(&place, &path) else { return Ok(files::missing()) };
    Ok(files::answer(&file, &asked, HeaderValue::from_static("private, no-cache")).await)
}

/// What a link is for people, a page, and for viewers, a file.
pub(in super::super) fn addresses(base: &str, share: &Share, job: &Job) -> [String; 2] {
    let page = format!("{base}/share/{}", share.token);
    let file = format!("{page}/octree/{}", octrees::JobOutputs::of(job).entry());
    [page, file]
}

/// On the job's page: the links that there are, and a new one.
pub(super) fn section(base: &str, view: &JobView, shares: &[Share], now: Millis) -> Markup {
    let to = format!("{base}/jobs/{}/order", view.job.id);
    html! {
        section.card #share aria-labelledby="share-title" {
            h2 #share-title { "Share" }
            p.dim { "A link opens this octree alone, to read, for whoever has it; no token is asked for. It holds until it is taken back." }
            @for share in shares {
                div.share {
                    @let [url, file] = addresses(base, share, &view.job);
                    dl.facts {
                        dt { "For people" } dd { (parts::copyable(&url, Some(&url))) }
                        dt { "For viewers" } dd { (parts::copyable(&file, Some(&file))) }
                    }
                    span.dim { "made " (parts::time(share.created_at, now)) } " "
                    details.confirm {
                        summary.button { "Take back…" }
                        form method="post" action=(to) {
                            input type="hidden" name="link" value=(share.id);
                            button.danger name="order" value="revoke" { "Yes, it is to open nothing any more" }
                        }
                    }
                }
            }
            @if view.stands() {
                form method="post" action=(to) { button name="order" value="share" { "Make a link" } }
            }
        }
    }
}
