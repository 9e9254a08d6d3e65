//! What the queue itself can do, on this machine's disk: jobs taken in, and jobs
//! claimed and completed, a second, one after the other as the daemon does it, each
//! step made last before the next. Beside it what one fsync takes, of which each
//! step needs at least one.
//!
//! `cargo bench --bench queue -- [--jobs N] [--folder DIR]`

use std::error::Error;
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

use lodestone::serve::job::QueuedFile;
use lodestone::serve::job::retry_policy::{AttemptEnd, Policy};
use lodestone::serve::queue::{AttemptResult, DataSetKind, NewDataSet, Store};

fn main() -> Result<(), Box<dyn Error>> {
    let mut jobs = 2000;
    let mut folder = std::env::temp_dir();
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--jobs" => jobs = arguments.next().ok_or("--jobs needs a number")?.parse()?,
            "--folder" => folder = arguments.next().ok_or("--folder needs a path")?.into(),
            // What cargo itself hands over.
            "--bench" => {}
            other => return Err(format!("{other} is not known").into()),
        }
    }
    let folder = tempfile::tempdir_in(folder)?;
    println!("| step | a second | ms each, median (p99) |\n|---|---:|---:|");
    row("fsync of a 4 KiB write", &fsyncs(folder.path(), 500)?);
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build()?;
    runtime.block_on(queue(folder.path(), jobs))
}

async fn queue(folder: &Path, jobs: i64) -> Result<(), Box<dyn Error>> {
    let store = Store::open(&folder.join("queue.db")).await?;
    let mut times = vec![];
    for number in 0..jobs {
        let arrival = arrival(number);
        let start = Instant::now();
        store.take_in(&arrival, number).await?;
        times.push(start.elapsed().as_secs_f64());
    }
    row("take a data set in", &times);
    times.clear();
    loop {
        let start = Instant::now();
        let Some(job) = store.ready(jobs, 0, 0..=u64::MAX, 16).await?.into_iter().next() else { break };
        let claimed = store.claim(job.id, "bench", jobs).await?;
        assert!(claimed.is_some(), "nobody else claims");
        assert!(store.stage(job.id, "bench", (1, None), "{}", jobs).await?, "the lease is ours");
        let ending = AttemptResult { end: AttemptEnd::Published, error: None };
        store.finish(job.id, "bench", &ending, &Policy::default(), jobs).await?;
        times.push(start.elapsed().as_secs_f64());
    }
    assert_eq!(times.len() as i64, jobs, "every job is done once");
    row("claim, stage and complete a job", &times);
    let bytes = std::fs::metadata(folder.join("queue.db"))?.len();
    store.close().await;
    println!("\n{jobs} jobs, {} bytes of database a job", bytes / jobs.max(1) as u64);
    Ok(())
}

fn arrival(number: i64) -> NewDataSet {
    let path = PathBuf::from(format!("/in/cloud {number}.laz"));
    let input = QueuedFile {
        path: path.clone(),
        size: 1 << 20,
        mtime_ns: number,
        hash: format!("{number:064x}"),
        inode: 0,
        ctime_ns: 0,
    };
    NewDataSet {
        path,
        kind: DataSetKind::File,
        name: format!("cloud {number}"),
        stamp: format!("{number:064x}"),
        content_key: format!("{number:064x}"),
        inputs: vec![input],
        options: "{}".into(),
        priority: 0,
        points: 100_000,
        doubt: None,
        refusal: None,
        octrees: PathBuf::from("/nowhere"),
    }
}

/// Seconds of each write that is made last.
fn fsyncs(folder: &Path, count: usize) -> std::io::Result<Vec<f64>> {
    let mut file = File::create(folder.join("fsync"))?;
    let mut times = Vec::with_capacity(count);
    for _ in 0..count {
        let start = Instant::now();
        file.write_all(&[7; 4096])?;
        file.sync_data()?;
        times.push(start.elapsed().as_secs_f64());
    }
    Ok(times)
}

fn row(name: &str, seconds: &[f64]) {
    let mut sorted = seconds.to_vec();
    sorted.sort_by(f64::total_cmp);
    let at = |part: f64| {
        sorted.get(((sorted.len() as f64 * part) as usize).min(sorted.len() - 1)).unwrap_or(&0.0) * 1e3
    };
    let rate = seconds.len() as f64 / seconds.iter().sum::<f64>();
    println!("| {name} | {rate:.0} | {:.2} ({:.2}) |", at(0.5), at(0.99));
}
