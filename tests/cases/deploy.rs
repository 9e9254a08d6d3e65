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
    let known = words(&read("src/serve/metrics.rs"), "lodestone_");
    let asked = words(&read("deploy/alerts.yml"), "lodestone_");
    assert!(asked.len() >= 5, "{asked:?}");
    let unknown: Vec<_> = asked.difference(&known).collect();
    assert!(unknown.is_empty(), "nobody writes {unknown:?}");
}

/// The series that a query asks for, with the labels that it names.
fn series(query: &str) -> Vec<(String, Vec<String>)> {
    let mut found = Vec::new();
    for word in words(query, "lodestone_").into_iter().chain(words(query, "process_")) {
        let at = query.find(&word).unwrap() + word.len();
        let braces =
            query[at..].strip_prefix('{').and_then(|rest| rest.split_once('}')).map_or("", |(b, _)| b);
        let labels = braces.split(',').filter_map(|pair| pair.split(['=', '!']).next());
        found.push((word.clone(), labels.map(str::to_string).collect()));
    }
    found
}

/// Every query of the dashboard and of the alerts, against what a daemon that
/// has converted something really shows.
#[test]
fn the_dashboard_and_the_alerts_ask_for_what_a_daemon_shows() {
    let root = tempfile::tempdir().unwrap();
    let daemon = crate::daemon_support::Daemon::start(&root.path().join("data"));
    fs::write(daemon.inbox().join("a.las"), crate::daemon_support::las(1_000, 1)).unwrap();
    daemon.wait("a", "done");
    // Counted last of what an end counts.
    let shown = daemon.wait_metrics(&["lodestone_job_seconds_count 1"]);

    let dashboard: serde_json::Value = serde_json::from_str(&read("deploy/grafana-dashboard.json")).unwrap();
    let mut queries =
        vec![dashboard["templating"]["list"][1]["query"]["query"].as_str().unwrap().to_string()];
    let (mut ids, mut places) = (BTreeSet::new(), BTreeSet::new());
    for panel in dashboard["panels"].as_array().unwrap() {
        assert!(ids.insert(panel["id"].as_u64().unwrap()), "{panel}");
        assert!(places.insert(panel["gridPos"].to_string()), "{panel}");
        for target in panel["targets"].as_array().unwrap() {
            queries.push(target["expr"].as_str().unwrap().to_string());
            assert_eq!(
                target["datasource"]["uid"], "${datasource}",
                "the data source is the reader's to choose"
            );
        }
    }
    assert!(queries.len() > 30, "{} queries", queries.len());
    let alerts = read("deploy/alerts.yml");
    queries.extend(alerts.lines().filter_map(|line| line.trim().strip_prefix("expr: ")).map(str::to_string));
    let mut asked = BTreeSet::new();
    for query in &queries {
        let open = query.matches(['(', '{', '[']).count();
        assert_eq!(open, query.matches([')', '}', ']']).count(), "{query}");
        for (name, labels) in series(query) {
            let lines: Vec<_> = shown
                .lines()
                .filter(|line| line.strip_prefix(&name).is_some_and(|rest| rest.starts_with([' ', '{'])))
                .collect();
            assert!(!lines.is_empty(), "{query}: nobody shows {name}\n{shown}");
            for label in labels.iter().filter(|label| !["", "instance", "job"].contains(&label.as_str())) {
                assert!(
                    lines.iter().any(|line| line.contains(&format!("{label}=\""))),
                    "{query}: no label {label}"
                );
            }
            asked.insert(name);
        }
    }
    // And the other way round: what is shown is worth a look.
    let panels: Vec<_> =
        words(&shown, "lodestone_").into_iter().filter(|name| !name.ends_with("_count")).collect();
    let unseen: Vec<_> = panels
        .iter()
        .filter(|name| {
            !asked
                .iter()
                .any(|asked| asked.starts_with(name.trim_end_matches("_bucket").trim_end_matches("_sum")))
        })
        .collect();
    assert!(unseen.is_empty(), "no panel and no alert has {unseen:?}");
}

#[test]
fn settings_that_are_deployed_or_written_of_exist() {
    let output = Command::new(env!("CARGO_BIN_EXE_lodestone")).args(["serve", "--help"]).output().unwrap();
    let help = String::from_utf8(output.stdout).unwrap();
    let known = words(&help, "LODESTONE_");
    assert!(known.contains("LODESTONE_LISTEN"), "{help}");
    for file in
        ["deploy/lodestone.service", "deploy/Dockerfile", "README.md", "docs/manual.md", "docs/proxies.md"]
    {
        for word in words(&read(file), "LODESTONE_") {
            // What a hook is told is no setting; daemon_control.rs holds it to that.
            let of_hooks = ["JOB", "NAME", "STATE", "OCTREE", "SOURCE", "ERROR", "POINTS"];
            let other = of_hooks.iter().any(|name| word == format!("LODESTONE_{name}"));
            assert!(other || known.contains(&word), "{file} speaks of {word}");
        }
    }
}

/// The image's health check, run against a daemon as it runs there: with a token.
#[test]
fn the_image_s_health_check_tells_a_living_daemon_from_a_dead_one() {
    let dockerfile = read("deploy/Dockerfile").replace("\\\n", "");
    let check = dockerfile.lines().find(|line| line.starts_with("HEALTHCHECK")).expect("a health check");
    let (_, command) = check.split_once("CMD ").expect("a command");
    let command: Vec<String> = serde_json::from_str(command).expect("in the exec form");
    let root = tempfile::tempdir().expect("a folder");
    let mut daemon =
        crate::daemon_support::Daemon::start_with(&root.path().join("data"), &["--token", "a great secret"]);
    let place = daemon.address.replace(':', "/");
    assert!(command[2].contains("127.0.0.1/7700"), "{command:?}");
    let healthy = || {
        let script = command[2].replace("127.0.0.1/7700", &place);
        Command::new(&command[0]).arg(&command[1]).arg(script).output().expect("bash").status.success()
    };
    assert!(healthy());
    daemon.kill();
    assert!(!healthy());
}

/// What the image is built from is there, under the names that it uses.
#[test]
fn the_image_copies_what_the_build_makes() {
    let dockerfile = read("deploy/Dockerfile");
    assert!(dockerfile.contains("cargo build --release --locked --bin lodestone"));
    assert!(dockerfile.contains("--from=build /src/target/release/lodestone "));
    let cargo = read("Cargo.toml");
    let oldest = cargo.lines().find_map(|line| line.strip_prefix("rust-version = ")).expect("a version");
    assert!(
        dockerfile.contains(&format!("FROM rust:{}-slim-bookworm", oldest.trim_matches('"'))),
        "{oldest}"
    );
    // Nothing that the build reads may be kept from it.
    let ignored = read(".dockerignore");
    for needed in ["src", "Cargo.toml", "Cargo.lock", "migrations", "benches", "tests"] {
        assert!(ignored.lines().all(|line| line.trim_matches('/') != needed), "{needed} is ignored");
    }
}

/// Every command and flag that README and manual show, `lodestone` knows.
#[test]
fn the_manual_shows_commands_that_exist() {
    let manual = read("README.md") + &read("docs/manual.md");
    let mut seen = 0;
    for line in manual.lines() {
        // Lines of code, and code within lines.
        let pieces: Vec<&str> = if line.starts_with("lodestone ") {
            vec![line]
        } else {
            line.split('`').skip(1).step_by(2).filter(|piece| piece.starts_with("lodestone ")).collect()
        };
        for piece in pieces {
            let mut words = piece.split_whitespace().skip(1);
            let command = words.next().unwrap();
            // What `jobs` is to do has a help of its own.
            let of_jobs = words
                .clone()
                .next()
                .filter(|word| command == "jobs" && word.bytes().all(|b| b.is_ascii_lowercase()));
            let output = Command::new(env!("CARGO_BIN_EXE_lodestone"))
                .arg(command)
                .args(of_jobs)
                .arg("--help")
                .output()
                .unwrap();
            let help = String::from_utf8(output.stdout).unwrap();
            assert!(output.status.success(), "manual: {piece}");
            for flag in words.map(|word| word.trim_matches(['[', ']'])).filter(|word| word.starts_with('-')) {
                assert!(help.contains(flag), "manual: {piece}: no {flag}");
            }
            seen += 1;
        }
    }
    assert!(seen >= 20, "only {seen} commands found");
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
