//! Results on stdout, messages on stderr: what is said, to whom, and with which
//! exit code.

use std::fs::{self, File};
use std::io::{BufRead, BufReader, Read, Write};
use std::path::Path;
use std::process::Stdio;

use rustix::process::{Pid, Signal, kill_process};

use super::{command, lodestone, stderr, stdout, text};
use crate::cases;
use crate::daemon_support::{las, wait_for};

fn dropped(folder: &Path, name: &str, bytes: &[u8]) -> String {
    let path = folder.join(name);
    fs::write(&path, bytes).expect("written");
    path.to_str().expect("UTF-8").to_string()
}

#[test]
fn results_and_notes_are_no_progress() {
    let root = tempfile::tempdir().expect("a folder");
    let input = dropped(root.path(), "a.las", &las(1000, 1)[..227 + 20 * 600]);
    for style in ["none", "NONE", "plain"] {
        let octree = root.path().join(style);
        let arguments = ["convert", &input, "-o", text(&octree), "--damaged", "keep", "--progress", style];
        let run = lodestone(&arguments);
        assert_eq!(run.status.code(), Some(3), "{}", stderr(&run));
        for word in ["600 points in", "note: 400 of the 1000 points", "exactly where"] {
            assert!(stdout(&run).contains(word), "{style}: {word} is missing in {}", stdout(&run));
        }
    }
    // For machines the result is an event, and nothing else is said.
    let octree = root.path().join("json");
    let run = lodestone(&["convert", &input, "-o", text(&octree), "--damaged", "keep", "--progress", "json"]);
    assert_eq!((run.status.code(), stdout(&run).as_str()), (Some(3), ""));
    assert!(stderr(&run).contains(r#""event":"done""#), "{}", stderr(&run));
}

/// Commands that print a result, short and long.
fn commands(root: &Path) -> Vec<Vec<String>> {
    let input = dropped(root, "a.las", &las(3000, 1));
    let octree = root.join("octree").to_str().expect("UTF-8").to_string();
    let made = lodestone(&["convert", &input, "-o", &octree]);
    assert!(made.status.success(), "{}", stderr(&made));
    let lines = [
        vec!["--version"],
        vec!["--help"],
        vec!["info", &octree],
        vec!["info", &octree, "--json"],
        vec!["verify", &octree],
        vec!["verify", &octree, "--json"],
        vec!["config"],
        vec!["convert", &input, "-o", &octree, "--overwrite"],
        vec!["completions", "zsh"],
        vec!["man"],
        vec!["preview", &octree, "--frames", "0", "--size", "32x32", "--json"],
    ];
    lines.into_iter().map(|line| line.into_iter().map(str::to_string).collect()).collect()
}

#[test]
fn a_reader_that_leaves_is_no_failure() {
    let root = tempfile::tempdir().expect("a folder");
    for line in commands(root.path()) {
        let (reader, writer) = std::io::pipe().expect("a pipe");
        drop(reader);
        let line: Vec<&str> = line.iter().map(String::as_str).collect();
        let run = command(&line).stdout(writer).stderr(Stdio::piped()).output().expect("started");
        assert_eq!(run.status.code(), Some(0), "{line:?}: {}", stderr(&run));
        assert!(!stderr(&run).contains("panicked"), "{line:?}: {}", stderr(&run));
    }
}

#[test]
fn a_full_disk_behind_stdout_is_a_failure() {
    let root = tempfile::tempdir().expect("a folder");
    for line in commands(root.path()) {
        let full = || File::options().write(true).open("/dev/full").expect("a device");
        let line: Vec<&str> = line.iter().map(String::as_str).collect();
        let run = command(&line).stdout(full()).stderr(Stdio::piped()).output().expect("started");
        assert_eq!(run.status.code(), Some(1), "{line:?}: {}", stderr(&run));
        assert!(stderr(&run).contains("could not be written to stdout"), "{line:?}: {}", stderr(&run));
        assert!(!stderr(&run).contains("panicked"), "{line:?}: {}", stderr(&run));
        // Nor is a stderr that nobody takes a reason to die of.
        let run = command(&line).stdout(full()).stderr(full()).output().expect("started");
        assert_eq!(run.status.code(), Some(1), "{line:?}");
    }
    let run = command(&["convert", "nothing.las", "-o", "x", "--log", "trace"])
        .stderr(File::options().write(true).open("/dev/full").expect("a device"))
        .output()
        .expect("started");
    assert_eq!(run.status.code(), Some(1));
}

#[test]
fn messages_blame_the_right_thing() {
    let root = tempfile::tempdir().expect("a folder");
    let good = las(100, 1);
    let with = |at: usize, bytes: &[u8]| {
        let mut bad = good.clone();
        bad[at..at + bytes.len()].copy_from_slice(bytes);
        bad
    };
    for (name, bytes, words) in [
        ("empty.las", vec![], &["it is empty"][..]),
        ("short.las", good[..100].to_vec(), &["ends after 100 bytes, within its header"]),
        ("nosize.las", with(94, &[0, 0]), &["has 0 bytes, and no LAS header has fewer than 227"]),
        ("small.las", with(94, &[200, 0]), &["has 200 bytes, and no LAS header has fewer than 227"]),
        ("large.las", with(94, &[255, 255]), &["has 65535 bytes, and the whole file has 2227"]),
        ("inside.las", with(96, &[100, 0, 0, 0]), &["begin at byte 100", "one of the two is wrong"]),
        ("scale.las", with(131, &f64::MAX.to_le_bytes()), &[]),
        ("offset.las", with(155, &f64::NAN.to_le_bytes()), &["offset of x is NaN"]),
        ("text.las", b"these are not points".to_vec(), &["does not begin with LASF"]),
    ] {
        let input = dropped(root.path(), name, &bytes);
        let run = lodestone(&["convert", &input, "-o", text(&root.path().join("o")), "--overwrite"]);
        let said = stderr(&run);
        for word in words {
            assert!(said.contains(word) && said.contains(name), "{name}: {said}");
            assert_eq!(run.status.code(), Some(1), "{said}");
        }
        assert!(said.len() < 2000 && !said.contains("panicked"), "{name}: {said}");
    }
    // A mirror of the integers is read, or refused for what it is.
    if let Some(cases) = cases() {
        let input = cases.join("c12a_negative_scale_z.las");
        let run = lodestone(&["convert", text(&input), "-o", text(&root.path().join("mirror"))]);
        let said = stderr(&run) + &stdout(&run);
        assert!(run.status.success() || said.contains("negative"), "{said}");
    }
}

#[test]
fn an_existing_output_names_overwrite() {
    let root = tempfile::tempdir().expect("a folder");
    let input = dropped(root.path(), "a.las", &las(100, 1));
    let octree = root.path().join("octree");
    assert!(lodestone(&["convert", &input, "-o", text(&octree)]).status.success());
    let again = lodestone(&["convert", &input, "-o", text(&octree)]);
    assert_eq!(again.status.code(), Some(1));
    assert!(stderr(&again).contains("--overwrite"), "{}", stderr(&again));
    assert!(lodestone(&["convert", &input, "-o", text(&octree), "--overwrite"]).status.success());
}

#[test]
fn a_queue_that_is_not_there_is_told_as_such() {
    let root = tempfile::tempdir().expect("a folder");
    fs::create_dir(root.path().join("empty")).expect("made");
    fs::create_dir_all(root.path().join("odd/lodestone.db")).expect("made");
    fs::write(root.path().join("file"), "").expect("written");
    fs::create_dir(root.path().join("text")).expect("made");
    fs::create_dir(root.path().join("blank")).expect("made");
    fs::write(root.path().join("blank/lodestone.db"), "").expect("written");
    fs::write(root.path().join("text/lodestone.db"), "this is no database, but long enough")
        .expect("written");
    for (folder, words) in [
        ("nowhere", &["the folder", "is not there", "--root"][..]),
        ("empty", &["no daemon has worked here yet", "LODESTONE_ROOT"]),
        ("file", &["is not a folder"]),
        ("odd", &["it is a folder"]),
        ("text", &["is this a Lodestone database?"]),
        ("blank", &["is no queue of Lodestone's"]),
    ] {
        let run = lodestone(&["jobs", "list", "--root", text(&root.path().join(folder))]);
        assert_eq!(run.status.code(), Some(1), "{folder}: {}", stderr(&run));
        for word in words {
            assert!(stderr(&run).contains(word), "{folder}: {word} is missing in {}", stderr(&run));
        }
        assert!(!root.path().join(folder).join("lodestone.db-wal").exists());
    }
    // A place where nobody may write, root neither.
    let run = lodestone(&["jobs", "list", "--root", "/proc/self"]);
    assert!(stderr(&run).contains("/proc/self"), "{}", stderr(&run));
    assert!(!stderr(&run).contains("unable to open database file"), "{}", stderr(&run));
}

#[test]
fn an_interrupted_conversion_says_what_remains() {
    let root = tempfile::tempdir().expect("a folder");
    let input = root.path().join("big.las");
    let made = lodestone(&["synth", "terrain", "-o", text(&input), "--points", "700k"]);
    assert!(made.status.success(), "{}", stderr(&made));
    for (memory, word) in [("4G", "nothing remains of it"), ("64M", "the same command goes on from there")] {
        let octree = root.path().join(format!("octree {memory}"));
        let line = [
            "convert",
            text(&input),
            "-o",
            text(&octree),
            "--memory-limit",
            memory,
            "--threads",
            "1",
            "--progress",
            "plain",
        ];
        let mut child = command(&line).stderr(Stdio::piped()).stdout(Stdio::null()).spawn().expect("started");
        let mut said = BufReader::new(child.stderr.take().expect("piped"));
        let mut all = String::new();
        // Far enough that there is something to go on from.
        while !all.contains("index") && said.read_line(&mut all).expect("read") > 0 {}
        kill_process(Pid::from_child(&child), Signal::INT).expect("sent");
        said.read_to_string(&mut all).expect("read");
        let code = child.wait().expect("gone").code();
        if code == Some(0) {
            // It was quicker than the signal.
            continue;
        }
        assert_eq!(code, Some(1), "{all}");
        assert!(all.contains("stopped on request") && all.contains(word), "{all}");
    }
}

/// On a terminal the message of Ctrl-C begins at the start of a line, and the bar is
/// gone.
#[test]
fn ctrl_c_leaves_a_clean_line() {
    let root = tempfile::tempdir().expect("a folder");
    let input = root.path().join("big.las");
    let made = lodestone(&["synth", "terrain", "-o", text(&input), "--points", "2M"]);
    assert!(made.status.success(), "{}", stderr(&made));
    let typescript = root.path().join("typescript");
    let program = env!("CARGO_BIN_EXE_lodestone");
    let line = format!(
        "'{program}' convert '{}' -o '{}' --threads 1 --progress bar",
        input.display(),
        root.path().join("octree").display()
    );
    // `script` gives it a terminal of its own, and its input is typed there.
    let spawned = command(&[]).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).spawn();
    drop(spawned.map(|mut child| child.wait()));
    let script = std::process::Command::new("script")
        .args(["-qefc", &line])
        .arg(&typescript)
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .spawn();
    let Ok(mut script) = script else {
        eprintln!("there is no `script`: the terminal is left out");
        return;
    };
    let shown = || fs::read_to_string(&typescript).unwrap_or_default();
    wait_for("a bar", || shown().contains("M points/s").then_some(()));
    let mut keys = script.stdin.take().expect("piped");
    keys.write_all(&[3]).expect("typed");
    script.wait().expect("gone");
    let shown = shown();
    let Some((before, after)) = shown.split_once("lodestone: the conversion was stopped") else {
        // It was quicker than the key.
        assert!(shown.contains("points in"), "{shown}");
        return;
    };
    // The bar was cleared: the cursor stands at the start of an empty line.
    let last = before.rsplit(['\n', '\r']).next().unwrap_or_default();
    assert!(!last.contains("M points/s"), "{shown:?}");
    assert!(after.contains("nothing remains of it"), "{shown:?}");
}

#[test]
fn completions_and_manual_pages_know_every_command() {
    let root = tempfile::tempdir().expect("a folder");
    for shell in ["bash", "ZSH", "fish", "PowerShell", "elvish"] {
        let run = lodestone(&["completions", shell]);
        assert!(run.status.success(), "{shell}: {}", stderr(&run));
        for word in ["convert", "lod-color", "completions", "jobs"] {
            assert!(stdout(&run).contains(word), "{shell}: {word}");
        }
    }
    let checked = root.path().join("lodestone.bash");
    fs::write(&checked, lodestone(&["completions", "bash"]).stdout).expect("written");
    let sound = std::process::Command::new("bash").arg("-n").arg(&checked).status().expect("bash");
    assert!(sound.success());
    let page = lodestone(&["man"]);
    assert!(
        stdout(&page).contains(".TH lodestone 1") && stdout(&page).contains("convert"),
        "{}",
        stdout(&page)
    );
    let pages = root.path().join("man1");
    let run = lodestone(&["man", "--output", text(&pages)]);
    assert!(run.status.success(), "{}", stderr(&run));
    for (page, word) in
        [("convert", "memory"), ("serve", "LODESTONE_LISTEN"), ("jobs", "purge"), ("man", "folder")]
    {
        let text = fs::read_to_string(pages.join(format!("lodestone-{page}.1"))).expect("a page");
        assert!(text.contains(word), "{page}: {text}");
        assert_eq!(stdout(&lodestone(&["man", page])), text, "{page}");
    }
    assert_eq!(lodestone(&["man", "dance"]).status.code(), Some(2));
}
