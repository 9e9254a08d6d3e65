//! How the pages look and are worked, of every kind; and below another site's path.

use std::fs;
use std::net::TcpStream;
use std::path::Path;

use super::{drive, root};
use crate::daemon_support::{Daemon, ask, content, converted, las, wait_for};
use crate::served::elsewhere::{Running, free_port, is_there, nginx};

const TOKEN: &str = "correct-horse-battery";
const READER: &str = "only-for-the-eyes";
const BEARER: &str = "Authorization: Bearer correct-horse-battery";

#[test]
fn every_kind_of_page_can_be_used() {
    let root = root();
    let secrets = ["--token", TOKEN, "--read-token", READER];
    let more = ["--patience-seconds", "0.5", "--preview", "true", "--preview-frames", "2"];
    let daemon = Daemon::start_with(&root.path().join("data"), &[&secrets[..], &more].concat());
    let jobs = || -> Vec<serde_json::Value> {
        let body = ask(&daemon.address, &format!("GET /api/jobs\n{BEARER}"), "").2;
        let json: serde_json::Value = serde_json::from_slice(&body).unwrap_or_default();
        json["jobs"].as_array().cloned().unwrap_or_default()
    };
    fs::write(daemon.inbox().join("a cloud.las"), las(3_000, 1)).expect("dropped");
    wait_for("its pictures", || jobs().iter().any(|job| job["preview"]["state"] == "done").then_some(()));
    fs::write(daemon.inbox().join("cut.las"), &las(3_000, 2)[..9_000]).expect("dropped");
    fs::write(daemon.inbox().join("\u{202e}שלום 🦀 <b>.las"), las(100, 3)).expect("dropped");
    fs::write(daemon.inbox().join("scan.e57"), "ASTM-E57").expect("dropped");
    wait_for("all jobs", || {
        (jobs().iter().filter(|job| job["finished_at"].is_i64()).count() == 3).then_some(())
    });
    let (status, _, link) = ask(&daemon.address, &format!("POST /api/jobs/1/links\n{BEARER}"), "");
    assert_eq!(status, 201);
    let link: serde_json::Value = serde_json::from_slice(&link).expect("JSON");
    let shared = format!("shared={}", link["page"].as_str().expect("a path"));
    let failed = jobs().iter().find(|job| job["state"] == "failed").expect("one")["id"].to_string();
    let failed = format!("broken=/jobs/{failed}");
    let address = format!("http://{}", daemon.address);
    drive(
        "looks.mjs",
        &[
            &address,
            TOKEN,
            READER,
            "login=/login",
            "list=/",
            "failed=/?state=failed",
            "done=/jobs/1",
            &failed,
            "none=/?q=nothing",
            "missing=/jobs/999",
            &shared,
        ],
    );
}

#[test]
fn folders_that_are_dropped_become_one_cloud() {
    let root = root();
    let daemon = Daemon::start(&root.path().join("data"));
    let here = root.path().join("mine");
    crate::daemon_support::fill_folder(
        &here,
        &[
            ("tiles/a 1.las", las(6_000, 1)),
            ("tiles/deep/b.las", las(5_000, 2)),
            ("tiles/read me.txt", b"no".to_vec()),
            ("größe 1.las", las(4_000, 3)),
            ("scan.e57", b"ASTM-E57".to_vec()),
            ("by form.las", las(2_000, 4)),
        ],
    );
    let path = |name: &str| here.join(name).to_str().expect("UTF-8").to_string();
    let dropped = ["tiles", "größe 1.las", "scan.e57", "by form.las"].map(path);
    let mut arguments = vec![format!("http://{}", daemon.address)];
    arguments.extend(dropped);
    if !drive("drop.mjs", &arguments.iter().map(String::as_str).collect::<Vec<_>>()) {
        return;
    }
    let octree = converted(&[&here.join("tiles")], &root.path().join("converted").join("tiles"));
    assert_eq!(content(&daemon.octree("tiles")), octree);
    daemon.wait("by form", "done");
    assert!(!daemon.inbox().join("tiles/read me.txt").exists() && !daemon.inbox().join("scan.e57").exists());
    assert!(fs::read_dir(daemon.inbox().join(".uploads")).expect("there").next().is_none());
}

/// The proxy as shipped, which hands the path on, and one that takes it away.
fn stripping(folder: &Path, port: u16, daemon: &str) -> std::process::Child {
    nginx(folder, port, &format!("{daemon}/"))
}

#[test]
fn below_a_path_nothing_leads_out() {
    if !is_there("nginx", "LODESTONE_REQUIRE_PROXIES") {
        return;
    }
    let root = root();
    let file = root.path().join("a b.las");
    // More than proxies take by themselves.
    fs::write(&file, las(80_000, 1)).expect("written");
    for (at, proxy) in [nginx, stripping].into_iter().enumerate() {
        let folder = root.path().join(format!("proxy-{at}"));
        fs::create_dir_all(&folder).expect("made");
        let port = free_port();
        let site = format!("http://127.0.0.1:{port}");
        let url = format!("{site}/lodestone");
        let args = ["--token", TOKEN, "--public-url", &url, "--preview", "true", "--preview-frames", "3"];
        let daemon = Daemon::start_with(&root.path().join(format!("data-{at}")), &args);
        let _proxy = Running(proxy(&folder, port, &daemon.address));
        wait_for("the proxy", || TcpStream::connect(format!("127.0.0.1:{port}")).ok());
        drive("prefix.mjs", &[&site, "/lodestone", TOKEN, file.to_str().expect("UTF-8")]);
    }
}
