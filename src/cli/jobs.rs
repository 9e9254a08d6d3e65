//! `lodestone jobs`: the queue on the command line. It reads and writes the
//! queue's file itself, so it works with and without a running daemon; a running
//! one notices an order within a second.

use std::io::Write;
use std::path::{Path, PathBuf};

use super::{Exit, failed};
use crate::clock::Clock;
use crate::config::Layer;
use crate::config::age::Age;
use crate::config::size::Size;
use crate::job::{Event, Job, JobId, State};
use crate::store::{Store, StoreError};

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
        /// At most so many
        #[arg(long, default_value_t = 50, value_parser = clap::value_parser!(i64).range(1..=100_000))]
        limit: i64,
    },
    /// All that is known of a job
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
            failed(&error);
            return Exit::Usage;
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
        Ok(text) => {
            // A reader that has seen enough, as `head`, is no failure.
            let _ = std::io::stdout().write_all(text.as_bytes());
            Exit::Done
        }
        Err(error) => failed(&error),
    }
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
            return Ok(if arguments.json { json(&jobs) } else { table(&jobs) });
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
    match (&arguments.action, arguments.json) {
        (_, true) => Ok(json(&job)),
        (Action::Show { .. }, false) => show(store, &job).await,
        (_, false) => Ok(table(&[job])),
    }
}

fn json(value: &impl serde::Serialize) -> String {
    // Jobs are plain values; there is nothing that JSON could not hold.
    serde_json::to_string_pretty(value).unwrap_or_default() + "\n"
}

fn table(jobs: &[Job]) -> String {
    let head = ["#", "NAME", "STATE", "POINTS", "SIZE", "TRIES", "WHY"].map(String::from);
    let rows: Vec<[String; 7]> = std::iter::once(head).chain(jobs.iter().map(row)).collect();
    let width = |column: usize| rows.iter().map(|row| row[column].chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = (0..6).map(width).collect();
    let mut text = String::new();
    for row in &rows {
        for (cell, width) in row.iter().zip(&widths) {
            text += cell;
            text += &" ".repeat(width - cell.chars().count() + 2);
        }
        text += &row[6];
        text.truncate(text.trim_end().len());
        text.push('\n');
    }
    text
}

fn row(job: &Job) -> [String; 7] {
    let state = match job.wish {
        Some(wish) => format!("{} ({} asked)", job.state.name(), wish.name()),
        None => job.state.name().to_string(),
    };
    let why = job.hold.as_deref().or(job.error.as_deref()).unwrap_or("").to_string();
    let (points, size) = (super::grouped(job.points), Size(job.bytes).to_string());
    [job.id.to_string(), job.name.clone(), state, points, size, job.attempts.to_string(), why]
}

async fn show(store: &Store, job: &Job) -> Result<String, StoreError> {
    let mut text = table(std::slice::from_ref(job));
    text += &format!("\nsource    {}\nrevision  {}\n", job.source.display(), job.revision);
    if let Some(by) = job.superseded_by {
        text += &format!("replaced  by job {by}\n");
    }
    // The queue of a daemon that is older than this program knows of none.
    if let Some(preview) = store.previews(&[job.id]).await.unwrap_or_default().get(&job.id) {
        let why = preview.error.as_deref().map(|error| format!(", {error}")).unwrap_or_default();
        text += &format!("preview   {}{why}\n", preview.state.name());
    }
    text += "\ninputs\n";
    for input in store.inputs(job.id).await? {
        text += &format!("  {}  {}\n", input.path.display(), Size(input.size));
    }
    if let Some(result) = &job.result {
        text += &format!("\nresult\n{}\n", serde_json::to_string_pretty(result).unwrap_or_default());
    }
    text += "\nhistory, the latest first\n";
    let now = Clock::System.now();
    for line in store.history(job.id).await? {
        let ago = (now - line.at).max(0) / 1000;
        text += &format!("  {ago:>9} s ago  {}  {}\n", line.kind, line.detail.unwrap_or_default());
    }
    Ok(text)
}

#[cfg(test)]
mod tests {
    #[test]
    fn an_empty_queue_is_a_head_without_rows() {
        assert_eq!(super::table(&[]), "#  NAME  STATE  POINTS  SIZE  TRIES  WHY\n");
    }
}
