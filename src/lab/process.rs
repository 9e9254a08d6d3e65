//! One run of a command as a process of its own: wall time, processor time and
//! peak memory, without anything of the benchmark's own in them.

use std::fs;
use std::io;
use std::process::{Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use rustix::process::{Pid, WaitId, WaitIdOptions, waitid};

use crate::convert::context::Cancel;
use crate::platform::limits;

/// What a run took.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ProcessRun {
    /// Seconds from start to end.
    pub wall: f64,
    /// Seconds of processor, user and system, all threads.
    pub cpu: f64,
    /// Most memory resident at once, bytes.
    pub peak: u64,
}

/// How often the peak is looked at: what is allocated in the last moments of a
/// process can be missed by as much.
const LOOK: Duration = Duration::from_millis(4);

/// Of a second, in /proc: USER_HZ, which Linux fixes at 100 whatever the
/// kernel's own clock.
const TICKS: f64 = 100.0;

/// How a command ended, and what it took until then.
#[derive(Debug, Clone, Copy)]
pub struct ProcessEnd {
    pub run: ProcessRun,
    pub status: ExitStatus,
    /// Whether it was killed because its time was up.
    pub late: bool,
}

/// Runs a command to its end; one that fails is an error.
pub fn run(command: &mut Command) -> io::Result<ProcessRun> {
    run_until(command, &Cancel::default())
}

/// The same, unless it is called off before.
pub fn run_until(command: &mut Command, cancel: &Cancel) -> io::Result<ProcessRun> {
    let ended = run_within(command.stdout(Stdio::null()), Duration::MAX, cancel)?;
    if !ended.status.success() {
        return Err(io::Error::other(format!("{command:?} ended with {}", ended.status)));
    }
    Ok(ended.run)
}

/// Runs a command to its end, whatever that is, or until its time is up. Called
/// off, it is killed, and that is an error.
pub fn run_within(command: &mut Command, limit: Duration, cancel: &Cancel) -> io::Result<ProcessEnd> {
    let start = Instant::now();
    let mut child = command.stdin(Stdio::null()).spawn()?;
    let id = Pid::from_child(&child);
    let (mut peak, mut late) = (0, false);
    // Left as a zombie (NOWAIT), so that its times can still be read.
    let options = WaitIdOptions::EXITED | WaitIdOptions::NOHANG | WaitIdOptions::NOWAIT;
    while waitid(WaitId::Pid(id), options)?.is_none() {
        peak = limits::peak_memory_of(child.id()).unwrap_or(0).max(peak);
        if start.elapsed() > limit && !late {
            late = true;
            child.kill()?;
        }
        if cancel.is_cancelled() {
            child.kill()?;
            child.wait()?;
            return Err(io::ErrorKind::Interrupted.into());
        }
        std::thread::sleep(LOOK);
    }
    let wall = start.elapsed().as_secs_f64();
    let cpu = processor_time(child.id())?;
    let status = child.wait()?;
    Ok(ProcessEnd { run: ProcessRun { wall, cpu, peak }, status, late })
}

/// User and system seconds (fields 14 and 15 of proc(5)'s stat), in steps of a
/// hundredth.
fn processor_time(id: u32) -> io::Result<f64> {
    let stat = fs::read_to_string(format!("/proc/{id}/stat"))?;
    // The name in parentheses may hold anything, spaces too.
    let fields: Vec<&str> = stat.rsplit(')').next().unwrap_or("").split_whitespace().collect();
    let ticks = |field: usize| fields.get(field - 3).and_then(|text| text.parse::<u64>().ok());
    match (ticks(14), ticks(15)) {
        (Some(user), Some(system)) => Ok((user + system) as f64 / TICKS),
        _ => Err(io::Error::other(format!("cannot make sense of /proc/{id}/stat"))),
    }
}

/// The middle of some numbers, and the least and the most.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Spread {
    pub median: f64,
    pub min: f64,
    pub max: f64,
}

pub fn spread(numbers: impl Iterator<Item = f64>) -> Spread {
    let mut numbers: Vec<f64> = numbers.collect();
    numbers.sort_by(f64::total_cmp);
    let at = |index: usize| numbers.get(index).copied().unwrap_or(f64::NAN);
    let middle = numbers.len() / 2;
    let median =
        if numbers.len() % 2 == 1 { at(middle) } else { (at(middle.wrapping_sub(1)) + at(middle)) / 2.0 };
    Spread { median, min: at(0), max: at(numbers.len().wrapping_sub(1)) }
}
