//! Pictures of what was published, by the real daemon: made, served, made again
//! after a crash and for new content, and never in a job's way.

use std::fs;
use std::process::Command;

use crate::daemon_support::{Daemon, ask, content, converted, las, wait_for};
use serde_json::Value;

const PREVIEWS: &[&str] = &["--preview", "true", "--preview-frames", "3"];
/// So many that a kill finds it at work.
const SLOW: &[&str] = &["--preview", "true", "--preview-frames", "720", "--shutdown-seconds", "30"];
const NONE: &[&str] = &["--preview", "false"];

fn root() -> tempfile::TempDir {
    tempfile::tempdir().expect("a folder")
}

/// Waits until the pictures of the job that stands for `name` are in this state.
fn wait_preview(daemon: &Daemon, name: &str, state: &str) -> Value {
    wait_for(&format!("the preview of {name} to be {state}"), || {
        daemon.jobs().into_iter().rev().find(|job| job["name"] == name && job["preview"]["state"] == state)
    })
}

/// The address of the picture that is called so.
fn url(job: &Value, file: &str) -> String {
    let assets = job["preview"]["assets"].as_array().expect("assets");
    let urls = assets.iter().map(|asset| asset["url"].as_str().expect("an address").to_string());
    urls.into_iter()
        .find(|url| url.contains(&format!("/{file}?")))
        .unwrap_or_else(|| panic!("no {file}: {job}"))
}

fn get(daemon: &Daemon, path: &str, more: &str) -> (u16, String, Vec<u8>) {
    let (status, head, body) = ask(&daemon.address, &format!("GET {path}{more}"), "");
    (status, head.to_lowercase(), body)
}

fn header(head: &str, name: &str) -> String {
    let line = head.lines().find_map(|line| line.strip_prefix(&format!("{name}: ")));
    line.unwrap_or_else(|| panic!("no {name} in {head}")).to_string()
}

fn drop_cloud(daemon: &Daemon, name: &str, points: u32, seed: u64) {
    fs::write(daemon.inbox().join(format!("{name}.las")), las(points, seed)).expect("dropped");
}

/// Waits until nothing half-made is left; the end is recorded before.
fn wait_cleared(daemon: &Daemon) {
    let folder = daemon.root.join("octrees/.previews");
    wait_for("what was on its way to be cleared", || {
        fs::read_dir(&folder).into_iter().flatten().next().is_none().then_some(())
    });
}

/// An octree without its pictures.
fn octree(daemon: &Daemon, name: &str) -> std::collections::BTreeMap<std::path::PathBuf, Vec<u8>> {
    let mut files = content(&daemon.octree(name));
    files.retain(|path, _| !path.starts_with("preview"));
    files
}

#[test]
fn pictures_appear_beside_the_octree_and_are_served() {
    let root = root();
    let mut daemon = Daemon::start_with(&root.path().join("data"), PREVIEWS);
    drop_cloud(&daemon, "größe 1", 30_000, 1);
    let job = wait_preview(&daemon, "größe 1", "done");
    assert_eq!((&job["state"], &job["preview"]["error"]), (&"done".into(), &Value::Null));
    let assets = job["preview"]["assets"].as_array().expect("assets").clone();
    let role = |role: &str| assets.iter().filter(|asset| asset["roles"][0] == role).count();
    assert!(role("thumbnail") >= 1 && role("overview") >= 1, "{job}");
    for (file, kind, magic) in [
        ("thumbnail.png", "image/png", &b"\x89PNG"[..]),
        ("overview.png", "image/png", b"\x89PNG"),
        ("turntable.webp", "image/webp", b"RIFF"),
    ] {
        let url = url(&job, file);
        assert!(url.starts_with("/octrees/gr%C3%B6%C3%9Fe%201/preview/"), "{url}");
        let (status, head, body) = get(&daemon, &url, "");
        assert_eq!((status, header(&head, "content-type").as_str()), (200, kind), "{url}");
        assert!(body.starts_with(magic), "{url}");
        assert!(header(&head, "cache-control").contains("immutable"), "{head}");
        let asset = assets.iter().find(|asset| asset["url"] == url.as_str()).expect("listed");
        assert_eq!(asset["type"], kind);

        // Without the stamp it is asked for again each time, and answered in few words.
        let plain = url.split('?').next().expect("a path");
        let (_, head, again) = get(&daemon, plain, "");
        assert_eq!((header(&head, "cache-control").as_str(), again), ("private, no-cache", body));
        let tag = header(&head, "etag");
        let (status, head, body) = get(&daemon, plain, &format!("\nIf-None-Match: {tag}"));
        assert_eq!((status, header(&head, "etag"), body.len()), (304, tag.clone(), 0));
        let (status, head, body) = ask(&daemon.address, &format!("HEAD {plain}"), "");
        assert_eq!((status, header(&head.to_lowercase(), "etag"), body.len()), (200, tag, 0));
    }
    assert_eq!(get(&daemon, "/octrees/.previews/1/thumbnail.png", "").0, 404);

    // The octree is what it is without pictures, and stands up to its verifier.
    let source = daemon.inbox().join("größe 1.las");
    assert_eq!(octree(&daemon, "größe 1"), converted(&[&source], &root.path().join("größe 1")));
    let verify = Command::new(env!("CARGO_BIN_EXE_lodestone"))
        .arg("verify")
        .arg(daemon.octree("größe 1"))
        .arg("--against")
        .arg(&source)
        .output()
        .expect("run");
    assert!(verify.status.success(), "{}", String::from_utf8_lossy(&verify.stdout));

    let page = daemon.get("/").1;
    let icon = url(&job, "icon.png");
    assert!(page.contains(&format!("<img src=\"{icon}\" data-turning=\"")), "{page}");
    assert!(page.contains("alt=\"Picture of größe 1\""), "{page}");
    daemon.wait_metrics(&[
        "lodestone_previews_total{outcome=\"done\"} 1",
        "lodestone_preview_seconds_count 1",
        "lodestone_previews_waiting 0",
    ]);
    let history = daemon.json(&format!("/api/jobs/{}", job["id"]))["history"].to_string();
    assert!(history.contains("\"preview\""), "{history}");
    wait_cleared(&daemon);
    assert!(daemon.stop());
}

#[test]
fn switched_off_there_are_none_and_switched_on_they_are_made_up_for() {
    let root = root();
    let data = root.path().join("data");
    let mut daemon = Daemon::start_with(&data, NONE);
    for (name, seed) in [("a", 1), ("b", 2)] {
        drop_cloud(&daemon, name, 2_000, seed);
        let job = daemon.wait(name, "done");
        assert_eq!(job["preview"], Value::Null);
    }
    let (status, answer) = daemon.post("/api/jobs/1/preview", "");
    assert_eq!(status, 409);
    assert!(answer.contains("preview = false"), "{answer}");
    assert!(!daemon.octree("a").join("preview").exists());
    assert!(!daemon.get("/").1.contains("alt=\"Picture of"));
    // Killed between the end of the job and its pictures, they are still owed.
    daemon.kill();
    let daemon = Daemon::start_with(&data, PREVIEWS);
    for name in ["a", "b"] {
        let job = wait_preview(&daemon, name, "done");
        assert_eq!((job["attempts"].as_u64(), job["preview"]["attempts"].as_u64()), (Some(1), Some(1)));
        assert!(daemon.octree(name).join("preview/thumbnail.png").exists());
    }
}

#[test]
fn killed_or_stopped_over_its_pictures_it_makes_them_again_and_leaves_the_job_alone() {
    let root = root();
    let data = root.path().join("data");
    let mut daemon = Daemon::start_with(&data, SLOW);
    drop_cloud(&daemon, "a", 50_000, 1);
    let at_work = |daemon: &Daemon| {
        wait_for("a picture on its way", || {
            daemon.root.join("octrees/.previews/1/overview.png").exists().then_some(())
        });
        assert!(!daemon.octree("a").join("preview").exists(), "half-made, it is nowhere to be seen");
        daemon.wait("a", "done")
    };
    let job = at_work(&daemon);
    let before = octree(&daemon, "a");
    daemon.kill();
    let mut daemon = Daemon::start_with(&data, SLOW);
    wait_for("the second attempt", || (daemon.jobs()[0]["preview"]["attempts"] == 2).then_some(()));
    at_work(&daemon);
    // In good order it stops at once, and the attempt does not count.
    assert!(daemon.stop());
    let daemon = Daemon::start_with(&data, PREVIEWS);
    let after = wait_preview(&daemon, "a", "done");
    assert_eq!(after["preview"]["attempts"], 2);
    for key in ["attempts", "strikes", "finished_at", "result"] {
        assert_eq!(after[key], job[key], "{key}");
    }
    assert_eq!(octree(&daemon, "a"), before);
    wait_cleared(&daemon);
}

#[test]
fn what_cannot_be_drawn_is_tried_a_few_times_given_up_and_drawn_on_request() {
    let root = root();
    let data = root.path().join("data");
    let mut daemon = Daemon::start_with(&data, NONE);
    drop_cloud(&daemon, "a", 2_000, 1);
    daemon.wait("a", "done");
    assert!(daemon.stop());
    let in_the_way = data.join("octrees/a/preview");
    fs::write(&in_the_way, "somebody's").expect("written");
    let daemon = Daemon::start_with(&data, PREVIEWS);
    let job = wait_preview(&daemon, "a", "failed");
    assert_eq!((&job["state"], job["preview"]["attempts"].as_u64()), (&"done".into(), Some(3)));
    let error = job["preview"]["error"].as_str().expect("an error");
    assert!(error.contains("octrees/a/preview"), "{error}");
    assert_eq!(fs::read_to_string(&in_the_way).expect("there"), "somebody's");
    daemon.wait_metrics(&[
        "lodestone_previews_total{outcome=\"postponed\"} 2",
        "lodestone_previews_total{outcome=\"failed\"} 1",
    ]);
    // Others have theirs.
    drop_cloud(&daemon, "b", 2_000, 2);
    wait_preview(&daemon, "b", "done");

    fs::remove_file(&in_the_way).expect("removed");
    assert_eq!(daemon.post("/api/jobs/1/preview", "").0, 202);
    let job = wait_preview(&daemon, "a", "done");
    assert_eq!(get(&daemon, &url(&job, "thumbnail.png"), "").0, 200);
    // By the command line as well, and then under a new address.
    let order = Command::new(env!("CARGO_BIN_EXE_lodestone"))
        .args(["jobs", "preview", "1", "--root"])
        .arg(&data)
        .output()
        .expect("run");
    assert!(order.status.success(), "{}", String::from_utf8_lossy(&order.stderr));
    wait_for("new pictures", || {
        let now = wait_preview(&daemon, "a", "done");
        (url(&now, "thumbnail.png") != url(&job, "thumbnail.png")).then_some(())
    });
    assert_eq!(daemon.post("/api/jobs/77/preview", "").0, 404);
}

#[test]
fn new_content_has_new_pictures_and_never_those_of_the_old() {
    let root = root();
    let daemon = Daemon::start_with(&root.path().join("data"), PREVIEWS);
    drop_cloud(&daemon, "a", 2_000, 1);
    let old = wait_preview(&daemon, "a", "done");
    let path = url(&old, "thumbnail.png");
    let plain = path.split('?').next().expect("a path").to_string();
    let (_, head, picture) = get(&daemon, &plain, "");
    let tag = header(&head, "etag");
    let before = fs::read_to_string(daemon.octree("a").join("metadata.json")).expect("there");
    drop_cloud(&daemon, "a", 40_000, 2);
    let new = wait_for("new pictures", || {
        // At no moment has the new octree the old one's pictures.
        let metadata = fs::read_to_string(daemon.octree("a").join("metadata.json"));
        let shown = fs::read(daemon.octree("a").join("preview/thumbnail.png"));
        let still_old = fs::read_to_string(daemon.octree("a").join("metadata.json"));
        if let (Ok(metadata), Ok(shown), Ok(still)) = (metadata, shown, still_old)
            && metadata == still
        {
            assert_eq!(metadata != before, shown != picture, "{metadata}");
        }
        daemon.jobs().into_iter().find(|job| job["revision"] == 2 && job["preview"]["state"] == "done")
    });
    assert_eq!(daemon.jobs()[0]["preview"], Value::Null, "what was replaced shows nothing");
    assert_ne!(url(&new, "thumbnail.png"), path);
    let (status, _, shown) = get(&daemon, &plain, &format!("\nIf-None-Match: {tag}"));
    assert_eq!(status, 200, "the old one's tag is not the new one's");
    assert!(shown != picture);
    assert_eq!(daemon.post("/api/jobs/1/preview", "").0, 409);

    // An octree that somebody took away is none to draw, and no trouble.
    fs::remove_dir_all(daemon.octree("a")).expect("removed");
    assert_eq!(daemon.post("/api/jobs/2/preview", "").0, 202);
    wait_for("the debt to be dropped", || (daemon.jobs()[1]["preview"] == Value::Null).then_some(()));
    assert!(!daemon.octree("a").exists());
    assert_eq!(daemon.jobs()[1]["state"], "done");
}

/// Killed at any moment around publishing, the end is the same.
#[test]
fn a_crash_between_publishing_and_pictures_is_made_good_at_the_next_start() {
    let root = root();
    let data = root.path().join("data");
    let mut daemon = Daemon::start_with(&data, PREVIEWS);
    for round in 0..6u64 {
        let name = format!("n{round}");
        drop_cloud(&daemon, &name, 1_000, round);
        wait_for("the octree", || daemon.octree(&name).exists().then_some(()));
        if round % 2 == 1 {
            wait_for("its picture", || {
                let done = daemon.octree(&name).join("preview/preview.json").exists();
                let begun = data.join(format!("octrees/.previews/{}/thumbnail.png", round + 1)).exists();
                (done || begun).then_some(())
            });
        }
        daemon.kill();
        daemon = Daemon::start_with(&data, PREVIEWS);
        let job = wait_preview(&daemon, &name, "done");
        assert_eq!(job["attempts"], 1, "converted once");
        assert!(daemon.octree(&name).join("preview/turntable.webp").exists());
    }
}
