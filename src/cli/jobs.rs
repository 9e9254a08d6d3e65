//! `lodestone jobs`: the queue on the command line. It reads and writes the
//! queue's file itself, so it works with and without a running daemon; a running
//! one notices an order within a second.

use std::path::{Path, PathBuf};

use serde::Serialize;

use super::exit::Exit;
use super::output::{self, failed};
use crate::platform::clock::Clock;
use crate::serve::config::Layer;
use crate::serve::config::age::Age;
use crate::serve::config::size::Size;
use crate::serve::job::facts::Facts;
use crate::serve::job::time;
use crate::serve::job::{Event, Job, JobId, QueuedFile, State};
use crate::serve::queue::{Attempt, History, Store, StoreError};
use crate::words::{Plain, grouped};

/// List, show and control the jobs of the queue
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// The daemon's root folder [default: ./lodestone-data]
    #[arg(long, env = "LODESTONE_ROOT", value_name = "DIR", global = true)]
    root: Option<PathBuf>,
    /// The daemon's configuration file, for its root
    #[arg(long, env = "LODESTONE_CONFIG", value_name = "FILE", global = true)]
    config: Option<PathBuf>,
    /// Print JSON
    #[arg(long, global = true)]
    json: bool,
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, clap::Subcommand)]
enum Action {
    /// Jobs, the youngest first
    List {
        /// Only those in this state
        #[arg(long, ignore_case = true)]
        state: Option<State>,
        /// At most so many; how many more there are is said below them
        #[arg(long, default_value_t = 50, value_parser = clap::value_parser!(i64).range(1..=100_000))]
        limit: i64,
    },
    /// What is known of a job; with --json all of it
    Show { id: JobId },
    /// Try a job again that failed, was cancelled or is in quarantine; or make a lost octree anew
    Retry { id: JobId },
    /// Call a job off
    Cancel { id: JobId },
    /// Hold a job until it is resumed
    Pause { id: JobId },
    /// Let a paused job go on
    Resume { id: JobId },
    /// Make the pictures of a job's octree, be it once more
    Preview { id: JobId },
    /// Remove the records of ended jobs; those whose octree is there stay
    Purge {
        /// Only those that ended before so long, as in 12h, 30d or 8w
        #[arg(long, value_name = "AGE", default_value = "30d")]
        older_than: Age,
    },
    /// Change a job's priority; higher goes first
    Priority {
        id: JobId,
        #[arg(allow_negative_numbers = true)]
        priority: i64,
    },
}

pub fn run(arguments: Arguments) -> Exit {
    let file = match arguments.config.as_deref().map(Layer::read).transpose() {
        Ok(file) => file.unwrap_or_default(),
        Err(error) => {
            return output::misused(&error);
        }
    };
    let root = arguments.root.clone().or(file.root).unwrap_or_else(|| PathBuf::from("lodestone-data"));
    let runtime = match tokio::runtime::Builder::new_current_thread().enable_all().build() {
        Ok(runtime) => runtime,
        Err(error) => return failed(&error),
    };
    let text = runtime.block_on(async {
        let store = Store::open_existing(&root.join("lodestone.db")).await?;
        let text = act(&store, &root.join("octrees"), &arguments).await;
        store.close().await;
        text
    });
    match text {
        Ok(text) => output::print(&text, Exit::Done),
        Err(error) => failed(&error),
    }
}

/// A job with all that is told of it.
#[derive(Serialize)]
struct JobInFull<'a> {
    #[serde(flatten)]
    job: &'a Job,
    #[serde(flatten)]
    facts: Facts,
}

impl JobInFull<'_> {
    fn of(job: &Job, now: i64) -> JobInFull<'_> {
        JobInFull { job, facts: Facts::of(job, now) }
    }
}

#[derive(Serialize)]
struct JobDetails<'a> {
    #[serde(flatten)]
    told: JobInFull<'a>,
    inputs: Vec<QueuedFile>,
    attempts_log: Vec<Attempt>,
    history: Vec<History>,
}

async fn act(store: &Store, octrees: &Path, arguments: &Arguments) -> Result<String, StoreError> {
    let now = Clock::System.now();
    let order = |id: JobId, event: Event| async move {
        store.order(id, event, now).await?;
        Ok::<JobId, StoreError>(id)
    };
    let id = match &arguments.action {
        Action::List { state, limit } => {
            let jobs = store.jobs(*state, None, *limit).await?;
            let told: Vec<JobInFull> = jobs.iter().map(|job| JobInFull::of(job, now)).collect();
            if arguments.json {
                return Ok(json(&told));
            }
            let all = store.count_jobs(*state).await?;
            return Ok(table(&told) + &rest(jobs.len(), all));
        }
        Action::Purge { older_than } => {
            let gone = store.purge(now - older_than.0, octrees).await?;
            let text = match gone {
                1 => "1 record removed\n".to_string(),
                gone => format!("{gone} records removed\n"),
            };
            return Ok(if arguments.json { json(&serde_json::json!({ "purged": gone })) } else { text });
        }
        Action::Show { id } => *id,
        Action::Retry { id } => order(*id, Event::Retry).await?,
        Action::Cancel { id } => order(*id, Event::Cancel).await?,
        Action::Pause { id } => order(*id, Event::Pause).await?,
        Action::Resume { id } => order(*id, Event::Resume).await?,
        Action::Preview { id } => {
            store.order_preview(*id, now).await?;
            *id
        }
        Action::Priority { id, priority } => {
            store.set_priority(*id, *priority, now).await?;
            *id
        }
    };
    let job = store.job(id).await?;
    let told = JobInFull::of(&job, now);
    match (&arguments.action, arguments.json) {
        (Action::Show { .. }, true) => {
            let (inputs, history) = (store.inputs(id).await?, store.history(id).await?);
            Ok(json(&JobDetails { told, inputs, attempts_log: store.attempts(id).await?, history }))
        }
        (Action::Show { .. }, false) => show(store, &told).await,
        (_, true) => Ok(json(&told)),
        (_, false) => Ok(table(&[told])),
    }
}

fn json(value: &impl Serialize) -> String {
    // Jobs are plain values; there is nothing that JSON could not hold.
    serde_json::to_string_pretty(value).unwrap_or_default() + "\n"
}

/// Says what a list leaves out.
fn rest(shown: usize, all: i64) -> String {
    let all = usize::try_from(all).unwrap_or(0);
    match all.checked_sub(shown) {
        Some(1..) => format!("\nthe youngest {shown} of {all} jobs; `--limit {all}` shows all\n"),
        _ => String::new(),
    }
}

const COLUMNS: [&str; 9] = ["#", "NAME", "STATE", "POINTS", "SIZE", "TRIES", "CREATED", "TOOK", "WHY"];

fn table(jobs: &[JobInFull]) -> String {
    let head = COLUMNS.map(String::from);
    let rows: Vec<[String; 9]> = std::iter::once(head).chain(jobs.iter().map(row)).collect();
    let width = |column: usize| rows.iter().map(|row| row[column].chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = (0..8).map(width).collect();
    let mut text = String::new();
    for row in &rows {
        for (cell, width) in row.iter().zip(&widths) {
            text += cell;
            text += &" ".repeat(width - cell.chars().count() + 2);
        }
        text += &row[8];
        text.truncate(text.trim_end().len());
        text.push('\n');
    }
    text
}

fn row(told: &JobInFull) -> [String; 9] {
    let (job, facts) = (told.job, &told.facts);
    let state = match job.wish {
        Some(wish) => format!("{} ({} asked)", job.state.name(), wish.name()),
        None => job.state.name().to_string(),
    };
    let (points, size) = (grouped(job.points), Size(job.bytes).to_string());
    let took = facts.duration_seconds.map(time::duration).unwrap_or_default();
    // To the second, and without the zone that the head of `show` tells.
    let created = facts.created_at_iso.get(..19).unwrap_or_default().replace('T', " ") + "Z";
    let [id, tries] = [job.id.to_string(), job.attempts.to_string()];
    [id, Plain(&job.name).to_string(), state, points, size, tries, created, took, why(job, facts)]
}

/// What is to be known of a job in one line.
fn why(job: &Job, facts: &Facts) -> String {
    let mut parts: Vec<String> = Vec::new();
    match (job.superseded_by, job.hold.as_deref().or(job.error.as_deref())) {
        (_, Some(reason)) => parts.push(Plain(one_line(reason)).to_string()),
        (Some(by), None) => parts.push(format!("superseded by job {by}")),
        (None, None) => {}
    }
    let counted = [(facts.points_missing, "missing"), (facts.points_set_aside, "set aside")];
    for (points, what) in counted {
        parts.extend(points.filter(|points| *points > 0).map(|n| format!("{} {what}", grouped(n))));
    }
    match facts.warnings.len() {
        0 => {}
        1 => parts.push("1 warning".to_string()),
        n => parts.push(format!("{n} warnings")),
    }
    parts.join("; ")
}

/// An error may have lines, and a list has one for each job.
fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Inputs, and lines of the result and of the history, that a person is shown.
const MAX_SHOWN: usize = 20;
const MAX_RESULT: usize = 100;

async fn show(store: &Store, told: &JobInFull<'_>) -> Result<String, StoreError> {
    let (job, facts) = (told.job, &told.facts);
    let mut text = table(std::slice::from_ref(told));
    text += &format!("\nsource    {}\nrevision  {}\n", Plain(job.source.display()), job.revision);
    let times = [
        ("created ", Some(&facts.created_at_iso)),
        ("started ", facts.started_at_iso.as_ref()),
        ("finished", facts.finished_at_iso.as_ref()),
        ("waits to", facts.not_before_iso.as_ref()),
    ];
    for (what, time) in times {
        text += &time.map(|time| format!("{what}  {time}\n")).unwrap_or_default();
    }
    if let Some(by) = job.superseded_by {
        text += &format!("replaced  by job {by}\n");
    }
    // The queue of a daemon that is older than this program knows of none.
    if let Some(preview) = store.previews(&[job.id]).await.unwrap_or_default().get(&job.id) {
        let why = preview.error.as_deref().map(|error| format!(", {}", Plain(error))).unwrap_or_default();
        text += &format!("preview   {}{why}\n", preview.state.name());
    }
    for (points, what) in [
        (facts.points_written, "written"),
        (facts.points_set_aside, "set aside"),
        (facts.points_missing, "missing"),
    ] {
        text += &points.map(|n| format!("points    {} {what}\n", grouped(n))).unwrap_or_default();
    }
    let inputs = store.inputs(job.id).await?;
    let inputs: Vec<String> =
        inputs.iter().map(|input| format!("{}  {}", input.path.display(), Size(input.size))).collect();
    text += &section("inputs", &inputs, MAX_SHOWN);
    text += &section("warnings", &facts.warnings, MAX_SHOWN);
    if let Some(result) = &job.result {
        let json = serde_json::to_string_pretty(result).unwrap_or_default();
        let lines: Vec<String> = json.lines().map(str::to_string).collect();
        text += &section("result", &lines, MAX_RESULT);
    }
    let now = Clock::System.now();
    let history = store.history(job.id).await?;
    let history: Vec<String> = history
        .iter()
        .map(|line| {
            let ago = time::duration((now - line.at).max(0) as f64 / 1000.0);
            format!(
                "{}  {ago} ago  {}  {}",
                line.at_iso,
                line.kind,
                line.detail.as_deref().unwrap_or_default()
            )
        })
        .collect();
    text += &section("history, the latest first", &history, MAX_SHOWN);
    Ok(text)
}

/// Lines under a title; of many, how many more there are.
fn section(title: &str, lines: &[String], most: usize) -> String {
    if lines.is_empty() {
        return String::new();
    }
    let mut text = format!("\n{title}\n");
    for line in lines.iter().take(most) {
        text += &format!("  {}\n", Plain(line.trim_end()));
    }
    if let Some(more @ 1..) = lines.len().checked_sub(most) {
        text += &format!("  … and {more} more; `--json` shows all that is kept\n");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_empty_queue_is_a_head_without_rows() {
        assert_eq!(table(&[]), "#  NAME  STATE  POINTS  SIZE  TRIES  CREATED  TOOK  WHY\n");
    }

    #[test]
    fn what_is_left_out_is_said() {
        let lines: Vec<String> = (0..25).map(|i| format!("line {i}")).collect();
        let text = section("inputs", &lines, 20);
        assert!(text.contains("line 19\n  … and 5 more;") && !text.contains("line 20"), "{text}");
        assert_eq!(section("inputs", &[], 20), "");
        assert_eq!(rest(50, 1234), "\nthe youngest 50 of 1234 jobs; `--limit 1234` shows all\n");
        assert_eq!((rest(50, 50), rest(0, 0)), (String::new(), String::new()));
    }
}
