//! Real file systems that are small, and can be filled to the brim or made
//! read-only. They are mounted in a namespace of the test's own, so that nothing
//! of them is left when it ends, however it ends.

use std::fs::{self, File};
use std::io::Write;
use std::path::Path;
use std::process::Command;

const INSIDE: &str = "LODESTONE_INSIDE_NAMESPACE";
/// Set where a test that cannot run is a failure.
const INSISTS: &str = "LODESTONE_SMALL_DISKS";

/// Runs the test of this full name again, where it may mount. True for the one that is
/// to do the work; the one outside has nothing left to do.
pub fn inside(test: &str) -> bool {
    if std::env::var_os(INSIDE).is_some() {
        return true;
    }
    let unshare = || {
        let mut command = Command::new("unshare");
        command.args(["--mount", "--map-root-user"]);
        command
    };
    let probe = unshare().args(["mount", "-t", "tmpfs", "tmpfs", "/mnt"]).output();
    if !probe.is_ok_and(|probe| probe.status.success()) {
        assert!(
            std::env::var_os(INSISTS).is_none(),
            "no file system can be mounted here, by root or otherwise"
        );
        eprintln!("no file system can be mounted here: not run");
        return false;
    }
    let program = std::env::current_exe().expect("this program");
    let run = unshare().arg(program).args(["--exact", test, "--nocapture"]).env(INSIDE, "1").output();
    let run = run.expect("run");
    let text = [run.stdout, run.stderr].concat();
    let text = String::from_utf8_lossy(&text);
    assert!(run.status.success() && text.contains("1 passed"), "{text}");
    false
}

fn mount(arguments: &[&str], folder: &Path) {
    let run = Command::new("mount").args(arguments).arg(folder).output().expect("run");
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
}

/// Mounts an empty file system of this size on a folder, which is made.
pub fn mount_small(folder: &Path, size: &str) {
    fs::create_dir_all(folder).expect("made");
    mount(&["-t", "tmpfs", "-o", &format!("size={size}"), "tmpfs"], folder);
}

pub fn remount(folder: &Path, how: &str) {
    mount(&["-o", &format!("remount,{how}")], folder);
}

/// Fills the file system to the brim; removing the file makes room again.
pub fn fill(folder: &Path) -> std::path::PathBuf {
    let path = folder.join("ballast");
    let mut file = File::create(&path).expect("created");
    for size in [1 << 20, 4096, 1] {
        let block = vec![1u8; size];
        while file.write_all(&block).is_ok() {}
    }
    path
}
