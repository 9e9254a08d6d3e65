//! `lodestone report`, with scenes so small that it takes seconds.

use std::fs;
use std::io::Read;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};

#[test]
fn the_stability_table_has_a_row_for_each_scene_and_sampler_and_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    fs::create_dir(at("temp")).unwrap();
    let run = Command::new(env!("CARGO_BIN_EXE_lodestone"))
        .args(["report", "--stability", "--points", "20k", "--rounds", "1", "--scenes", "terrain,dot,strips"])
        .arg("--temp-dir")
        .arg(at("temp"))
        .arg("-o")
        .arg(at("table.md"))
        .arg("--json")
        .arg(at("table.json"))
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&run.stderr);
    assert_eq!(run.status.code(), Some(0), "{said}");
    assert_eq!(fs::read_dir(at("temp")).unwrap().count(), 0, "temporary files stay");

    let table: serde_json::Value = serde_json::from_slice(&fs::read(at("table.json")).unwrap()).unwrap();
    let rows = table["rows"].as_array().unwrap();
    let named: Vec<String> = rows.iter().map(|row| format!("{} {}", row["scene"], row["sampling"])).collect();
    let expected = ["terrain", "dot", "strips"]
        .map(|scene| ["poisson", "random"].map(|sampling| format!("\"{scene}\" \"{sampling}\"")))
        .concat();
    assert_eq!(named, expected);
    for row in rows {
        assert_eq!((&row["outcome"], &row["exact"]), (&"done".into(), &true.into()), "{row}");
        assert!(
            row["seconds_times"].as_f64().unwrap() > 0.0 && row["peak_bytes"].as_u64().unwrap() > 1 << 20
        );
        let points = row["largest_node"].as_u64().unwrap();
        assert!(points > 0 && points <= 20_000, "{row}");
    }
    assert_eq!(rows[2]["set_aside"]["duplicate"], 10_000);
    assert_eq!(rows[0]["set_aside"].as_object().unwrap().len(), 0);
    assert_eq!((&rows[2]["depth"], &rows[2]["depth_asked"]), (&0.into(), &0.into()));

    let printed = String::from_utf8_lossy(&run.stdout);
    assert_eq!(printed.lines().count(), rows.len(), "{printed}");
    let page = fs::read_to_string(at("table.md")).unwrap();
    assert!(
        page.contains("| dot | 20 000 | poisson | exact |") && page.contains("10 000 duplicates"),
        "{page}"
    );
}

/// Clouds of gigabytes must not stay behind when somebody has waited enough.
#[test]
fn stopped_by_a_signal_it_leaves_nothing_behind() {
    let folder = tempfile::tempdir().unwrap();
    let temp = folder.path().join("temp");
    fs::create_dir(&temp).unwrap();
    let mut report = Command::new(env!("CARGO_BIN_EXE_lodestone"))
        .args(["report", "--stability", "--points", "300k", "--rounds", "99", "--scenes", "terrain"])
        .arg("--temp-dir")
        .arg(&temp)
        .stderr(Stdio::piped())
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    // Once it converts: an octree is in the making.
    let converts = || {
        let places = fs::read_dir(&temp).unwrap().flatten();
        places
            .flat_map(|place| fs::read_dir(place.path()))
            .flatten()
            .flatten()
            .any(|entry| entry.file_name().to_string_lossy().contains("octree"))
    };
    let start = Instant::now();
    while !converts() {
        assert!(start.elapsed() < Duration::from_secs(150), "it never converts");
        std::thread::sleep(Duration::from_millis(10));
    }
    kill_process(Pid::from_child(&report), Signal::TERM).unwrap();
    let mut said = String::new();
    report.stderr.take().unwrap().read_to_string(&mut said).unwrap();
    assert_eq!(report.wait().unwrap().code(), Some(1), "{said}");
    assert!(said.contains("stopped on request"), "{said}");
    assert_eq!(fs::read_dir(&temp).unwrap().count(), 0, "something stays behind");
}

/// Two runs over tiny clouds, the second beside the first: a page with all charts,
/// figures that can be read again, and nothing left behind.
#[test]
fn speed_against_accuracy_is_charted_and_held_against_an_earlier_run() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    fs::create_dir(at("temp")).unwrap();
    let own = at("own cloud.las");
    let report = |page: &str, more: &[&str]| {
        let run = Command::new(env!("CARGO_BIN_EXE_lodestone"))
            .args(["report", "--points", "40k", "--rounds", "1", "--scenes", "terrain"])
            .arg("--temp-dir")
            .arg(at("temp"))
            .arg("-o")
            .arg(at(page))
            .args(more)
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&run.stderr).into_owned();
        assert_eq!(run.status.code(), Some(0), "{said}");
        assert_eq!(fs::read_dir(at("temp")).unwrap().count(), 0, "temporary files stay");
        (fs::read_to_string(at(page)).unwrap(), String::from_utf8(run.stdout).unwrap())
    };
    let synth = ["synth", "object", "--points", "30k", "-o"];
    let made = Command::new(env!("CARGO_BIN_EXE_lodestone")).args(synth).arg(&own).status().unwrap();
    assert!(made.success());
    let (first, printed) = report("first.html", &[]);
    // A chart for the cloud, patterns, spectra, samplers, two of renderers.
    assert_eq!(first.matches("<svg").count(), 1 + 3 + 2);
    assert!(first.contains("terrain, 40 000 points") && !first.contains("NaN"), "{first}");
    assert!(printed.contains("holds") && printed.contains("first.json"), "{printed}");

    let figures: serde_json::Value = serde_json::from_slice(&fs::read(at("first.json")).unwrap()).unwrap();
    let scene = &figures["scenes"][0];
    let names: Vec<_> = scene["methods"].as_array().unwrap().iter().map(|method| &method["method"]).collect();
    assert_eq!(names[..2], ["poisson", "shells"]);
    for method in scene["methods"].as_array().unwrap() {
        assert!(
            method["wall"]["median"].as_f64().unwrap() > 0.0 && method["peak"].as_u64().unwrap() > 1 << 20
        );
        let pictures = method["pictures"].as_array().unwrap();
        // All points of a cloud so small are in every picture, whatever the method:
        // it is the same picture but for the size of a few splats, and for averaged
        // colours.
        let most = if method["method"].as_str().unwrap().contains("averaged") { 3.0 } else { 0.05 };
        assert!(pictures.len() == 2 * 4 && pictures.iter().all(|it| it["error"].as_f64().unwrap() <= most));
    }
    let best =
        scene["renderers"].as_array().unwrap().iter().find(|it| it["style"] == "high quality").unwrap();
    let last = best["pictures"].as_array().unwrap().iter().filter(|it| it["picture"]["budget"] == 1_500_000);
    assert!(
        last.into_iter().all(|it| it["picture"]["error"] == 0.0 && it["draw_ms"].as_f64().unwrap() > 0.0)
    );

    let (before, chart) = (at("first.json"), at("chart.svg"));
    let more =
        ["--against", before.to_str().unwrap(), "--chart", chart.to_str().unwrap(), own.to_str().unwrap()];
    let (second, _) = report("second.html", &more);
    assert_eq!(second.matches("<svg").count(), 2 + 3 + 2);
    assert!(second.contains("own cloud, 30 000 points") && !second.contains("NaN"), "{second}");
    assert!(second.contains("before") && second.contains("%"), "nothing of the first run");
    assert!(fs::read_to_string(chart).unwrap().contains("poisson"));

    for (page, charts) in [(&first, 6), (&second, 7)] {
        let Some(program) = super::browser::program() else { break };
        for dark in [false, true] {
            let seen = super::browser::look(program, page, 1000, dark);
            assert_eq!((&seen["faults"], &seen["drawings"]), (&serde_json::json!([]), &charts.into()));
        }
    }

    let again = Command::new(env!("CARGO_BIN_EXE_lodestone"))
        .args(["report", "--from", before.to_str().unwrap(), "-o"])
        .arg(at("again.html"))
        .status()
        .unwrap();
    assert!(again.success() && fs::read_to_string(at("again.html")).unwrap() == first);

    let refused = Command::new(env!("CARGO_BIN_EXE_lodestone"))
        .args(["report", "--against"])
        .arg(at("second.html"))
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&refused.stderr);
    assert!(refused.status.code() == Some(1) && said.contains("second.html: this is no report"), "{said}");
}
