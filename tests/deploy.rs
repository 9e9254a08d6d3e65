//! What `deploy/` says of the program is held against the program: an alert on
//! a series that nobody writes never fires, and nobody notices.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

fn read(name: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(name);
    fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// All words of a text that begin so and go on in small letters.
fn words(text: &str, beginning: &str) -> BTreeSet<String> {
    text.split(|c: char| !c.is_ascii_alphanumeric() && c != '_')
        .filter(|word| word.starts_with(beginning) && word.len() > beginning.len())
        .map(str::to_string)
        .collect()
}

#[test]
fn alerts_ask_for_series_that_there_are() {
    let known = words(&read("src/metrics.rs"), "lodestone_");
    let asked = words(&read("deploy/alerts.yml"), "lodestone_");
    assert!(asked.len() >= 5, "{asked:?}");
    let unknown: Vec<_> = asked.difference(&known).collect();
    assert!(unknown.is_empty(), "nobody writes {unknown:?}");
}

#[test]
fn settings_that_are_deployed_or_written_of_exist() {
    let output = Command::new(env!("CARGO_BIN_EXE_lodestone")).args(["serve", "--help"]).output().unwrap();
    let help = String::from_utf8(output.stdout).unwrap();
    let known = words(&help, "LODESTONE_");
    assert!(known.contains("LODESTONE_LISTEN"), "{help}");
    for file in ["deploy/lodestone.service", "deploy/Dockerfile", "README.md"] {
        for word in words(&read(file), "LODESTONE_") {
            let of_tests = ["DATA", "VIEWER", "PROMETHEUS", "SMALL_DISKS", "HISTORIES", "MANY"];
            let of_tests = of_tests.iter().any(|name| word == format!("LODESTONE_{name}"));
            assert!(of_tests || known.contains(&word), "{file} speaks of {word}");
        }
    }
}

/// Every command and flag that the README shows, `lodestone` knows.
#[test]
fn the_readme_speaks_of_commands_that_there_are() {
    let readme = read("README.md");
    let mut seen = 0;
    for line in readme.lines() {
        // Lines of code, and code within lines.
        let pieces: Vec<&str> = if line.starts_with("lodestone ") {
            vec![line]
        } else {
            line.split('`').skip(1).step_by(2).filter(|piece| piece.starts_with("lodestone ")).collect()
        };
        for piece in pieces {
            let mut words = piece.split_whitespace().skip(1);
            let command = words.next().unwrap();
            let output =
                Command::new(env!("CARGO_BIN_EXE_lodestone")).args([command, "--help"]).output().unwrap();
            let help = String::from_utf8(output.stdout).unwrap();
            assert!(output.status.success(), "README: {piece}");
            for flag in words.map(|word| word.trim_matches(['[', ']'])).filter(|word| word.starts_with('-')) {
                assert!(help.contains(flag), "README: {piece}: no {flag}");
            }
            seen += 1;
        }
    }
    assert!(seen >= 8, "only {seen} commands found");
}

/// What `.ci/run` takes from the README is there to be taken.
#[test]
fn the_readme_opens_with_the_two_commands() {
    let readme = read("README.md");
    let block: Vec<&str> = readme
        .lines()
        .skip_while(|line| *line != "```sh")
        .skip(1)
        .take_while(|line| *line != "```")
        .collect();
    assert_eq!(block, ["cargo run --release -- serve", "cargo test --release"]);
    for name in ["LICENSE-MIT", "LICENSE-APACHE", "ARCHITECTURE.md"] {
        assert!(
            readme.contains(name) && PathBuf::from(env!("CARGO_MANIFEST_DIR")).join(name).exists(),
            "{name}"
        );
    }
}
