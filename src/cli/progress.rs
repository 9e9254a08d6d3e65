//! Progress for people (a bar, or plain lines) and for machines (JSON lines),
//! on stderr.

use std::io::IsTerminal;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde_json::json;

use super::output;
use crate::convert::context::{Progress, Snapshot, Stage};
use crate::convert::run::{ConductError, ConversionOutcome};

#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum ProgressFormat {
    /// A bar on a terminal, nothing elsewhere
    Auto,
    Bar,
    /// A line whenever a tenth of a stage is done
    Plain,
    /// One JSON object a line
    Json,
    None,
}

/// How often the figures are looked at.
const TICK: Duration = Duration::from_millis(100);

/// Runs `work` while its progress is shown.
pub fn shown<T>(style: ProgressFormat, progress: &Progress, work: impl FnOnce() -> T) -> T {
    let style = match style {
        ProgressFormat::Auto if std::io::stderr().is_terminal() => ProgressFormat::Bar,
        ProgressFormat::Auto => ProgressFormat::None,
        style => style,
    };
    if style == ProgressFormat::None {
        return work();
    }
    let done = AtomicBool::new(false);
    std::thread::scope(|scope| {
        let watcher = scope.spawn(|| {
            let mut display = Display::new(style);
            while !done.load(Ordering::Relaxed) {
                display.show(progress.snapshot());
                std::thread::park_timeout(TICK);
            }
            display.clear();
        });
        let stop = StopOnDrop { done: &done, watcher: watcher.thread() };
        let result = work();
        drop(stop);
        result
    })
}

/// Lets the watcher go also when the work panics; the scope would wait for ever.
struct StopOnDrop<'a> {
    done: &'a AtomicBool,
    watcher: &'a std::thread::Thread,
}

impl Drop for StopOnDrop<'_> {
    fn drop(&mut self) {
        self.done.store(true, Ordering::Relaxed);
        self.watcher.unpark();
    }
}

struct Display {
    style: ProgressFormat,
    bar: Option<ProgressBar>,
    stage: Stage,
    stage_started: Instant,
    tenth: u64,
}

impl Display {
    fn new(style: ProgressFormat) -> Display {
        let bar = (style == ProgressFormat::Bar).then(|| {
            let bar = ProgressBar::with_draw_target(Some(0), ProgressDrawTarget::stderr());
            let template = "{prefix:>10} {bar:40} {percent:>3} %  {msg}";
            if let Ok(style) = ProgressStyle::with_template(template) {
                bar.set_style(style.progress_chars("━╸─"));
            }
            output::keep_clear_of(Some(bar.clone()));
            bar
        });
        Display { style, bar, stage: Stage::Queued, stage_started: Instant::now(), tenth: u64::MAX }
    }

    fn show(&mut self, now: Snapshot) {
        if now.stage != self.stage {
            (self.stage, self.stage_started, self.tenth) = (now.stage, Instant::now(), u64::MAX);
        }
        let seconds = self.stage_started.elapsed().as_secs_f64();
        let rate = now.done as f64 / seconds.max(1e-3);
        let left = if now.done > 0 { Some((now.total - now.done) as f64 / rate) } else { None };
        match (&self.bar, self.style) {
            (Some(bar), _) => {
                bar.set_prefix(now.stage.name());
                bar.set_length(now.total.max(1));
                bar.set_position(now.done);
                let left = left.map_or(String::new(), |s| format!(", {s:.0} s left in this stage"));
                bar.set_message(format!("{:.2} M points/s{left}", rate / 1e6));
            }
            (None, ProgressFormat::Plain) => self.line(now, rate),
            (None, _) => {
                let percent = 100.0 * now.done as f64 / now.total.max(1) as f64;
                let line = json!({
                    "event": "progress",
                    "stage": now.stage.name(),
                    "percent": (percent * 10.0).round() / 10.0,
                    "points": now.done,
                    "points_total": now.total,
                    "points_per_second": rate.round(),
                    "seconds_left": left.map(|s| (s * 10.0).round() / 10.0),
                });
                output::tell(format_args!("{line}"));
            }
        }
    }

    fn line(&mut self, now: Snapshot, rate: f64) {
        let tenth = now.done * 10 / now.total.max(1);
        if tenth != self.tenth && now.stage != Stage::Queued {
            self.tenth = tenth;
            output::tell(format_args!(
                "{:>10} {:>3} %  {:.2} M points/s",
                now.stage.name(),
                tenth * 10,
                rate / 1e6
            ));
        }
    }

    fn clear(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
            output::keep_clear_of(None);
        }
    }
}

/// The last line for machines.
pub fn finished(style: ProgressFormat, outcome: &ConversionOutcome) {
    if style == ProgressFormat::Json {
        output::tell(format_args!("{}", json!({ "event": "done", "outcome": outcome })));
    }
}

pub fn failed(style: ProgressFormat, error: &ConductError) {
    if style == ProgressFormat::Json {
        let line = json!({
            "event": "failed",
            "error": error.to_string(),
            "retry_can_help": error.retry_can_help(),
        });
        output::tell(format_args!("{line}"));
    }
}
