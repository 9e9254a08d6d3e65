//! The viewer's addresses: who gets what, for how long, and what is refused.

use std::fs;

use serde_json::Value;

use crate::daemon_support::{Daemon, ask, las, wait_for};

const TOKEN: &str = "a long secret of the operator";

fn get(daemon: &Daemon, path: &str, more: &str) -> (u16, String, Vec<u8>) {
    let (status, head, body) = ask(&daemon.address, &format!("GET {path}\n{more}"), "");
    (status, head.to_lowercase(), body)
}

fn described(daemon: &Daemon, root: &str, more: &str) -> Value {
    let (status, _, body) = get(daemon, &format!("{root}/view?width=800&height=600"), more);
    assert_eq!(status, 200, "{}", String::from_utf8_lossy(&body));
    serde_json::from_slice(&body).expect("JSON")
}

#[test]
fn a_viewer_gets_the_octree_that_stands() {
    let root = tempfile::tempdir().expect("a folder");
    let daemon = Daemon::start(&root.path().join("data"));
    fs::write(daemon.inbox().join("a b.las"), las(3_000, 1)).expect("dropped");
    daemon.wait("a b", "done");
    let data = "/api/octrees/a%20b";
    let first = described(&daemon, data, "");
    assert_eq!((&first["points"], &first["name"]), (&3_000.into(), &"a b".into()));
    let revision = first["revision"].as_str().expect("text").to_string();
    let (status, head, page) = get(&daemon, &format!("{data}/pages/r?revision={revision}"), "");
    assert!(status == 200 && head.contains("immutable") && head.contains("private"), "{head}");
    let points = u32::from_le_bytes(page[2..6].try_into().expect("four"));
    let of_root = format!("{data}/nodes/r?revision={revision}&from=0");
    let (status, head, bytes) = get(&daemon, &format!("{of_root}&to={points}"), "");
    assert!(status == 200 && head.contains("immutable"), "{head}");
    assert_eq!(bytes.len(), 9 * points as usize);
    assert_eq!(get(&daemon, &format!("{of_root}&to=10&by=intensity&colors=true"), "").2.len(), 30);
    assert!(get(&daemon, &format!("{of_root}&to=4294967295"), "").2 == bytes, "no more than there are");
    let point = get(&daemon, &format!("{data}/nodes/r/points/0?revision={revision}"), "").2;
    let point: Value = serde_json::from_slice(&point).expect("JSON");
    assert!(point["position"][2].is_f64() && point["attributes"][0]["name"] == "intensity", "{point}");
    // A description is asked for again, and is told in a word that it is the same.
    let (_, head, _) = get(&daemon, &format!("{data}/view"), "");
    let tag = head.lines().find_map(|line| line.strip_prefix("etag: ")).expect("a tag").to_string();
    assert!(head.contains("no-cache"), "{head}");
    assert_eq!(get(&daemon, &format!("{data}/view"), &format!("If-None-Match: {tag}")).0, 304);
    for (path, status) in [
        (format!("{data}/pages/r?revision=other"), 410),
        (format!("{data}/nodes/r?revision=other&to=1"), 410),
        (format!("{data}/pages/r"), 400),
        (format!("{data}/pages/x?revision={revision}"), 400),
        (format!("{data}/pages/r77777777?revision={revision}"), 404),
        (format!("{data}/nodes/r{}?revision={revision}&to=1", "7".repeat(42)), 404),
        (format!("{data}/nodes/r{}?revision={revision}&to=1", "7".repeat(43)), 400),
        (format!("{data}/nodes/r?revision={revision}&to=-1"), 400),
        (format!("{data}/nodes/r?revision={revision}&to=1&by=nothing"), 404),
        (format!("{data}/nodes/r/points/999999999?revision={revision}"), 404),
        (format!("{data}/nodes/r/points/x?revision={revision}"), 400),
        ("/api/octrees/none/view".to_string(), 404),
        ("/api/octrees/..%2Finbox/view".to_string(), 404),
        ("/api/octrees/.previews/view".to_string(), 404),
        ("/view/none".to_string(), 404),
        ("/view/..%2F..".to_string(), 404),
        ("/view/a%20b".to_string(), 200),
    ] {
        let (got, _, body) = get(&daemon, &path, "");
        assert_eq!(got, status, "{path}: {}", String::from_utf8_lossy(&body));
    }
    // Another cloud of that name.
    fs::write(daemon.inbox().join("a b.las"), las(4_000, 2)).expect("dropped");
    let second = wait_for("the new octree", || {
        let now = described(&daemon, data, "");
        (now["points"] == 4_000).then_some(now)
    });
    assert_ne!(second["revision"], first["revision"]);
    assert_eq!(get(&daemon, &format!("{of_root}&to=1"), "").0, 410);
}

#[test]
fn the_viewer_has_the_guards_of_other_pages() {
    let root = tempfile::tempdir().expect("a folder");
    let daemon = Daemon::start_with(&root.path().join("data"), &["--token", TOKEN]);
    let bearer = format!("Authorization: Bearer {TOKEN}");
    fs::write(daemon.inbox().join("scan.las"), las(2_000, 1)).expect("dropped");
    fs::write(daemon.inbox().join("other.las"), las(2_000, 2)).expect("dropped");
    wait_for("both octrees", || {
        ["scan", "other"].iter().all(|name| daemon.octree(name).join("metadata.json").exists()).then_some(())
    });
    for path in ["/api/octrees/scan/view", "/api/octrees/scan/pages/r?revision=x", "/view/scan"] {
        assert_eq!(get(&daemon, path, "").0, 401, "{path}");
        assert_ne!(get(&daemon, path, &bearer).0, 401, "{path}");
        // A page of somebody else reads nothing.
        assert!(!get(&daemon, path, &bearer).1.contains("access-control-allow-origin"), "{path}");
    }
    let (_, head, page) = get(&daemon, "/view/scan", &bearer);
    let page = String::from_utf8_lossy(&page);
    assert!(head.contains("default-src 'none'") && !head.contains("unsafe"), "{head}");
    assert!(!page.contains("<script>") && !page.contains("style="), "{page}");
    // Whoever has a link sees that octree, and no other.
    wait_for("the jobs", || {
        let body = ask(&daemon.address, &format!("GET /api/jobs\n{bearer}"), "").2;
        let jobs: Value = serde_json::from_slice(&body).unwrap_or_default();
        let jobs = jobs["jobs"].as_array().cloned().unwrap_or_default();
        (jobs.len() == 2 && jobs.iter().all(|job| job["state"] == "done")).then_some(())
    });
    let jobs: Value =
        serde_json::from_slice(&ask(&daemon.address, &format!("GET /api/jobs\n{bearer}"), "").2)
            .expect("JSON");
    let scan = jobs["jobs"].as_array().expect("jobs").iter().find(|job| job["name"] == "scan").expect("one");
    let id = scan["id"].as_i64().expect("a number");
    let made = ask(&daemon.address, &format!("POST /api/jobs/{id}/links\n{bearer}"), "").2;
    let made: Value = serde_json::from_slice(&made).expect("JSON");
    let link = made["page"].as_str().expect("a path");
    let (status, _, page) = get(&daemon, &format!("{link}/view"), "");
    let page = String::from_utf8_lossy(&page).into_owned();
    assert!(status == 200 && page.contains(&format!("data-data=\"{link}/data\"")), "{page}");
    assert!(!page.contains("/api/octrees"), "{page}");
    let description = described(&daemon, &format!("{link}/data"), "");
    assert_eq!(description["name"], "scan");
    let revision = description["revision"].as_str().expect("text");
    for path in ["pages/r?", "nodes/r?to=5&", "nodes/r/points/0?"] {
        assert_eq!(get(&daemon, &format!("{link}/data/{path}revision={revision}"), "").0, 200, "{path}");
    }
    // Taken back, it opens nothing.
    let number = made["id"].as_i64().expect("a number");
    let (status, _, _) = ask(&daemon.address, &format!("DELETE /api/jobs/{id}/links/{number}\n{bearer}"), "");
    assert!((200..300).contains(&status), "{status}");
    assert_eq!(get(&daemon, &format!("{link}/data/nodes/r?to=5&revision={revision}"), "").0, 404);
    assert_eq!(get(&daemon, &format!("{link}/view"), "").0, 404);
}
