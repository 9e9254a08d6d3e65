//! What the benchmark prints.

use lodestone::lab::process::{Spread, spread};

use super::Method;

/// The floor that everything can be told as a multiple of.
pub const DECODE: &str = "floor: decode the LAZ, all cores";

fn cpu(method: &Method) -> Spread {
    spread(method.runs.iter().map(|run| run.cpu))
}

fn decode(methods: &[Method]) -> f64 {
    methods.iter().find(|method| method.name == DECODE).map_or(f64::NAN, |method| cpu(method).median)
}

/// Every method with its time, processor time, memory, and multiples of floors.
pub fn methods(methods: &[Method], millions: f64) {
    println!("| | s | M points/s | CPU-s/M points | peak MB | × floor | × D |");
    println!("|---|---:|---:|---:|---:|---:|---:|");
    for method in methods {
        let wall = spread(method.runs.iter().map(|run| run.wall));
        let own = cpu(method);
        let peak = method.runs.iter().map(|run| run.peak).max().unwrap_or(0);
        let times = method.octree.as_ref().map_or(String::from("|"), |(_, floors)| {
            let floor: f64 = floors.iter().map(|&index| cpu(&methods[index]).median).sum();
            format!("{:.1} | {:.2}", own.median / floor, own.median / decode(methods))
        });
        println!(
            "| {} | {:.2} ({:.2}–{:.2}) | {:.2} | {:.3} ({:.3}–{:.3}) | {:.0} | {times} |",
            method.name,
            wall.median,
            wall.min,
            wall.max,
            millions / wall.median,
            own.median / millions,
            own.min / millions,
            own.max / millions,
            peak as f64 / 1e6,
        );
    }
}

/// The stages in the order in which they happen.
const STAGES: [&str; 5] = ["survey", "distribute", "index", "merge", "publish"];

/// Seconds of each stage of each conversion, and the share of the threads' time
/// in which they were busy.
pub fn stages(methods: &[Method], threads: usize) {
    println!("\n| s | {} | busy |", STAGES.join(" | "));
    println!("|---|{}---:|", "---:|".repeat(STAGES.len()));
    for method in methods.iter().filter(|method| method.octree.is_some()) {
        let seconds =
            |stage: &str| spread(method.stages.iter().filter_map(|run| run.get(stage)).copied()).median;
        let each: Vec<String> = STAGES.iter().map(|stage| format!("{:.2}", seconds(stage))).collect();
        let busy = spread(method.runs.iter().map(|run| run.cpu / run.wall / threads as f64)).median;
        println!("| {} | {} | {:.0} % |", method.name, each.join(" | "), 100.0 * busy);
    }
}

/// What a point of one cloud costs.
pub struct Cost {
    title: String,
    /// Method and CPU-seconds a million points.
    methods: Vec<(String, f64)>,
    /// Most memory of any conversion.
    peak: u64,
}

pub fn cost(title: &str, methods: &[Method], millions: f64) -> Cost {
    let conversions = || methods.iter().filter(|method| method.octree.is_some());
    Cost {
        title: title.to_string(),
        methods: conversions().map(|m| (m.name.clone(), cpu(m).median / millions)).collect(),
        peak: conversions().flat_map(|m| &m.runs).map(|run| run.peak).max().unwrap_or(0),
    }
}

/// What a point costs in each cloud, and as a multiple of the first one.
pub fn costs(costs: &[Cost]) {
    let [first, _, ..] = costs else { return };
    let names: Vec<&str> = first.methods.iter().map(|(name, _)| name.as_str()).collect();
    println!("\n| CPU-s/M points (× {}) | {} | peak MB |", first.title, names.join(" | "));
    println!("|---|{}---:|", "---:|".repeat(names.len()));
    for cost in costs {
        let cells: Vec<String> = cost
            .methods
            .iter()
            .zip(&first.methods)
            .map(|((_, own), (_, base))| format!("{own:.3} ({:.2})", own / base))
            .collect();
        println!("| {} | {} | {:.0} |", cost.title, cells.join(" | "), cost.peak as f64 / 1e6);
    }
}
