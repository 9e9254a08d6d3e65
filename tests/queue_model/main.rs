//! Histories by chance over the real queue, engine and watcher: files are
//! dropped, replaced, renamed, deleted; mounts vanish; clocks jump; disks fill;
//! conversions fail, panic and hang; operators give orders; and the daemon dies in
//! the middle of it. After each step the laws of the queue are held against what
//! is there ([`laws`]).
//!
//! `LODESTONE_HISTORIES=5000` tries that many instead of a few hundred, and
//! `LODESTONE_HISTORIES=1000..2000` those of these seeds; `LODESTONE_HISTORY=<seed>`
//! one of them, step by step.

#[path = "../daemon_support/mod.rs"]
mod daemon_support;
#[path = "../engine_support/mod.rs"]
mod engine_support;

mod content;
mod desk;
mod dice;
mod laws;
mod steps;
mod world;

use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

use dice::Dice;
use world::World;

/// A law that does not hold, in words.
pub type Broken = String;

/// One history: so many steps, then the faults stop and all must end well.
fn history(seed: u64, steps: usize, trace: &mut Vec<String>) -> Result<(), Broken> {
    let mut world = World::new(seed);
    let mut dice = Dice::new(seed);
    for number in 0..steps {
        let step = steps::step(&mut world, &mut dice).and_then(|step| {
            trace.push(format!("{number:3} {step}"));
            laws::hold(&mut world)
        });
        step.map_err(|broken| format!("after step {number}: {broken}"))?;
    }
    steps::calm_down(&mut world)?;
    laws::hold_in_the_end(&mut world).map_err(|broken| format!("in the end: {broken}"))
}

/// How long the history of this seed is.
fn length(seed: u64) -> usize {
    20 + Dice::new(!seed).below(50)
}

/// The shortest beginning of the history that still breaks a law, in words.
fn shortest(seed: u64) -> String {
    for steps in 0..=length(seed) {
        let mut trace = vec![];
        if let Err(broken) = history(seed, steps, &mut trace) {
            return format!("{steps} steps of seed {seed} break a law\n{}\n{broken}", trace.join("\n"));
        }
    }
    format!("seed {seed} broke a law once, but not again")
}

#[test]
fn no_history_breaks_a_law() {
    let variable = |name: &str| std::env::var(name).ok();
    quiet_panics();
    if let Some(seed) = variable("LODESTONE_HISTORY") {
        let seed = seed.parse().expect("a number");
        let mut trace = vec![];
        let result = history(seed, length(seed), &mut trace);
        eprintln!("{}", trace.join("\n"));
        result.expect("the laws hold");
        return;
    }
    let seeds = variable("LODESTONE_HISTORIES").map_or(0..200, |text| seeds(&text));
    let (next, start) = (AtomicU64::new(seeds.start), Instant::now());
    let broken = std::thread::scope(|scope| {
        let work = || {
            loop {
                let seed = next.fetch_add(1, Ordering::SeqCst);
                if seed >= seeds.end {
                    return None;
                }
                if let Err(broken) = history(seed, length(seed), &mut vec![]) {
                    next.store(seeds.end, Ordering::SeqCst);
                    return Some(format!("{broken}\n{}", shortest(seed)));
                }
            }
        };
        let threads = std::thread::available_parallelism().map_or(2, |n| n.get());
        let workers: Vec<_> = (0..threads).map(|_| scope.spawn(work)).collect();
        workers
            .into_iter()
            .filter_map(|worker| worker.join().expect("no panic of the model"))
            .collect::<Vec<_>>()
    });
    assert!(broken.is_empty(), "{}", broken.join("\n\n"));
    eprintln!("{} histories in {:.1} s", seeds.count(), start.elapsed().as_secs_f64());
}

/// `5000`, or `1000..2000`.
fn seeds(text: &str) -> Range<u64> {
    let number = |text: &str| text.parse().expect("a number");
    match text.split_once("..") {
        Some((start, end)) => number(start)..number(end),
        None => 0..number(text),
    }
}

/// Conversions panic on purpose; that need not fill the screen.
fn quiet_panics() {
    let before = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        let thread = std::thread::current();
        let is_ours = |name: &str| name.starts_with("job-") || name.starts_with("preview-");
        if !thread.name().is_some_and(is_ours) {
            before(panic);
        }
    }));
}
