//! What arrives in a watched folder, and when a source may be deleted.

use std::fs::{self, File, OpenOptions};
use std::io::{Seek, SeekFrom, Write};
use std::os::unix::fs::FileExt;
use std::path::Path;
use std::time::Duration;

use serde_json::Value;

use crate::common::{options_of, surface, write_las};
use crate::daemon_support::{Daemon, content, converted, fill_folder, las, wait_for};

mod again;

const APPLE_DOUBLE: &[u8] = b"\0\x05\x16\x07\0\x02\0\0Mac OS X        ";

fn root() -> tempfile::TempDir {
    tempfile::tempdir().expect("a folder")
}

fn start(root: &Path, on_done: &str, patience: &str) -> Daemon {
    Daemon::start_with(&root.join("data"), &["--on-done", on_done, "--patience-seconds", patience])
}

/// What the waiting list says of a path that ends like this.
fn waiting(daemon: &Daemon, end: &str) -> Option<Value> {
    let list = daemon.json("/api/watch")["waiting"].clone();
    list.as_array()?
        .iter()
        .find(|entry| entry["path"].as_str().is_some_and(|path| path.ends_with(end)))
        .cloned()
}

fn waits_as(daemon: &Daemon, end: &str, kind: &str) -> Value {
    wait_for(&format!("{end} to wait as {kind}"), || {
        waiting(daemon, end).filter(|entry| entry["kind"] == kind)
    })
}

fn points(daemon: &Daemon, name: &str) -> u64 {
    let text = fs::read_to_string(daemon.octree(name).join("metadata.json")).expect("an octree");
    serde_json::from_str::<Value>(&text).expect("JSON")["points"].as_u64().expect("a number")
}

fn gone(path: &Path) {
    wait_for(&format!("{} to be removed", path.display()), || (!path.exists()).then_some(()));
}

/// When this is removed, all that was to be removed before it was looked at.
fn all_debts_are_paid(daemon: &Daemon) {
    let last = daemon.inbox().join("the last.las");
    fs::write(&last, las(50, 99)).expect("dropped");
    gone(&last);
}

/// A file of its last length, of which the middle third was not written yet.
fn with_a_gap(path: &Path, bytes: &[u8], hole: bool) {
    let third = bytes.len() / 3;
    let mut file = File::create(path).expect("created");
    file.set_len(bytes.len() as u64).expect("set");
    file.write_all(&bytes[..third]).expect("written");
    if !hole {
        file.write_all(&vec![0; third]).expect("written");
    }
    file.seek(SeekFrom::Start(2 * third as u64)).expect("there");
    file.write_all(&bytes[2 * third..]).expect("written");
}

#[test]
fn what_systems_leave_behind_is_nothing() {
    let root = root();
    let daemon = start(root.path(), "delete", "1");
    fs::write(daemon.inbox().join("._single.las"), APPLE_DOUBLE).expect("written");
    daemon.drop_folder(
        "city",
        &[
            ("a.las", las(500, 1)),
            ("b.las", las(500, 2)),
            ("._a.las", APPLE_DOUBLE.to_vec()),
            (".DS_Store", vec![1]),
        ],
    );
    daemon.drop_folder("zip", &[("a.las", las(500, 3)), ("__MACOSX/._a.las", APPLE_DOUBLE.to_vec())]);
    let mark = vec![1];
    daemon.drop_folder(
        "win",
        &[
            ("a.las", las(500, 4)),
            ("a.las:Zone.Identifier", mark.clone()),
            ("Thumbs.db", mark.clone()),
            ("@eaDir/a.las@SynoEAStream", mark),
        ],
    );
    // By its name macOS keeps it beside a file; but it is a cloud.
    daemon.drop_folder("disguised", &[("a.las", las(500, 5)), ("._b.las", las(500, 6))]);
    for name in ["city", "zip", "win", "disguised"] {
        daemon.wait(name, "done");
    }
    for name in ["city", "zip", "win"] {
        gone(&daemon.inbox().join(name));
    }
    assert_eq!((daemon.jobs().len(), points(&daemon, "city")), (4, 1_000));
    gone(&daemon.inbox().join("disguised/a.las"));
    assert!(daemon.inbox().join("disguised/._b.las").exists());
    assert!(waiting(&daemon, "single.las").is_none());
}

#[test]
fn a_gap_waits_and_is_never_deleted() {
    let root = root();
    let daemon = start(root.path(), "delete", "3");
    with_a_gap(&daemon.inbox().join("hole.las"), &las(9_000, 1), true);
    with_a_gap(&daemon.inbox().join("zeros.las"), &las(9_000, 2), false);
    let packed = root.path().join("whole.laz");
    write_las(&packed, &options_of(3, true), &surface(3, 60_000, 1));
    with_a_gap(&daemon.inbox().join("packed.laz"), &fs::read(&packed).expect("written"), false);
    daemon.drop_folder("tiles", &[("whole.las", las(500, 3))]);
    with_a_gap(&daemon.inbox().join("tiles/hole.las"), &las(9_000, 4), true);
    for name in ["hole.las", "zeros.las", "packed.laz", "tiles"] {
        let told = waits_as(&daemon, name, "zeros");
        assert!(told["why"].as_str().expect("text").contains("not whole yet"), "{told}");
        assert!(told["since"].as_i64() > Some(0) && told["bytes"].as_u64() > Some(0), "{told}");
    }
    for name in ["hole", "zeros", "tiles"] {
        let job = daemon.wait(name, "done");
        let notes = job["result"]["notes"].to_string();
        assert!(notes.contains("may not be whole") && notes.contains("stay"), "{notes}");
    }
    wait_for("the packed one to end", || {
        let jobs = daemon.jobs();
        let job = jobs.iter().find(|job| job["name"] == "packed")?;
        matches!(job["state"].as_str(), Some("done" | "failed" | "quarantined")).then_some(())
    });
    all_debts_are_paid(&daemon);
    for name in ["hole.las", "zeros.las", "packed.laz", "tiles/whole.las", "tiles/hole.las"] {
        assert!(daemon.inbox().join(name).exists(), "{name} is gone");
    }
}

#[test]
fn a_gap_that_is_filled_is_converted_whole() {
    let root = root();
    let daemon = start(root.path(), "delete", "1");
    for (seed, name, hole) in [(1, "a", true), (2, "b", false)] {
        let bytes = las(9_000, seed);
        let whole = root.path().join(format!("{name}.las"));
        fs::write(&whole, &bytes).expect("written");
        let path = daemon.inbox().join(format!("{name}.las"));
        with_a_gap(&path, &bytes, hole);
        let first = daemon.wait(name, "done");
        let third = bytes.len() / 3;
        let file = OpenOptions::new().write(true).open(&path).expect("its writer finds it");
        file.write_all_at(&bytes[third..2 * third], third as u64).expect("written");
        drop(file);
        wait_for("the whole one", || {
            let jobs = daemon.jobs();
            let second = jobs.iter().find(|job| job["name"] == name && job["id"] != first["id"])?;
            (second["state"] == "done").then_some(())
        });
        gone(&path);
        assert!(content(&daemon.octree(name)) == converted(&[&whole], &root.path().join(name)));
    }
}

#[test]
fn a_tile_under_a_temporary_name_is_waited_for() {
    let root = root();
    let daemon = start(root.path(), "delete", "4");
    let bytes = las(8_000, 2);
    let names =
        ["city/.tile2.las.Qx7GhZ", "town/.~tmp~/tile2.las", "port/tile2.las.filepart", "mill/upload.part"];
    for name in names {
        let folder = name.split('/').next().expect("a folder");
        let first = (folder.len() + folder.as_bytes()[0] as usize) as u64;
        fill_folder(&daemon.inbox().join(folder), &[(name.split_once('/').expect("a file").1, vec![])]);
        fs::write(daemon.inbox().join(folder).join("tile1.las"), las(500, first)).expect("written");
    }
    // For twice as long as patience.
    for (number, piece) in bytes.chunks(bytes.len() / 8 + 1).enumerate() {
        for name in names {
            let path = daemon.inbox().join(name);
            OpenOptions::new().append(true).open(path).expect("there").write_all(piece).expect("written");
        }
        std::thread::sleep(Duration::from_secs(1));
        assert!(daemon.jobs().is_empty(), "taken after piece {number}: {:?}", daemon.jobs());
    }
    for name in names {
        let folder = name.split('/').next().expect("a folder");
        let tile = daemon.inbox().join(folder).join("tile2.las");
        // Different for each, or it would be known.
        let mut whole = bytes.clone();
        whole[227] = name.as_bytes()[0];
        let path = daemon.inbox().join(name);
        fs::write(&path, whole).expect("written");
        fs::rename(path, tile).expect("renamed");
    }
    for name in ["city", "town", "port", "mill"] {
        daemon.wait(name, "done");
        assert_eq!(points(&daemon, name), 8_500);
        gone(&daemon.inbox().join(name).join("tile2.las"));
    }
    assert_eq!(daemon.jobs().len(), 4);
}

#[test]
fn a_name_that_comes_again_is_another_octree() {
    for on_done in ["delete", "move"] {
        let root = root();
        let daemon = start(root.path(), on_done, "1");
        let source = daemon.inbox().join("scan001.las");
        for (number, name) in ["scan001", "scan001-2", "scan001-3"].iter().enumerate() {
            fs::write(&source, las(100 * (number as u32 + 1), number as u64)).expect("dropped");
            daemon.wait(name, "done");
            gone(&source);
        }
        // The first once more is known, and put away again.
        fs::write(&source, las(100, 0)).expect("dropped");
        gone(&source);
        assert_eq!(daemon.jobs().len(), 3);
        for (number, name) in ["scan001", "scan001-2", "scan001-3"].iter().enumerate() {
            assert_eq!(points(&daemon, name), 100 * (number as u64 + 1), "{name}");
        }
    }
}

/// Updated in place on purpose: the source is there, and its octree follows it.
#[test]
fn a_source_that_is_kept_is_followed() {
    let root = root();
    let daemon = start(root.path(), "keep", "1");
    let source = daemon.inbox().join("a.las");
    for points_now in [100u32, 200] {
        fs::write(&source, las(points_now, 1)).expect("dropped");
        wait_for("its octree", || {
            let text = fs::read_to_string(daemon.octree("a").join("metadata.json")).ok()?;
            let shown = serde_json::from_str::<Value>(&text).ok()?["points"].as_u64()?;
            (shown == u64::from(points_now)).then_some(())
        });
    }
    assert!(!daemon.octree("a-2").exists());
    // Other content of the same size and time.
    let time = fs::metadata(&source).expect("there").modified().expect("a time");
    fs::write(&source, las(200, 7)).expect("dropped");
    OpenOptions::new().append(true).open(&source).expect("there").set_modified(time).expect("set");
    let whole = root.path().join("a.las");
    fs::write(&whole, las(200, 7)).expect("written");
    let expected = converted(&[&whole], &root.path().join("a"));
    wait_for("the new content", || (content(&daemon.octree("a")) == expected).then_some(()));
}

#[test]
fn what_the_queue_does_not_know_is_never_replaced() {
    let root = root();
    let mut daemon = start(root.path(), "keep", "1");
    fs::create_dir(daemon.octree("mine")).expect("made");
    fs::write(daemon.octree("mine").join("notes.txt"), "mine").expect("written");
    fs::write(daemon.inbox().join("mine.las"), las(100, 1)).expect("dropped");
    daemon.wait("mine-2", "done");
    // The octree of a known source is exchanged for somebody's own, and the source changes.
    fs::write(daemon.inbox().join("b.las"), las(100, 2)).expect("dropped");
    daemon.wait("b", "done");
    fs::remove_dir_all(daemon.octree("b")).expect("removed");
    fs::create_dir(daemon.octree("b")).expect("made");
    fs::write(daemon.octree("b").join("metadata.json"), "{}").expect("written");
    fs::write(daemon.inbox().join("b.las"), las(200, 3)).expect("dropped");
    daemon.wait("b-2", "done");
    assert_eq!(fs::read_to_string(daemon.octree("b").join("metadata.json")).expect("there"), "{}");
    assert_eq!(fs::read_to_string(daemon.octree("mine").join("notes.txt")).expect("there"), "mine");
    // The database is lost.
    assert!(daemon.stop());
    for end in ["", "-wal", "-shm"] {
        let _ = fs::remove_file(daemon.root.join(format!("lodestone.db{end}")));
    }
    fs::write(daemon.inbox().join("mine.las"), las(300, 4)).expect("replaced");
    let daemon = start(root.path(), "delete", "1");
    daemon.wait("mine-3", "done");
    assert_eq!((points(&daemon, "mine-2"), points(&daemon, "mine-3")), (100, 300));
    assert_eq!(points(&daemon, "b-2"), 200);
}

/// Deleted by name and by the queue's word alone, the only copy would be gone.
#[test]
fn a_source_whose_octree_is_gone_stays() {
    let root = root();
    let daemon = start(root.path(), "delete", "1");
    let source = daemon.inbox().join("a.las");
    fs::write(&source, las(100, 1)).expect("dropped");
    gone(&source);
    fs::remove_dir_all(daemon.octree("a")).expect("removed");
    fs::write(&source, las(100, 1)).expect("dropped once more");
    all_debts_are_paid(&daemon);
    assert!(source.exists());
    let job = daemon.jobs()[0]["id"].clone();
    let history = daemon.json(&format!("/api/jobs/{job}"))["history"].to_string();
    assert!(history.contains("no longer there"), "{history}");
}

#[test]
fn a_marker_that_comes_first_hurries_nothing() {
    let root = root();
    let daemon = start(root.path(), "delete", "4");
    let city = daemon.inbox().join("city");
    fill_folder(&city, &[("lodestone.json", br#"{"name": "city"}"#.to_vec()), ("tile1.las", las(100, 1))]);
    daemon.wait("city", "done");
    // Its copier goes on; on a busy machine it may be too late, and begins a folder anew.
    fill_folder(&city, &[("tile2.las", las(200, 2))]);
    wait_for("both tiles", || {
        let octrees = ["city", "city-2"].map(|name| daemon.octree(name)).into_iter().filter(|o| o.exists());
        let sum: u64 = octrees
            .map(|o| points(&daemon, &o.file_name()?.to_string_lossy()).into())
            .sum::<Option<u64>>()?;
        (sum == 300).then_some(())
    });
    gone(&city);
}

#[test]
fn a_wrong_marker_fails_and_says_why() {
    let root = root();
    let daemon = start(root.path(), "delete", "2");
    let long = format!("{{\"name\": \"{}\"}}", "x".repeat(70_000));
    let wrong = [
        ("broken", "{\"name\": ", "wrong"),
        ("typo", r#"{"nmae": "x"}"#, "nmae"),
        ("case", r#"{"Options": {}}"#, "Options"),
        ("option", r#"{"options": {"samplng": "random"}}"#, "samplng"),
        ("value", r#"{"on_done": "burn"}"#, "burn"),
        ("long", &long, "70012"),
        ("list", "[]", "object"),
        ("empty", "", "wrong"),
    ];
    for (number, (name, text, _)) in wrong.iter().enumerate() {
        let files = [("a.las", las(100, number as u64)), ("lodestone.json", text.as_bytes().to_vec())];
        daemon.drop_folder(name, &files);
    }
    waits_as(&daemon, "typo", "marker");
    for (name, _, word) in wrong {
        let job = daemon.wait(name, "failed");
        let error = job["error"].as_str().expect("told");
        assert!(error.contains(word) && error.contains("lodestone.json"), "{name}: {error}");
        assert!(!daemon.octree(name).exists() && daemon.inbox().join(name).join("a.las").exists());
    }
    // In its own name.
    for (number, name) in ["Lodestone.json", "lodestone.json.txt", "lodestone.jsn"].iter().enumerate() {
        let files = [("a.las", las(100, 100 + number as u64)), (*name, b"{}".to_vec())];
        daemon.drop_folder(&format!("name {number}"), &files);
        let job = daemon.wait(&format!("name {number}"), "failed");
        assert!(job["error"].as_str().is_some_and(|error| error.contains(name)), "{job}");
    }
    // A copy of it beside the right one is none of its business.
    let files =
        [("a.las", las(100, 200)), ("lodestone.json", b"{}".to_vec()), ("Lodestone.json", b"{".to_vec())];
    daemon.drop_folder("both", &files);
    daemon.wait("both", "done");
    fs::write(daemon.inbox().join("typo/lodestone.json"), "{}").expect("mended");
    daemon.wait("typo", "done");
}

#[test]
fn what_is_not_taken_is_named_once() {
    let root = root();
    let daemon = start(root.path(), "keep", "1");
    let unread = vec![1, 2, 3];
    for name in ["a.e57", "b.zip", "c.weird"] {
        fs::write(daemon.inbox().join(name), &unread).expect("dropped");
    }
    daemon.drop_folder(
        "tiles",
        &[("t.las", las(100, 1)), ("far/u.PLY", unread.clone()), ("notes.txt", unread)],
    );
    for (name, word) in
        [("a.e57", "PDAL or CloudCompare"), ("b.zip", "unpack"), ("c.weird", ".weird"), ("far/u.PLY", "PLY")]
    {
        let told = waits_as(&daemon, name, "not_taken");
        assert!(told["why"].as_str().expect("text").contains(word), "{told}");
    }
    let job = daemon.wait("tiles", "done");
    assert!(waiting(&daemon, "notes.txt").is_none(), "it is no cloud by any name");
    fs::write(daemon.inbox().join("same.las"), las(100, 5)).expect("dropped");
    let first = daemon.wait("same", "done");
    fs::write(daemon.inbox().join("copy.las"), las(100, 5)).expect("dropped");
    let told = waits_as(&daemon, "copy.las", "copy");
    assert_eq!(told["job"], first["id"], "{told} of {job}");
    assert_eq!(daemon.log().matches("E57 is not read").count(), 1);
}

#[test]
fn how_much_has_arrived_is_told() {
    let root = root();
    let daemon = start(root.path(), "keep", "60");
    let bytes = las(10_000, 1);
    fs::write(daemon.inbox().join("a.las"), &bytes[..bytes.len() / 2]).expect("half");
    with_a_gap(&daemon.inbox().join("b.las"), &las(90_000, 2), true);
    let told = waits_as(&daemon, "a.las", "incomplete");
    assert_eq!(told["bytes"], bytes.len() / 2);
    assert_eq!(told["expected_bytes"], bytes.len());
    let why = told["why"].as_str().expect("text");
    assert!(why.starts_with("not whole yet") && why.contains("have arrived"), "{why}");
    let told = waits_as(&daemon, "b.las", "zeros");
    assert!(
        told["bytes"].as_u64() < told["expected_bytes"].as_u64() || told["expected_bytes"].is_null(),
        "{told}"
    );
}
