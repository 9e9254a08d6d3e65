//! What the machine or the container grants: threads by affinity and quota,
//! memory by the cgroup's limit. Never the host's figures where a container has
//! smaller ones.

use std::fmt::Display;
use std::fs;

/// Threads that may run at once (affinity and cgroup quota).
pub fn threads() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// A quarter of the memory there is, but at least 256 MiB.
pub fn default_memory_limit() -> u64 {
    (memory() / 4).max(256 << 20)
}

/// Bytes of memory of the machine or the cgroup, whichever is less.
pub fn memory() -> u64 {
    let info = rustix::system::sysinfo();
    let machine = (info.totalram as u64).saturating_mul(u64::from(info.mem_unit.max(1)));
    cgroup_limit().map_or(machine, |limit| limit.min(machine))
}

/// Has [`peak_memory`] begin anew at what is resident now. Linux alone knows how
/// (proc(5), clear_refs); elsewhere, or where that is forbidden, it stays what it
/// was.
pub fn forget_peak_memory() {
    let _ = fs::write("/proc/self/clear_refs", "5");
}

/// The most memory that this process has had resident at once, in bytes.
pub fn peak_memory() -> Option<u64> {
    peak_memory_of("self")
}

/// The same of another process, by its number; none where it has ended.
pub fn peak_memory_of(process: impl Display) -> Option<u64> {
    let status = fs::read_to_string(format!("/proc/{process}/status")).ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok().map(|kibibytes| kibibytes * 1024)
}

/// The smallest limit on the way from this process's cgroup (v2) to the root,
/// or that of v1.
fn cgroup_limit() -> Option<u64> {
    let read = |path: &str| fs::read_to_string(path).ok()?.trim().parse::<u64>().ok();
    let own = fs::read_to_string("/proc/self/cgroup").ok()?;
    let mut limits =
        vec![read("/sys/fs/cgroup/memory.max"), read("/sys/fs/cgroup/memory/memory.limit_in_bytes")];
    if let Some(path) = own.lines().find_map(|l| l.strip_prefix("0::")) {
        let mut path = path.trim_matches('/');
        while !path.is_empty() {
            limits.push(read(&format!("/sys/fs/cgroup/{path}/memory.max")));
            path = path.rsplit_once('/').map_or("", |(up, _)| up);
        }
    }
    limits.into_iter().flatten().min()
}

#[cfg(test)]
mod tests {
    #[test]
    fn there_is_something_to_work_with() {
        assert!(super::threads() >= 1);
        assert!(super::memory() > 64 << 20);
        assert!(super::default_memory_limit() <= super::memory().max(256 << 20));
    }
}
