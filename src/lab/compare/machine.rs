//! Where: what a figure is worth nothing without.

use std::path::Path;
use std::process::{Command, Stdio};

use crate::platform::limits;

/// Processor, cores and memory, as far as the system tells.
pub fn words() -> String {
    let told = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = told.lines().find_map(|line| line.strip_prefix("model name")?.split_once(':'));
    let model = model.map_or("an unnamed processor", |(_, name)| name.trim());
    let memory = limits::memory() as f64 / f64::from(1 << 30);
    format!("{model}, {} cores, {memory:.0} GiB, {}", limits::threads(), std::env::consts::OS)
}

/// The commit of the checkout that the program lies in, with a `+` where files
/// were changed since.
pub fn commit(program: &Path) -> String {
    let Some(checkout) = program.ancestors().find(|folder| folder.join(".git").exists()) else {
        return String::new();
    };
    let git = |arguments: &[&str]| {
        let output =
            Command::new("git").arg("-C").arg(checkout).args(arguments).stderr(Stdio::null()).output();
        output.ok().filter(|output| output.status.success()).map(|output| output.stdout)
    };
    let Some(id) = git(&["rev-parse", "--short=12", "HEAD"]) else { return String::new() };
    let changed =
        git(&["status", "--porcelain", "--untracked-files=no"]).is_some_and(|said| !said.is_empty());
    format!("{}{}", String::from_utf8_lossy(&id).trim(), if changed { "+" } else { "" })
}
