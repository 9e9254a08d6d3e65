//! The unit in a booted Debian, and the commands of the manual on it: installed, used,
//! backed up, upgraded, restored, moved, removed.

use std::fs;
use std::path::Path;
use std::process::Command;

use crate::daemon_support::{fill_folder, las};

const SERVICE: &str = "[Unit]\nDescription=The test\nAfter=multi-user.target\n\
    [Service]\nType=oneshot\nTimeoutStartSec=0\nExecStart=/bin/bash /src/booted.sh\n";

/// Needs root, systemd-nspawn, and a Debian in the folder that LODESTONE_BOOTED names, as of
/// `debootstrap --variant=minbase --include=systemd-sysv,dbus,sqlite3,curl bookworm DIR`.
#[test]
fn the_manual_holds_in_a_booted_debian() {
    let Some(debian) = std::env::var_os("LODESTONE_BOOTED") else {
        eprintln!("skipped: LODESTONE_BOOTED names no Debian to boot");
        return;
    };
    let root = tempfile::tempdir().expect("a folder");
    let (source, out) = (root.path().join("src"), root.path().join("out"));
    let ours = Path::new(env!("CARGO_MANIFEST_DIR"));
    let read = |path: &str| fs::read(ours.join(path)).unwrap_or_else(|e| panic!("{path}: {e}"));
    let shipped = ["deploy/lodestone.service", "deploy/lodestone.sysusers", "docs/manual.md"]
        .map(|path| (path, read(path)));
    fill_folder(&source, &shipped);
    fill_folder(&source, &[("booted.sh", read("tests/cases/served/booted.sh"))]);
    for (seed, name) in ["a", "b", "c", "d", "e", "f", "g"].iter().enumerate() {
        fill_folder(&source.join("clouds"), &[(&format!("{name}.las"), las(20_000, seed as u64))]);
    }
    fs::create_dir_all(&out).expect("made");
    fs::write(out.join("try.service"), SERVICE).expect("written");
    let bind = |from: &Path, to: &str| format!("--bind={}:{to}", from.display());
    let run = Command::new("systemd-nspawn")
        .args(["--boot", "--volatile=overlay", "--private-network", "--register=no", "--keep-unit"])
        .args(["--link-journal=no", "--console=pipe", "--directory"])
        .arg(debian)
        .arg(bind(&out, "/out"))
        .arg(bind(&source, "/src"))
        .arg(bind(Path::new(env!("CARGO_BIN_EXE_lodestone")), "/src/target/release/lodestone"))
        .arg(bind(&out.join("try.service"), "/etc/systemd/system/try.service"))
        .arg("systemd.wants=try.service")
        .output()
        .expect("systemd-nspawn");
    let told = fs::read_to_string(out.join("log")).unwrap_or_default();
    let said = String::from_utf8_lossy(&[run.stdout, run.stderr].concat()).into_owned();
    assert!(told.ends_with("0 wrong\n"), "{told}\n{said}");
}
