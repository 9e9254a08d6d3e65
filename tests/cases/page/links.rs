//! Links to single octrees, verifications ordered on the page, and the API's own
//! description.

use std::fs;

use crate::daemon_support::{Daemon, ask, las, wait_for};

const BEARER: &str = "Authorization: Bearer a long secret";
const FORM: &str = "Content-Type: application/x-www-form-urlencoded";

fn order(daemon: &Daemon, job: i64, body: &str) -> u16 {
    ask(&daemon.address, &format!("POST /jobs/{job}/order\n{FORM}\n{BEARER}"), body).0
}

fn page(daemon: &Daemon, path: &str) -> String {
    let (status, _, body) = ask(&daemon.address, &format!("GET {path}\n{BEARER}"), "");
    assert_eq!(status, 200, "{path}");
    String::from_utf8_lossy(&body).into_owned()
}

#[test]
fn a_link_opens_one_octree_until_taken_back() {
    let root = tempfile::tempdir().expect("a folder");
    let daemon = Daemon::start_with(&root.path().join("data"), &["--token", "a long secret"]);
    for (name, seed) in [("größe 1", 1), ("b", 2)] {
        fs::write(daemon.inbox().join(format!("{name}.las")), las(2_000, seed)).expect("dropped");
    }
    let path = wait_for("both octrees", || {
        let list = page(&daemon, "/api/jobs?state=done");
        let jobs: serde_json::Value = serde_json::from_str(&list).expect("JSON");
        let jobs = jobs["jobs"].as_array().expect("jobs");
        let one = jobs.iter().find(|job| job["name"] == "größe 1")?;
        (jobs.len() == 2).then(|| one["id"].as_i64().expect("a number"))
    });
    assert_eq!(order(&daemon, path, "order=share"), 303);
    let html = page(&daemon, &format!("/jobs/{path}"));
    let (_, rest) = html.split_once("data-copy=\"/share/").expect("the link");
    let token = rest.split('"').next().expect("a token").to_string();
    let open = |path: &str| ask(&daemon.address, &format!("GET {path}"), "");

    let (status, _, body) = open(&format!("/share/{token}"));
    assert!(status == 200 && String::from_utf8_lossy(&body).contains("größe 1"));
    let (status, head, body) = open(&format!("/share/{token}/octree/metadata.json"));
    assert_eq!(
        (status, body),
        (200, fs::read(daemon.octree("größe 1").join("metadata.json")).expect("there"))
    );
    assert!(head.to_lowercase().contains("access-control-allow-origin: *"), "{head}");
    let (status, _, body) =
        ask(&daemon.address, &format!("GET /share/{token}/octree/octree.bin\nRange: bytes=5-9"), "");
    assert_eq!((status, body.len()), (206, 5));
    // Nothing else.
    for path in [
        "/".to_string(),
        "/api/jobs".to_string(),
        "/octrees/b/metadata.json".to_string(),
        format!("/share/{token}/octree/../b/metadata.json"),
        format!("/share/{token}/octree/..%2Fb%2Fmetadata.json"),
        format!("/share/{token}/octree/preview/../../b/metadata.json"),
        format!("/share/{token}x/octree/metadata.json"),
        "/share/1-0000/octree/metadata.json".to_string(),
    ] {
        let status = open(&path).0;
        assert!([401, 404].contains(&status), "{path}: {status}");
    }
    assert_eq!(ask(&daemon.address, &format!("POST /jobs/{path}/order\n{FORM}"), "order=share").0, 401);

    let link = token.split('-').next().expect("a number").to_string();
    assert_eq!(order(&daemon, path, &format!("order=revoke&link={link}")), 303);
    assert_eq!(open(&format!("/share/{token}")).0, 404);
    assert_eq!(open(&format!("/share/{token}/octree/metadata.json")).0, 404);
}

#[test]
fn what_a_verification_finds_stays_with_the_job() {
    let root = tempfile::tempdir().expect("a folder");
    let daemon = Daemon::start(&root.path().join("data"));
    fs::write(daemon.inbox().join("a.las"), las(3_000, 1)).expect("dropped");
    let id = daemon.wait("a", "done")["id"].as_i64().expect("a number");
    assert_eq!(daemon.json(&format!("/api/jobs/{id}/verify")), serde_json::Value::Null);
    let order = || assert_eq!(daemon.post(&format!("/api/jobs/{id}/verify"), "").0, 202);
    let found = || {
        wait_for("the verification", || {
            let found = daemon.json(&format!("/api/jobs/{id}/verify"));
            (found["state"] != "queued").then_some(found)
        })
    };
    order();
    let first = found();
    assert_eq!((&first["state"], &first["report"]["ok"]), (&"done".into(), &true.into()), "{first}");
    assert_eq!(first["report"]["against"]["points"], 3_000);
    assert!(daemon.get(&format!("/jobs/{id}")).1.contains("It is right."));

    // A spoiled octree is seen, and so is that its file is gone.
    fs::remove_file(daemon.inbox().join("a.las")).expect("removed");
    let octree = daemon.octree("a").join("octree.bin");
    let mut bytes = fs::read(&octree).expect("there");
    bytes[100] ^= 0x55;
    fs::write(&octree, bytes).expect("spoiled");
    order();
    let second = found();
    assert_eq!(second["report"]["ok"], false, "{second}");
    let page = daemon.get(&format!("/jobs/{id}")).1;
    assert!(page.contains("Something is wrong with it.") && page.contains("checked on its own"), "{page}");
    assert_eq!(daemon.post("/api/jobs/99/verify", "").0, 404);
}

#[test]
fn the_description_is_linked_and_served() {
    let root = tempfile::tempdir().expect("a folder");
    let daemon = Daemon::start(&root.path().join("data"));
    assert!(daemon.get("/").1.contains("href=\"/api/openapi.json\""));
    let description = daemon.json("/api/openapi.json");
    assert_eq!(description["openapi"], "3.1.0");
    let (status, text) = daemon.post("/api/queue", r#"{"mode": "drain"}"#);
    assert!(status == 200 && text.contains("\"mode\":\"drain\""), "{text}");
    assert_eq!(daemon.post("/api/queue", r#"{"mode": "fly"}"#).0, 422);
    assert_eq!(daemon.json("/api/queue")["mode"], "drain");
}
