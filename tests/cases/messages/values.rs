//! Values as people write them: in flags, the environment and files.

use std::fs;

use super::{command, lodestone, stderr, stdout, text};
use crate::daemon_support::las;

/// What `serve` would run with.
fn config(arguments: &[&str], variables: &[(&str, &str)]) -> String {
    let run =
        command(&[&["config"], arguments].concat()).envs(variables.iter().copied()).output().expect("run");
    assert!(run.status.success(), "{variables:?}: {}", stderr(&run));
    stdout(&run)
}

#[test]
fn flags_and_variables_take_any_letter_case() {
    let told = config(&["--sampling", "Random", "--on-done", "MOVE", "--preview-color", "Height"], &[]);
    for line in ["sampling = \"random\"", "on_done = \"move\"", "preview_color = \"height\""] {
        assert!(told.contains(line), "{line} is missing in {told}");
    }
    let variables = [
        ("LODESTONE_ENCODING", "Brotli"),
        ("LODESTONE_OUTLIERS", "SET-ASIDE"),
        ("LODESTONE_LOG_FORMAT", "Plain"),
    ];
    let told = config(&[], &variables);
    for line in ["encoding = \"BROTLI\"", "outliers = \"set-aside\"", "log_format = \"plain\""] {
        assert!(told.contains(line), "{line} is missing in {told}");
    }
    let root = tempfile::tempdir().expect("a folder");
    let made = lodestone(&["synth", "Terrain", "-o", text(&root.path().join("a.las")), "--points", "100"]);
    assert!(made.status.success(), "{}", stderr(&made));
    let (input, octree) = (root.path().join("a.las"), root.path().join("o"));
    let line = ["convert", text(&input), "-o", text(&octree), "--encoding", "BROTLI"];
    assert!(lodestone(&line).status.success());
    assert!(lodestone(&["verify", text(&octree), "--spacing", "Report"]).status.success());
}

#[test]
fn yes_and_no_are_taken_as_people_write_them() {
    for (word, preview) in [
        ("yes", true),
        ("No", false),
        ("ON", true),
        ("off", false),
        ("1", true),
        ("0", false),
        ("TRUE", true),
        ("False", false),
    ] {
        let line = format!("preview = {preview}");
        assert!(config(&[], &[("LODESTONE_PREVIEW", word)]).contains(&line), "{word}");
        assert!(config(&["--preview", word], &[]).contains(&line), "{word}");
        let root = tempfile::tempdir().expect("a folder");
        let file = root.path().join("lodestone.toml");
        fs::write(&file, format!("preview = \"{word}\"\n")).expect("written");
        assert!(config(&["--config", text(&file)], &[]).contains(&line), "{word}");
    }
    let open = config(&["--listen", "0.0.0.0:7700"], &[("LODESTONE_OPEN_TO_NETWORK", "Yes")]);
    assert!(open.contains("open_to_network = true"), "{open}");
    // A flag alone still means yes.
    assert!(
        config(&["--listen", "0.0.0.0:7700", "--open-to-network"], &[]).contains("open_to_network = true")
    );
    let wrong = command(&["config"]).env("LODESTONE_PREVIEW", "perhaps").output().expect("run");
    assert_eq!(wrong.status.code(), Some(2));
    assert!(stderr(&wrong).contains("perhaps") && stderr(&wrong).contains("yes or no"), "{}", stderr(&wrong));
}

#[test]
fn a_variable_holds_several_folders_to_watch() {
    let told = config(&[], &[("LODESTONE_WATCH", "/srv/a:/srv/b c")]);
    assert!(told.contains(r#"watch = ["/srv/a", "/srv/b c"]"#), "{told}");
    let root = tempfile::tempdir().expect("a folder");
    let odd = root.path().join("a:b");
    fs::create_dir(&odd).expect("made");
    assert!(config(&[], &[("LODESTONE_WATCH", text(&odd))]).contains("a:b\"]"));
    // A flag names one folder, whatever is in its name.
    let told = config(&["--watch", "/srv/x:y", "--watch", "/srv/z"], &[("LODESTONE_WATCH", "/no:/no")]);
    assert!(told.contains(r#"watch = ["/srv/x:y", "/srv/z"]"#), "{told}");
}

#[test]
fn the_log_is_chosen_in_the_file_too() {
    let root = tempfile::tempdir().expect("a folder");
    let file = root.path().join("lodestone.toml");
    fs::write(&file, "log = \"Debug\"\nlog_format = \"JSON\"\nsampling = \"RANDOM\"\n").expect("written");
    let told = config(&["--config", text(&file)], &[]);
    for line in ["log = \"Debug\"", "log_format = \"json\"", "sampling = \"random\""] {
        assert!(told.contains(line), "{line} is missing in {told}");
    }
    // A flag or a variable is nearer than the file.
    assert!(config(&["--config", text(&file), "--log", "warn"], &[]).contains("log = \"warn\""));
    assert!(config(&["--config", text(&file)], &[("LODESTONE_LOG", "error")]).contains("log = \"error\""));
    // It holds for the daemon: lines of JSON on stderr.
    let inbox = root.path().join("data");
    let mut child =
        command(&["serve", "--listen", "127.0.0.1:0", "--root", text(&inbox), "--config", text(&file)])
            .stdout(std::process::Stdio::piped())
            .stderr(std::process::Stdio::piped())
            .spawn()
            .expect("started");
    let mut line = String::new();
    let mut stdout = std::io::BufReader::new(child.stdout.take().expect("piped"));
    while !line.contains("http://") && std::io::BufRead::read_line(&mut stdout, &mut line).expect("read") > 0
    {
    }
    rustix::process::kill_process(rustix::process::Pid::from_child(&child), rustix::process::Signal::TERM)
        .expect("sent");
    let run = child.wait_with_output().expect("gone");
    let log = stderr(&run);
    assert!(!log.is_empty() && log.lines().all(|line| line.starts_with('{')), "{log}");
}

#[test]
fn a_word_that_is_no_level_is_told() {
    let root = tempfile::tempdir().expect("a folder");
    let input = root.path().join("a.las");
    fs::write(&input, las(10, 1)).expect("written");
    let run = lodestone(&["--log", "verbose", "info", text(&input)]);
    assert!(run.status.success());
    assert!(stderr(&run).contains("`verbose`") && stderr(&run).contains("debug"), "{}", stderr(&run));
}
