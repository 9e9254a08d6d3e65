//! Whatever lies in a watched folder: names, links, pipes and markers.

use std::fs;
use std::os::unix::ffi::OsStrExt;
use std::os::unix::fs::symlink;
use std::path::Path;

use rustix::fs::{CWD, FileType, Mode, mknodat};

use crate::daemon_support::{Daemon, las, wait_for};

fn pipe(path: &Path) {
    mknodat(CWD, path, FileType::Fifo, Mode::from_raw_mode(0o600), 0).expect("a pipe");
}

/// What waits, with the reasons.
fn waiting(daemon: &Daemon) -> String {
    daemon.json("/api/watch")["waiting"].to_string()
}

#[test]
fn markers_that_are_no_files_are_not_read() {
    let root = tempfile::tempdir().unwrap();
    let secret = root.path().join("secret.json");
    fs::write(&secret, r#"{"name": "hunter2", "options": {"sampling": "TOPSECRET"}}"#).unwrap();
    let data = root.path().join("data");
    let inbox = data.join("inbox");
    let folder = |name: &str| {
        let folder = inbox.join(name);
        fs::create_dir_all(&folder).unwrap();
        fs::write(folder.join("tile.las"), las(500, 1)).unwrap();
        folder.join("lodestone.json")
    };
    symlink("/proc/self/pagemap", folder("endless")).unwrap();
    symlink("/proc/kmsg", folder("hanging")).unwrap();
    symlink("/dev/zero", folder("device")).unwrap();
    symlink(&secret, folder("leak")).unwrap();
    symlink("/etc/passwd", folder("passwords")).unwrap();
    symlink("lodestone.json", folder("circle")).unwrap();
    pipe(&folder("pipe"));
    fs::create_dir(folder("folder")).unwrap();
    fs::write(folder("long"), format!(r#"{{"name": "{}"}}"#, "x".repeat(70_000))).unwrap();
    fs::write(folder("marked"), r#"{"name": "good"}"#).unwrap();

    let daemon = Daemon::start(&data);
    daemon.wait("good", "done");
    let names = ["endless", "hanging", "device", "leak", "passwords", "circle", "pipe", "folder", "long"];
    let waits = wait_for("all reasons", || {
        let waits = waiting(&daemon);
        names.iter().all(|name| waits.contains(&format!("/{name}\""))).then_some(waits)
    });
    for word in ["hunter2", "TOPSECRET", "root:"] {
        assert!(!waits.contains(word) && !daemon.log().contains(word), "{word}");
    }
    assert_eq!(daemon.jobs().len(), 1);
    assert_eq!(daemon.get("/healthz").0, 200);
}

#[test]
fn a_source_swapped_for_a_link_is_not_published() {
    let root = tempfile::tempdir().unwrap();
    let secret = root.path().join("secret.las");
    fs::write(&secret, las(700, 9)).unwrap();
    let data = root.path().join("data");
    // Nothing starts before there is more room than any disk has.
    let mut daemon = Daemon::start_with(&data, &["--disk-reserve", "1000000G"]);
    let modified = std::time::UNIX_EPOCH + std::time::Duration::from_secs(1_700_000_000);
    let put = |path: &Path, seed| {
        fs::write(path, las(700, seed)).unwrap();
        fs::File::options().write(true).open(path).unwrap().set_modified(modified).unwrap();
    };
    put(&daemon.inbox().join("file.las"), 1);
    let tiles = root.path().join("tiles");
    fs::create_dir(&tiles).unwrap();
    put(&tiles.join("tile.las"), 2);
    fs::rename(&tiles, daemon.inbox().join("tiles")).unwrap();
    for name in ["file", "tiles"] {
        daemon.wait(name, "queued");
    }
    assert!(daemon.stop());
    // The same size and time: only following tells them apart.
    fs::File::options().write(true).open(&secret).unwrap().set_modified(modified).unwrap();
    fs::remove_file(data.join("inbox/file.las")).unwrap();
    symlink(&secret, data.join("inbox/file.las")).unwrap();
    let away = root.path().join("away");
    fs::create_dir(&away).unwrap();
    fs::rename(&secret, away.join("tile.las")).unwrap();
    symlink(away.join("tile.las"), &secret).unwrap();
    fs::remove_dir_all(data.join("inbox/tiles")).unwrap();
    symlink(&away, data.join("inbox/tiles")).unwrap();

    let daemon = Daemon::start(&data);
    fs::write(daemon.inbox().join("good.las"), las(500, 3)).unwrap();
    daemon.wait("good", "done");
    for name in ["file", "tiles"] {
        let job = daemon.jobs().into_iter().find(|job| job["name"] == name).expect("a job");
        assert_ne!(job["state"], "done", "{job}");
        assert!(!daemon.octree(name).exists());
    }
}

#[test]
fn names_become_octrees_that_are_served() {
    let root = tempfile::tempdir().unwrap();
    let daemon = Daemon::start(&root.path().join("data"));
    let wished =
        [" . .previews", ". .", ". .hid", ".staged", "..", "a/../../b", "\u{202e}gnp", "", "con\nsole"];
    for (n, name) in wished.iter().enumerate() {
        let marker = serde_json::json!({ "name": name }).to_string().into_bytes();
        let tile = las(400, n as u64 + 1);
        daemon.drop_folder(&format!("m{n}"), &[("t.las", tile), ("lodestone.json", marker)]);
    }
    for (n, name) in [" . .previews.las", " . ..las", "<img src=x>.las"].iter().enumerate() {
        fs::write(daemon.inbox().join(name), las(400, n as u64 + 50)).unwrap();
    }
    let bad = std::ffi::OsStr::from_bytes(b"bad\xff\xfeutf.las");
    fs::write(daemon.inbox().join(bad), las(400, 99)).unwrap();
    let jobs = wait_for("all octrees", || {
        let jobs = daemon.jobs();
        (jobs.len() == wished.len() + 3 && jobs.iter().all(|job| job["state"] == "done")).then_some(jobs)
    });
    for job in &jobs {
        let name = job["name"].as_str().expect("a name");
        assert!(!name.starts_with('.') && !name.is_empty(), "{job}");
        assert!(daemon.octree(name).join("metadata.json").exists(), "{job}");
        assert_eq!(daemon.get(job["octree"].as_str().expect("an address")).0, 200, "{job}");
    }
    let (status, text) = daemon.get("/api/watch");
    assert!(status == 200 && text.contains("not UTF-8"), "{status} {text}");
}

/// Thousands of things that are not for it: the good files are converted, and it
/// stays well.
#[test]
fn ten_thousand_hostile_things_hold_nothing_up() {
    let root = tempfile::tempdir().unwrap();
    let data = root.path().join("data");
    let inbox = data.join("inbox");
    fs::create_dir_all(&inbox).unwrap();
    for n in 0..2_000 {
        symlink("/proc/kmsg", inbox.join(format!("link {n}.las"))).unwrap();
        symlink("/proc/self/root", inbox.join(format!("root{n}"))).unwrap();
        pipe(&inbox.join(format!("pipe\u{1b}[31m{n}\n.laz")));
        let folder = inbox.join(format!(" . .{n}"));
        fs::create_dir(&folder).unwrap();
        fs::write(folder.join("tile.las"), b"").unwrap();
        match n % 4 {
            0 => symlink("/proc/self/pagemap", folder.join("lodestone.json")).unwrap(),
            1 => fs::write(folder.join("lodestone.json"), "[".repeat(60_000)).unwrap(),
            2 => pipe(&folder.join("lodestone.json")),
            _ => fs::write(folder.join("lodestone.json"), r#"{"name": "../../x"}"#).unwrap(),
        }
        let name = [format!("{n}").as_bytes(), b"\xff\xfe.las"].concat();
        fs::write(inbox.join(std::ffi::OsStr::from_bytes(&name)), b"LASF").unwrap();
    }
    let daemon = Daemon::start(&data);
    for n in 0..3u64 {
        fs::write(daemon.inbox().join(format!("good{n}.las")), las(500, n + 1)).unwrap();
    }
    for n in 0..3 {
        daemon.wait(&format!("good{n}"), "done");
    }
    assert_eq!(daemon.get("/healthz").0, 200);
    assert_eq!(daemon.get("/api/watch").0, 200);
    assert_eq!(daemon.jobs().len(), 3);
}
