//! What the machine or the container grants: threads by affinity and quota,
//! memory by the cgroup's limit. Never the host's figures where a container has
//! smaller ones.

use std::fmt::Display;
use std::fs;
use std::path::{Path, PathBuf};

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

fn cgroup_limit() -> Option<u64> {
    let own = fs::read_to_string("/proc/self/cgroup").ok()?;
    smallest_limit(Path::new("/sys/fs/cgroup"), &own)
}

/// The smallest memory limit on the way from a process's cgroups (as /proc tells
/// them) up to the root, of version 2 or 1. In a container the way may begin above
/// what can be seen; then the topmost folder is the container's own.
fn smallest_limit(mounts: &Path, own: &str) -> Option<u64> {
    let limits = own.lines().filter_map(|line| {
        let (controllers, path) = line.split_once(':')?.1.split_once(':')?;
        let (mount, file) = match controllers {
            "" => (mounts.to_path_buf(), "memory.max"),
            of if of.split(',').any(|of| of == "memory") => (mounts.join("memory"), "memory.limit_in_bytes"),
            _ => return None,
        };
        let groups = Path::new(path.trim_start_matches('/')).ancestors().map(|group| mount.join(group));
        let read = |group: PathBuf| fs::read_to_string(group.join(file)).ok()?.trim().parse::<u64>().ok();
        groups.filter_map(read).min()
    });
    limits.min()
}

#[cfg(test)]
mod tests {
    use std::fs;

    #[test]
    fn there_is_something_to_work_with() {
        assert!(super::threads() >= 1);
        assert!(super::memory() > 64 << 20);
        assert!(super::default_memory_limit() <= super::memory().max(256 << 20));
    }

    /// The folders of a machine that has both versions, as Slurm and older systems do.
    #[test]
    fn limits_hold_wherever_they_stand_above_a_process() {
        let mounts = tempfile::tempdir().unwrap();
        let set = |group: &str, file: &str, limit: &str| {
            let group = mounts.path().join(group);
            fs::create_dir_all(&group).unwrap();
            fs::write(group.join(file), limit).unwrap();
        };
        let limit = |own: &str| super::smallest_limit(mounts.path(), own);
        assert_eq!(limit("0::/\n"), None);
        set("memory", "memory.limit_in_bytes", "9223372036854771712\n");
        set("memory/job", "memory.limit_in_bytes", "800\n");
        set("memory/job/step", "memory.limit_in_bytes", "9223372036854771712\n");
        set("user/one", "memory.max", "max\n");
        set("user", "memory.max", "700\n");
        assert_eq!(limit("9:cpu:/job\n4:memory:/job/step\n0::/\n"), Some(800));
        assert_eq!(limit("4:hugetlb,memory:/job\n0::/\n"), Some(800));
        assert_eq!(limit("4:memory:/other\n"), Some(9223372036854771712));
        assert_eq!(limit("0::/user/one\n"), Some(700));
        assert_eq!(limit("4:memory:/job/step\n0::/user/one\n"), Some(700));
        // Of a container, of which the host tells the whole way.
        set("", "memory.max", "500\n");
        assert_eq!(limit("0::/docker/abc\n"), Some(500));
        assert_eq!(limit("0::/../x\nnonsense\n"), Some(500));
    }
}
