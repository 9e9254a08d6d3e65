//! What `deploy/` ships: the unit's filter of system calls, the first process of a
//! container, the alerts.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};

use rustix::process::{Pid, Signal, kill_process};
use seccompiler::{BpfProgram, TargetArch, apply_filter, compile_from_json};

use crate::daemon_support::{Daemon, las, wait_for};

fn deployed(name: &str) -> String {
    fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("deploy").join(name)).expect("deployed")
}

/// Whether a tool is there; its absence is a failure where `variable` is 1.
fn is_there(tool: &str, variable: &str) -> bool {
    let there = Command::new(tool).arg("--version").output().is_ok();
    let required = std::env::var(variable).is_ok_and(|value| value == "1");
    assert!(there || !required, "{variable}=1, but there is no {tool}");
    if !there {
        eprintln!("skipped: no {tool}");
    }
    there
}

/// The groups of system calls as systemd has them.
fn groups() -> BTreeMap<String, Vec<String>> {
    let output = Command::new("systemd-analyze").arg("syscall-filter").output().expect("systemd-analyze");
    let mut groups: BTreeMap<String, Vec<String>> = BTreeMap::new();
    let mut group = String::new();
    for line in String::from_utf8_lossy(&output.stdout).lines() {
        match line.trim() {
            "" => group.clear(),
            word if word.starts_with('#') => {}
            word if !line.starts_with(' ') => group = word.to_string(),
            word if !group.is_empty() => groups.entry(group.clone()).or_default().push(word.to_string()),
            _ => {}
        }
    }
    groups
}

fn expand(word: &str, groups: &BTreeMap<String, Vec<String>>, to: &mut BTreeSet<String>) {
    match groups.get(word) {
        Some(words) => words.iter().for_each(|word| expand(word, groups, to)),
        None => {
            assert!(!word.starts_with('@'), "systemd knows no {word}");
            to.insert(word.to_string());
        }
    }
}

/// The system calls that the unit allows, as systemd reads its lines.
fn allowed(unit: &str) -> BTreeSet<String> {
    let groups = groups();
    let mut allowed = BTreeSet::new();
    // What every service may do, whatever its filter says.
    expand("@default", &groups, &mut allowed);
    for line in unit.lines().filter_map(|line| line.strip_prefix("SystemCallFilter=")) {
        let mut words = BTreeSet::new();
        let (line, denies) = line.strip_prefix('~').map_or((line, false), |line| (line, true));
        line.split_whitespace().for_each(|word| expand(word, &groups, &mut words));
        if denies {
            allowed.retain(|call| !words.contains(call));
        } else {
            allowed.extend(words);
        }
    }
    allowed
}

fn compile(calls: &[&str]) -> Option<BpfProgram> {
    let filter: Vec<_> = calls.iter().map(|call| serde_json::json!({ "syscall": call })).collect();
    // EPERM is 1.
    let filter = serde_json::json!({ "all": {
        "mismatch_action": { "errno": 1 }, "match_action": "allow", "filter": filter } });
    let arch = TargetArch::try_from(std::env::consts::ARCH).ok()?;
    compile_from_json(filter.to_string().as_bytes(), arch).ok()?.remove("all")
}

/// The daemon does all it does under exactly the unit's filter. A thread of the test
/// filters itself; what it starts inherits that.
#[test]
fn the_unit_s_filter_lets_everything_be_done() {
    if !is_there("systemd-analyze", "LODESTONE_REQUIRE_SYSTEMD") {
        return;
    }
    let unit = deployed("lodestone.service");
    assert!(unit.lines().any(|line| line == "SystemCallErrorNumber=EPERM"), "what is refused must not kill");
    let allowed = allowed(&unit);
    for call in ["setpriority", "openat2", "clone3", "read"] {
        assert!(allowed.contains(call), "{call}");
    }
    for call in ["chown", "setuid", "mount", "reboot", "ptrace", "setrlimit"] {
        assert!(!allowed.contains(call), "{call}");
    }
    // Names of other machines' calls mean nothing here.
    let here: Vec<&str> =
        allowed.iter().map(String::as_str).filter(|call| compile(&[call]).is_some()).collect();
    assert!(here.len() > 200, "{}", here.len());
    let program = compile(&here).expect("a filter");
    std::thread::spawn(move || {
        apply_filter(&program).expect("filtered");
        under_the_filter();
    })
    .join()
    .expect("the daemon under the filter");
}

fn under_the_filter() {
    let refused = Command::new("chown").args(["1", "/proc/self/comm"]).output().expect("chown");
    assert!(!refused.status.success(), "there is no filter");
    let root = tempfile::tempdir().expect("a folder");
    let told = root.path().join("told");
    let hook = serde_json::json!([
        "sh",
        "-c",
        format!("nice -n 1 true && echo $LODESTONE_NAME >>{}", told.display())
    ]);
    let args = [
        "--preview",
        "true",
        "--preview-frames",
        "2",
        "--hook-done",
        &hook.to_string(),
        "--memory-limit",
        "256M",
    ];
    let mut daemon = Daemon::start_with(&root.path().join("data"), &args);
    let clouds = ["a", "b", "c", "d", "e"];
    for (seed, name) in clouds.iter().enumerate() {
        fs::write(daemon.inbox().join(format!("{name}.las")), las(20_000, seed as u64)).expect("dropped");
    }
    for name in clouds {
        daemon.wait(name, "done");
        let job = wait_for("its pictures", || {
            let job = daemon.jobs().into_iter().find(|job| job["name"] == name)?;
            ["done", "failed"].map(Into::into).contains(&job["preview"]["state"]).then_some(job)
        });
        assert_eq!((&job["preview"]["state"], &job["attempts"]), (&"done".into(), &1.into()), "{job}");
    }
    wait_for("all hooks", || (fs::read_to_string(&told).ok()?.lines().count() == clouds.len()).then_some(()));
    daemon.wait_metrics(&[
        "lodestone_hooks_total{result=\"ok\"} 5",
        "lodestone_previews_total{outcome=\"done\"} 5",
    ]);
    // With whatever GPU there is, or none: it says so, and is not killed.
    let drawn = Command::new(env!("CARGO_BIN_EXE_lodestone"))
        .args(["preview", "--renderer", "gpu", "--frames", "0", "-o"])
        .arg(root.path().join("drawn"))
        .arg(daemon.octree("a"))
        .output()
        .expect("started");
    assert!(drawn.status.code().is_some(), "{:?}: {}", drawn.status, String::from_utf8_lossy(&drawn.stderr));
    // New content, again and again.
    for seed in 10..15 {
        fs::write(daemon.inbox().join("a.las"), las(10_000, seed)).expect("dropped");
        let revision = seed as i64 - 8;
        wait_for("the next octree", || {
            daemon.jobs().into_iter().find(|job| job["revision"] == revision && job["state"] == "done")
        });
    }
    assert_eq!(daemon.get("/healthz").0, 200);
    assert!(daemon.stop(), "{}", daemon.log());
}

/// Processes without their end looked at: those are zombies.
fn children_of(parent: u32) -> Vec<(u32, String, char)> {
    let mut found = Vec::new();
    for entry in fs::read_dir("/proc").expect("/proc").flatten() {
        let Some(pid) = entry.file_name().to_str().and_then(|name| name.parse::<u32>().ok()) else {
            continue;
        };
        let Ok(stat) = fs::read_to_string(entry.path().join("stat")) else { continue };
        let Some((head, rest)) = stat.rsplit_once(')') else { continue };
        let name = head.split_once('(').map_or("", |(_, name)| name).to_string();
        let mut fields = rest.split_whitespace();
        let state = fields.next().and_then(|state| state.chars().next()).unwrap_or('?');
        if fields.next() == Some(parent.to_string().as_str()) {
            found.push((pid, name, state));
        }
    }
    found
}

#[test]
fn as_first_process_it_reaps_what_hooks_leave() {
    let unshare = ["unshare", "--pid", "--fork", "--mount-proc", "--kill-child"];
    if !Command::new(unshare[0]).args(&unshare[1..]).arg("true").output().is_ok_and(|o| o.status.success()) {
        let required = std::env::var("LODESTONE_SMALL_DISKS").is_ok_and(|value| value == "1");
        assert!(!required, "unshare cannot make a namespace of processes here");
        eprintln!("skipped: unshare cannot make a namespace of processes here");
        return;
    }
    let root = tempfile::tempdir().expect("a folder");
    let told = root.path().join("told");
    // It leaves three that end after it.
    let orphans = format!("for i in 1 2 3; do setsid sh -c 'sleep 0.3; echo >>{}' & done", told.display());
    let hook = serde_json::json!(["sh", "-c", orphans]).to_string();
    let mut daemon = Daemon::start_by(&unshare, &root.path().join("data"), &["--hook-done", &hook], &[]);
    let first = children_of(daemon.child.id()).first().expect("the first process").0;
    let worker = wait_for("the daemon itself", || Some(children_of(first).first()?.0));
    for (seed, name) in ["a", "b"].iter().enumerate() {
        fs::write(daemon.inbox().join(format!("{name}.las")), las(1_000, seed as u64)).expect("dropped");
        daemon.wait(name, "done");
    }
    wait_for("the orphans", || (fs::read_to_string(&told).ok()?.lines().count() == 6).then_some(()));
    wait_for("none to be left", || (children_of(first).iter().all(|(pid, ..)| *pid == worker)).then_some(()));
    // SIGHUP ends it in good order, as SIGTERM does.
    let first = Pid::from_raw(first as i32).expect("a process");
    kill_process(first, Signal::HUP).expect("sent");
    assert!(daemon.child.wait().expect("gone").success(), "{}", daemon.log());
    assert!(daemon.log().contains("stopped"), "{}", daemon.log());
}

#[test]
fn a_hang_up_stops_in_good_order_unless_ignored() {
    let root = tempfile::tempdir().expect("a folder");
    // Whoever runs the tests may ignore it, as by `nohup`.
    let default = ["env", "--default-signal=HUP"];
    let mut daemon = Daemon::start_by(&default, &root.path().join("a"), &[], &[]);
    let pid = Pid::from_child(&daemon.child);
    kill_process(pid, Signal::HUP).expect("sent");
    assert!(daemon.child.wait().expect("gone").success());
    // `nohup` is a word that counts.
    let mut daemon = Daemon::start_by(&["nohup"], &root.path().join("b"), &[], &[]);
    let pid = Pid::from_child(&daemon.child);
    kill_process(pid, Signal::HUP).expect("sent");
    assert_eq!(daemon.get("/healthz").0, 200);
    assert!(daemon.stop());
}

#[test]
fn the_banner_names_an_address_that_opens() {
    let root = tempfile::tempdir().expect("a folder");
    // As in the container.
    let mut child = Command::new(env!("CARGO_BIN_EXE_lodestone"))
        .args(["serve", "--listen", "0.0.0.0:0", "--token", "correct-horse-battery", "--root"])
        .arg(root.path().join("data"))
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .expect("started");
    let stdout = BufReader::new(child.stdout.take().expect("piped"));
    let mut lines = stdout.lines().map_while(Result::ok);
    let address =
        lines.find_map(|line| Some(line.split_once("http://")?.1.trim_end_matches('/').to_string()));
    let address = address.expect("an address");
    assert!(address.starts_with("localhost:"), "{address}");
    let at = address.replace("localhost", "127.0.0.1");
    let (status, _, page) =
        crate::daemon_support::ask(&at, &format!("GET /login\nHost: {address}\nAccept: text/html"), "");
    let _ = child.kill();
    let _ = child.wait();
    assert_eq!(status, 200);
    assert!(String::from_utf8_lossy(&page).contains("name=\"token\""));
}

/// Each alert has a case in which it fires and one in which it does not;
/// `promtool test rules` holds the rules to them.
#[test]
fn every_alert_is_tried_firing_and_quiet() {
    let (rules, cases) = (deployed("alerts.yml"), deployed("alerts.test.yml"));
    let mut names = BTreeSet::new();
    for name in rules.lines().filter_map(|line| line.trim().strip_prefix("- alert: ")) {
        names.insert(name);
        let tried: Vec<&str> = cases.split(&format!("alertname: {name}\n")).skip(1).collect();
        let quiet = tried.iter().filter(|case| case.trim_start().starts_with("exp_alerts: []")).count();
        assert!(quiet >= 1 && tried.len() > quiet, "{name}: {quiet} quiet of {}", tried.len());
    }
    for name in ["LodestoneJobsFail", "LodestoneRestarts", "LodestoneQuarantine", "LodestoneStuck"] {
        assert!(names.contains(name), "{name}");
    }
    if !is_there("promtool", "LODESTONE_PROMETHEUS") {
        return;
    }
    let cases = Path::new(env!("CARGO_MANIFEST_DIR")).join("deploy/alerts.test.yml");
    let output = Command::new("promtool").args(["test", "rules"]).arg(cases).output().expect("promtool");
    let said =
        String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");
}

/// While a conversion is at work, the series say how far it is.
#[test]
fn a_running_conversion_shows_in_the_metrics() {
    let root = tempfile::tempdir().expect("a folder");
    let args = ["--threads", "1", "--encoding", "brotli"];
    let daemon = Daemon::start_with(&root.path().join("data"), &args);
    let idle = daemon.get("/metrics").1;
    assert!(idle.contains("lodestone_running_jobs{stage=\"survey\"} 0"), "{idle}");
    fs::write(daemon.inbox().join("a.las"), las(1_000_000, 1)).expect("dropped");
    wait_for("points on their way", || {
        let shown = daemon.get("/metrics").1;
        let value = |name: &str| -> f64 {
            let lines = shown.lines().filter(|line| line.starts_with(&format!("{name}{{")));
            lines.filter_map(|line| line.rsplit(' ').next()?.parse::<f64>().ok()).sum()
        };
        let (all, done) = (value("lodestone_running_points"), value("lodestone_running_points_done"));
        (value("lodestone_running_jobs") == 1.0 && all >= 1_000_000.0 && done > 0.0 && done <= all)
            .then_some(())
    });
    daemon.wait("a", "done");
    let idle = daemon.get("/metrics").1;
    assert!(idle.contains("lodestone_running_points{stage=\"index\"} 0"), "{idle}");
}
