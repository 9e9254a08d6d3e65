//! `/`: the queue on a page that a person reads. Plain HTML without resources from
//! elsewhere. A small script listens to the events; without scripts the page
//! reloads itself.

use std::fmt::Write;

use axum::extract::State as Extract;
use axum::http::header;
use axum::response::{Html, IntoResponse, Response};

use super::Shared;
use super::api::{self, JobView, Refusal};
use crate::config::size::Size;

/// Pixels of a picture in the list.
const ICON: u64 = 64;

/// The page's beginning; `base` is in front of every path of ours.
fn head(base: &str) -> String {
    format!(
        "<!doctype html><html lang=en data-base='{base}'><meta charset=utf-8>\
         <noscript><meta http-equiv=refresh content=2></noscript><script src={base}/page.js defer></script>\
         <meta name=viewport content='width=device-width'><title>Lodestone</title>\
         <link rel=stylesheet href='{base}/page.css'>"
    )
}

pub(super) async fn page(Extract(shared): Extract<Shared>) -> Result<Response, Refusal> {
    let jobs = shared.store.jobs(None, None, 100).await?;
    let jobs: Vec<JobView> = api::views(&shared, jobs).await?;
    let health = shared.health();
    let mut html = head(shared.config.access.base());
    html.push_str("<main><h1>Lodestone</h1><p>Drop LAS or LAZ files, or folders of tiles, into ");
    let folders: Vec<String> = health
        .watched
        .iter()
        .map(|(path, _)| format!("<code>{}</code>", escape(&path.to_string_lossy())))
        .collect();
    html.push_str(&folders.join(", "));
    html.push_str(".</p>");
    for missing in &health.missing {
        let _ = write!(html, "<p class=failed>{} is not there.</p>", escape(&missing.to_string_lossy()));
    }
    html.push_str("<table><tr><th>#<th><th>Name<th>State<th>Points<th>Size<th>");
    for view in &jobs {
        row(&mut html, view);
    }
    html.push_str("</table>");
    if !health.waiting.is_empty() {
        html.push_str("<h2>Seen, not taken yet</h2><table>");
        for waiting in health.waiting.iter().take(100) {
            let path = escape(&waiting.path.to_string_lossy());
            let _ = write!(html, "<tr><td>{path}<td>{}", escape(&waiting.why));
        }
        html.push_str("</table>");
    }
    html.push_str("</main>");
    Ok(Html(html).into_response())
}

/// What keeps the page as the daemon has it.
pub(super) async fn script() -> Response {
    ([(header::CONTENT_TYPE, "text/javascript; charset=utf-8")], include_str!("page.js")).into_response()
}

pub(super) async fn style() -> Response {
    ([(header::CONTENT_TYPE, "text/css; charset=utf-8")], include_str!("page.css")).into_response()
}

fn row(html: &mut String, view: &JobView) {
    let job = &view.job;
    let state = job.state.name();
    let name = match &view.octree {
        Some(url) => format!("<a href='{url}'>{}</a>", escape(&job.name)),
        None => escape(&job.name),
    };
    let said = match (&view.progress, &job.hold, &job.error) {
        (Some(now), ..) => {
            let left =
                now.seconds_left.map_or(String::new(), |left| format!(", {left:.0} s left in this stage"));
            format!("{} {:.0} %, {:.0} points/s{left}", now.stage, now.percent, now.points_per_second)
        }
        (_, Some(hold), _) => format!("held: {hold}"),
        (_, _, Some(error)) => error.clone(),
        _ => String::new(),
    };
    let _ = write!(
        html,
        "<tr id=job-{0}><td>{0}<td class=thumb>{4}<td>{name}<td class={state}>{state}<td>{1}<td>{2}<td>{3}",
        job.id,
        job.points,
        Size(job.bytes),
        escape(&said),
        picture(view).unwrap_or_default()
    );
}

/// A small picture of the octree, which leads to a large one; the script has it
/// turn under the pointer.
fn picture(view: &JobView) -> Option<String> {
    let preview = view.preview.as_ref()?;
    let small = preview.still(ICON)?;
    let large = preview.assets.iter().filter(|asset| asset.frames <= 1).max_by_key(|asset| asset.width)?;
    let (small, large) = (escape(&small.url), escape(&large.url));
    let turning = preview.turntable().map(|t| format!(" data-turning='{}'", escape(&t.url)));
    let (name, turning) = (escape(&view.job.name), turning.unwrap_or_default());
    Some(format!(
        "<a href='{large}'><img src='{small}'{turning} alt='Picture of {name}' width={ICON} height={ICON} loading=lazy></a>"
    ))
}

/// File names come from anybody who may write to the inbox.
pub(super) fn escape(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            '\'' => escaped.push_str("&#39;"),
            c => escaped.push(c),
        }
    }
    escaped
}
