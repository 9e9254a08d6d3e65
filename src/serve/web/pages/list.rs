//! `/`: all jobs, a page at a time.

use axum::extract::{Extension, Query, State as Extract};
use axum::response::Response;
use maud::{Markup, html};
use serde::Deserialize;

use super::super::api::{self, JobView};
use super::super::octrees;
use super::super::refusal::ApiError;
use super::super::session::Role;
use super::super::shared::AppState;
use super::{crs, frame, overview, parts, view as viewer, words};
use crate::platform::clock::Millis;
use crate::serve::job::State;
use crate::serve::queue::{FailureReason, Listing, ListingCursor, ListingPage, Shown, Sort};
use crate::words::{Lines, is_invisible};

/// Jobs on a page.
const JOBS: i64 = 50;
/// Reasons of failures that are told.
const REASONS: usize = 12;
/// Bytes of a search.
const LONGEST_SEARCH: usize = 200;

/// What an address asks for. What is not understood asks for nothing.
#[derive(Debug, Default, Clone, Deserialize)]
#[serde(default)]
pub(super) struct ListQuery {
    state: Option<String>,
    q: Option<String>,
    sort: Option<String>,
    at: Option<String>,
    said: Option<String>,
    n: Option<u64>,
}

impl ListQuery {
    pub fn listing(&self) -> Listing {
        // Names hold nothing invisible, see `serve::watch::names`.
        let search = self.q.as_deref().unwrap_or("").replace(is_invisible, "");
        let search = search.trim();
        let end = (0..=search.len().min(LONGEST_SEARCH)).rev().find(|end| search.is_char_boundary(*end));
        let order = self.sort.as_deref().unwrap_or("");
        let name = order.strip_suffix(UP).unwrap_or(order);
        let sort = Sort::parse(name);
        Listing {
            shown: self.state.as_deref().and_then(Shown::parse),
            search: search[..end.unwrap_or(0)].to_string(),
            sort: sort.unwrap_or_default(),
            ascending: sort.is_some() && name != order,
        }
    }
}

/// At the end of an order's name: the smallest first.
const UP: &str = "-up";

/// An order as it stands in an address.
fn order_name(sort: Sort, ascending: bool) -> String {
    format!("{}{}", sort.name(), if ascending { UP } else { "" })
}

/// The address of a listing, and of a place in it.
fn address(base: &str, listing: &Listing, place: Option<&ListingCursor>) -> String {
    let mut pairs = vec![];
    pairs.extend(listing.shown.map(|shown| ("state", shown.name().to_string())));
    if !listing.search.is_empty() {
        pairs.push(("q", listing.search.clone()));
    }
    if listing.sort != Sort::default() || listing.ascending {
        pairs.push(("sort", order_name(listing.sort, listing.ascending)));
    }
    pairs.extend(place.map(|place| ("at", place.to_text())));
    let query: Vec<String> =
        pairs.iter().map(|(key, value)| format!("{key}={}", octrees::encoded_part(value))).collect();
    if query.is_empty() { format!("{base}/") } else { format!("{base}/?{}", query.join("&")) }
}

pub(super) async fn page(
    Extract(shared): Extract<AppState>,
    Extension(role): Extension<Role>,
    Query(asked): Query<ListQuery>,
) -> Result<Response, ApiError> {
    let (base, now) = (frame::base(&shared), shared.clock.now());
    let listing = asked.listing();
    let place = asked.at.as_deref().and_then(ListingCursor::parse);
    let page = shared.store.listing(&listing, place.as_ref(), JOBS).await?;
    let totals = shared.figures.get(&shared.store, shared.clock.now()).await?;
    let counts = &totals.counts;
    let total = shared.store.total(&listing, &page, counts).await?;
    let all: i64 = counts.iter().filter(|(shown, _)| *shown != Shown::Dismissed).map(|(_, jobs)| jobs).sum();
    let reasons = match listing.shown {
        Some(shown @ (Shown::In(State::Failed) | Shown::In(State::Quarantined))) => {
            shared.store.reasons(shown, REASONS).await?
        }
        _ => vec![],
    };
    let views = api::views(&shared, page.jobs.clone()).await?;
    let nothing = all == 0 && counts.iter().all(|(_, jobs)| *jobs == 0);
    let main = html! {
        h1.visually-hidden { "Jobs" }
        (frame::said(asked.said.as_deref(), asked.n))
        (overview::banners(&shared).await?)
        (overview::strip(&shared, &totals).await?)
        (overview::upload(&shared, base))
        @if nothing { (overview::welcome(&shared)) }
        @else {
            (tabs(base, &listing, counts, all))
            (search(base, &listing))
            @if !reasons.is_empty() { (why(base, &listing, &reasons)) }
            @if views.is_empty() { (none(base, &listing)) }
            @else { (table(base, &listing, &views, now)) }
            (pager(base, &listing, &page, total))
            @if !views.is_empty() { (bulk(base, &listing)) }
        }
        (overview::waiting(&shared))
    };
    Ok(frame::page(&shared, role, "Lodestone", main))
}

fn tabs(base: &str, listing: &Listing, counts: &[(Shown, i64)], all: i64) -> Markup {
    let tab = |shown: Option<Shown>, name: &str, jobs: i64| {
        let is_here = listing.shown == shown;
        let to = address(base, &Listing { shown, ..listing.clone() }, None);
        html! {
            a.tab href=(to) aria-current=[is_here.then_some("page")] {
                (name) " " span.count { (words::grouped(jobs.max(0) as u64)) }
            }
        }
    };
    html! {
        nav.tabs #tabs aria-label="Jobs by state" {
            (tab(None, "all", all))
            @for (shown, jobs) in counts {
                @if *jobs > 0 || listing.shown == Some(*shown) { (tab(Some(*shown), shown.name(), *jobs)) }
            }
        }
    }
}

fn search(base: &str, listing: &Listing) -> Markup {
    html! {
        form.search role="search" method="get" action={ (base) "/" } {
            @if let Some(shown) = listing.shown { input type="hidden" name="state" value=(shown.name()); }
            label.visually-hidden for="q" { "Search by name" }
            input #q type="search" name="q" value=(listing.search) placeholder="Search by name" maxlength="200";
            label.visually-hidden for="sort" { "Order" }
            select #sort name="sort" {
                @for (sort, ascending, text) in ORDERS {
                    option value=(order_name(sort, ascending))
                        selected[(sort, ascending) == (listing.sort, listing.ascending)] { (text) }
                }
            }
            button { "Show" }
        }
    }
}

const ORDERS: [(Sort, bool, &str); 10] = [
    (Sort::Age, false, "newest first"),
    (Sort::Age, true, "oldest first"),
    (Sort::Name, true, "name, A to Z"),
    (Sort::Name, false, "name, Z to A"),
    (Sort::Points, false, "most points first"),
    (Sort::Points, true, "fewest points first"),
    (Sort::Size, false, "largest files first"),
    (Sort::Size, true, "smallest files first"),
    (Sort::Took, false, "longest run first"),
    (Sort::Took, true, "shortest run first"),
];

/// Why the jobs of this listing failed, for six hundred are not read one by one.
fn why(base: &str, listing: &Listing, reasons: &[FailureReason]) -> Markup {
    let state = listing.shown.map_or("failed", Shown::name);
    html! {
        section.card.why #why aria-labelledby="why-title" {
            h2 #why-title { "Why they failed" }
            p { "Mend what a reason names, then have its jobs tried again." }
            ul.reasons {
                @for reason in reasons {
                    li {
                        strong { (words::grouped(reason.jobs as u64)) " ×" }
                        div {
                            (parts::text(&reason.text))
                            div.dim {
                                @if reason.jobs > 1 { "for example " }
                                a href={ (base) "/jobs/" (reason.example) } { bdi { (reason.name) } }
                            }
                        }
                        @if reasons.len() > 1 {
                            form method="post" action={ (base) "/jobs/order" } {
                                input type="hidden" name="all" value=(state);
                                input type="hidden" name="reason" value=(reason.key);
                                input type="hidden" name="state" value=(state);
                                button name="order" value="retry" {
                                    "Retry " @if reason.jobs > 1 { "these" } @else { "it" }
                                    span.visually-hidden { ": " (reason.text) }
                                }
                            }
                        }
                    }
                }
            }
            details.confirm {
                summary.button { "Retry all " (state) "…" }
                form method="post" action={ (base) "/jobs/order" } {
                    p { "All of them are converted anew, one after the other." }
                    input type="hidden" name="all" value=(state);
                    input type="hidden" name="order" value="retry";
                    button.primary { "Yes, try all of them again" }
                }
            }
            details.confirm {
                summary.button { "Dismiss all " (state) "…" }
                form method="post" action={ (base) "/jobs/order" } {
                    p { "They leave the list; their files stay where they are." }
                    input type="hidden" name="all" value=(state);
                    input type="hidden" name="order" value="dismiss";
                    button { "Yes, take them out of the list" }
                }
            }
        }
    }
}

/// Orders to the jobs that are chosen in the table.
fn bulk(base: &str, listing: &Listing) -> Markup {
    html! {
        form.bulk #bulk method="post" action={ (base) "/jobs/order" } {
            input type="hidden" name="state" value=(listing.shown.map_or("", Shown::name));
            span.bulk-label { "Chosen: " strong #chosen {} }
            @for (order, text) in
                [("retry", "Retry"), ("pause", "Pause"), ("resume", "Resume"), ("dismiss", "Dismiss")] {
                button name="order" value=(order) { (text) }
            }
            details.confirm {
                summary.button { "Cancel…" }
                div.asks {
                    p { "What was done of them is lost. Their files stay." }
                    button.danger name="order" value="cancel" { "Yes, call them off" }
                }
            }
        }
    }
}

fn none(base: &str, listing: &Listing) -> Markup {
    html! {
        p.card.none {
            @if !listing.search.is_empty() { "No job here has “" bdi { (listing.search) } "” in its name. " }
            @else { "No job is " (listing.shown.map_or("here", Shown::name)) ". " }
            a href={ (base) "/" } { "Show all" }
        }
    }
}

fn table(base: &str, listing: &Listing, views: &[JobView], now: Millis) -> Markup {
    let head = |sort: Sort, text: &str, class: &str| {
        let is_it = listing.sort == sort;
        let ascending = if is_it { !listing.ascending } else { sort == Sort::Name };
        let to = address(base, &Listing { sort, ascending, ..listing.clone() }, None);
        let order = is_it.then_some(if listing.ascending { "ascending" } else { "descending" });
        html! { th scope="col" class=(class) aria-sort=[order] { a href=(to) { (text) } } }
    };
    html! {
        table.jobs #jobs {
            caption.visually-hidden { "Jobs" }
            thead {
                tr {
                    th.pick scope="col" {
                        input #pick-all type="checkbox" hidden aria-label="Choose all on this page";
                        span.visually-hidden { "Choose" }
                    }
                    th.pic scope="col" { span.visually-hidden { "Picture" } }
                    (head(Sort::Name, "Name", "name"))
                    th.state scope="col" { "State" }
                    (head(Sort::Points, "Points", "num"))
                    (head(Sort::Size, "Size", "num"))
                    (head(Sort::Took, "Took", "num"))
                    (head(Sort::Age, "Age", "num"))
                }
            }
            tbody { @for view in views { (row(base, view, now)) } }
        }
    }
}

fn row(base: &str, view: &JobView, now: Millis) -> Markup {
    let job = &view.job;
    let to = format!("{base}/jobs/{}", job.id);
    let took = match (job.started_at, job.finished_at, job.state) {
        (Some(start), Some(end), _) => Some(end - start),
        (Some(start), None, State::Running) => Some(now - start),
        _ => None,
    };
    html! {
        tr id={ "job-" (job.id) } class={ "is-" (parts::state(view).0) } {
            td.pick {
                input type="checkbox" form="bulk" name="job" value=(job.id) aria-label={ "Choose " (job.name) };
            }
            td.pic { a href=(to) aria-label={ "Open " (job.name) } { (parts::thumbnail(view, 96)) } }
            td.name {
                a href=(to) title=(job.name) { bdi { (job.name) } }
                div.dim { (about(view)) }
                @if view.stands() { a.look href=(viewer::url(base, &job.name)) aria-label={ "Look around in 3D: " (job.name) } { "Look around in 3D" } }
            }
            td.state {
                (parts::badge(view))
                @if let Some(reading) = &view.progress { (parts::progress(job.id, reading)) }
                @if let Some(note) = parts::note(view, now) {
                    p.note title=(Lines(&note)) { (parts::text(&parts::without_folders(view, &note))) }
                }
            }
            td.num data-label="points" { (parts::points(view)) }
            td.num data-label="size" { (words::bytes(job.bytes)) }
            td.num data-label="took" { @if let Some(took) = took { (words::duration(took)) } @else { "—" } }
            td.num data-label="age" { (parts::time(job.created_at, now)) }
        }
    }
}

/// What tells one job from another, below its name.
fn about(view: &JobView) -> String {
    let job = &view.job;
    let mut about = vec![];
    if job.revision > 1 {
        about.push(format!("revision {}", job.revision));
    }
    if job.priority != 0 {
        about.push(format!("priority {}", job.priority));
    }
    about.extend(job.result.as_ref().map(crs::of).and_then(crs::name));
    about.join(" · ")
}

fn pager(base: &str, listing: &Listing, page: &ListingPage, total: i64) -> Markup {
    let total = words::counted(total.max(0) as u64, "job", "jobs");
    html! {
        nav.pager #pager aria-label="Pages" {
            @if page.previous.is_some() {
                a.button href=(address(base, listing, None)) { "« First" }
                a.button rel="prev" href=(address(base, listing, page.previous.as_ref())) { "‹ Before" }
            }
            span { (page.jobs.len()) " of " (total) }
            @if page.next.is_some() {
                a.button rel="next" href=(address(base, listing, page.next.as_ref())) { "Next ›" }
            }
        }
    }
}
