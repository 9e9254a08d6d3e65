//! The table for people: lines of a terminal and a page of Markdown.

use std::fmt::Write;

use super::StabilityTable;
use super::row::{MOST_LEVELS, MOST_MEMORY, MOST_TIME, Row};
use crate::words::grouped;

/// A row as a line of a terminal.
pub fn plain(row: &Row) -> String {
    let sampling = row.sampling.name();
    format!(
        "{:26} {:>11} {sampling:8} {:7.2} s {:5.2} × {:5.2} × cpu {:6.0} MB {:5.2} ×  depth {:2} of {:2}  {}  {}",
        row.scene,
        grouped(row.points),
        row.seconds,
        row.seconds_times,
        row.cpu_times,
        row.peak_bytes as f64 / 1e6,
        row.peak_times,
        row.depth,
        row.depth_asked,
        if row.exact { "exact" } else { row.outcome.as_str() },
        row.missed.join(", "),
    )
}

/// What stands above the table.
const HEAD: &str = "# Stability

What became of every scene that is known to break converters, and what it cost as
a multiple of `terrain` with as many points: `lodestone report --stability`. The
two are converted in turns, each time as a process of its own, and the medians are
compared. \"Asked\" is the level at which no cell of the cloud, without its outliers,
holds more than 10 000 different positions.

";

/// The page with the whole table.
pub fn markdown(table: &StabilityTable) -> String {
    let mut page = String::from(HEAD);
    page.push_str(
        "| scene | points | sampler | outcome | s | × terrain | CPU-s | × terrain | peak MB | × terrain | depth | asked | nodes | largest node | set aside | misses |\n\
         |---|---:|---|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---|---|\n",
    );
    for row in &table.rows {
        let aside: Vec<String> =
            row.set_aside.iter().map(|(reason, points)| format!("{} {reason}s", grouped(*points))).collect();
        let outcome = if row.exact { "exact" } else { row.outcome.as_str() };
        let sampling = row.sampling.name();
        // Writing to a string does not fail.
        let _ = writeln!(
            page,
            "| {} | {} | {sampling} | {outcome} | {:.2} | {:.2} | {:.2} | {:.2} | {:.0} | {:.2} | {} | {} | {} | {} | {} | {} |",
            row.scene,
            grouped(row.points),
            row.seconds,
            row.seconds_times,
            row.cpu_seconds,
            row.cpu_times,
            row.peak_bytes as f64 / 1e6,
            row.peak_times,
            row.depth,
            row.depth_asked,
            grouped(row.nodes),
            grouped(u64::from(row.largest_node)),
            aside.join(", "),
            row.missed.join(", "),
        );
    }
    let missed = table.rows.iter().filter(|row| !row.missed.is_empty()).count();
    let _ = write!(
        page,
        "\nlodestone {}, {} threads, medians of {}. Targets: exact, time (wall and processor) at most {MOST_TIME} × \
         and peak memory at most {MOST_MEMORY} × those of terrain with as many points, depth at most what \
         the cloud asks for and {MOST_LEVELS}. {missed} of {} rows miss one.\n",
        table.version,
        table.threads,
        table.rounds,
        table.rows.len()
    );
    page
}
