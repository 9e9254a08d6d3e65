//! Who may read and who may operate: tokens, cookies, names and pages of others.

use std::fs;
use std::net::TcpListener;

use crate::daemon_support::{Daemon, las};

use super::header;

const OPERATOR: &str = "correct-horse-battery";
const READER: &str = "only-for-the-eyes";

fn status(daemon: &Daemon, head: &str) -> u16 {
    daemon.ask(head, "").0
}

/// Logs in by the form; the cookie as a browser sends it back, and where it is led.
fn log_in(daemon: &Daemon, token: &str, next: &str) -> (u16, String, String) {
    let form = format!("token={token}&next={next}");
    let request = "POST /login\nContent-Type: application/x-www-form-urlencoded\nSec-Fetch-Site: same-origin";
    let (status, head, _) = daemon.ask(request, &form);
    let cookie = header(&head, "set-cookie");
    (status, cookie.split(';').next().unwrap_or("").to_string(), header(&head, "location"))
}

#[test]
fn tokens_come_in_any_case_and_from_files() {
    let root = tempfile::tempdir().expect("a folder");
    let file = root.path().join("token");
    fs::write(&file, format!("{OPERATOR}\n")).expect("written");
    let config = root.path().join("lodestone.toml");
    fs::write(&config, format!("token_file = '{}'\nread_token = '{READER}'\n", file.display()))
        .expect("written");
    let daemon =
        Daemon::start_with(&root.path().join("data"), &["--config", config.to_str().expect("a path")]);
    for scheme in ["Bearer", "bearer", "BEARER", "bEaReR "] {
        assert_eq!(
            status(&daemon, &format!("GET /api/jobs\nAuthorization: {scheme} {OPERATOR}")),
            200,
            "{scheme}"
        );
        assert_eq!(
            status(&daemon, &format!("GET /api/jobs\nAuthorization: {scheme} {READER}")),
            200,
            "{scheme}"
        );
    }
    for wrong in ["", "\nAuthorization: Bearer correct-horse", "\nAuthorization: Basic correct-horse-battery"]
    {
        let (status, head, body) = daemon.ask(&format!("GET /api/jobs{wrong}"), "");
        assert_eq!((status, header(&head, "www-authenticate").as_str()), (401, "Bearer"));
        let error: serde_json::Value = serde_json::from_slice(&body).expect("JSON");
        assert!(error["error"].as_str().expect("words").contains("Bearer"), "{error}");
    }
    // Who may only look gives no order, and is told so; who may operate is told of the job.
    let order =
        |token: &str| status(&daemon, &format!("POST /api/jobs/7/retry\nAuthorization: Bearer {token}"));
    assert_eq!((order(READER), order(OPERATOR)), (403, 404));
    // A valid token needs no name of ours.
    let named = format!("GET /api/jobs\nHost: scans.example.com\nAuthorization: Bearer {OPERATOR}");
    assert_eq!(status(&daemon, &named), 200);
    assert_eq!(status(&daemon, "GET /api/jobs\nHost: scans.example.com\nAuthorization: Bearer x"), 403);
}

#[test]
fn browsers_log_in_by_a_cookie() {
    let root = tempfile::tempdir().expect("a folder");
    let data = root.path().join("data");
    let args = ["--token", OPERATOR, "--read-token", READER];
    let mut daemon = Daemon::start_with(&data, &args);
    // A person is led to the form, and from there to where they wanted.
    let (code, head, _) = daemon.ask("GET /?page=2\nAccept: text/html,*/*;q=0.8", "");
    assert_eq!((code, header(&head, "location").as_str()), (303, "/login?next=/%3Fpage%3D2"));
    let (code, head, body) = daemon.ask("GET /login?next=/%3Fpage%3D2\nAccept: text/html", "");
    let form = String::from_utf8_lossy(&body).into_owned();
    assert_eq!(code, 200);
    assert!(form.contains("method=\"post\"") && form.contains("value=\"/?page=2\""), "{form}");
    let policy = header(&head, "content-security-policy");
    assert!(policy.contains("script-src 'self'") && !policy.contains("unsafe"), "{policy}");

    assert_eq!(log_in(&daemon, "wrong-token", "/").0, 401);
    let (code, cookie, next) = log_in(&daemon, OPERATOR, "/%3Fpage%3D2");
    assert_eq!((code, next.as_str()), (303, "/?page=2"));
    assert!(cookie.starts_with("lodestone=") && !cookie.contains(OPERATOR), "{cookie}");
    assert_eq!(log_in(&daemon, OPERATOR, "//evil.example").2, "/");
    let with = |cookie: &str, head: &str| format!("{head}\nCookie: {cookie}");
    assert_eq!(status(&daemon, &with(&cookie, "GET /")), 200);
    assert_eq!(status(&daemon, &with(&cookie, "GET /login?next=/api/jobs")), 303);

    // It outlives a restart; as a reader's it only looks; forged or after a change of the token it is void.
    let reader = log_in(&daemon, READER, "/").1;
    assert!(daemon.stop());
    let daemon = Daemon::start_with(&data, &args);
    assert_eq!(status(&daemon, &with(&cookie, "POST /api/jobs/7/retry")), 404);
    assert_eq!(status(&daemon, &with(&reader, "GET /api/jobs")), 200);
    assert_eq!(status(&daemon, &with(&reader, "POST /api/jobs/7/retry")), 403);
    assert_eq!(status(&daemon, &with(&format!("{cookie}0"), "GET /api/jobs")), 401);
    let (code, head, _) = daemon.ask(&with(&cookie, "POST /logout"), "");
    assert_eq!((code, header(&head, "set-cookie").contains("Max-Age=0")), (303, true));
    drop(daemon);
    let daemon = Daemon::start_with(&data, &["--token", "another-secret-now"]);
    assert_eq!(status(&daemon, &with(&cookie, "GET /api/jobs")), 401);
}

#[test]
fn pages_of_others_neither_steer_nor_listen() {
    let root = tempfile::tempdir().expect("a folder");
    let daemon = Daemon::start(&root.path().join("data"));
    let own = format!("http://{}", daemon.address);
    for (line, asked) in [
        ("Origin: https://evil.example", 403),
        ("Origin: null", 403),
        ("Origin: http://127.0.0.1:1", 403),
        ("Sec-Fetch-Site: cross-site", 403),
        ("Sec-Fetch-Site: same-site", 403),
        ("Sec-Fetch-Site: same-origin", 404),
        (&format!("Origin: {own}"), 404),
        ("X-Nothing: at all", 404),
    ] {
        for request in ["POST /api/jobs/7/retry", "POST /api/jobs/7/pause", "GET /api/jobs/7/events"] {
            let (code, _, body) = daemon.ask(&format!("{request}\n{line}"), "");
            assert_eq!(code, asked, "{request} {line}");
            assert!(serde_json::from_slice::<serde_json::Value>(&body).is_ok_and(|e| e["error"].is_string()));
        }
        let code =
            status(&daemon, &format!("POST /login\nContent-Type: application/x-www-form-urlencoded\n{line}"));
        assert_eq!(code == 403, asked == 403, "{line}");
    }
    assert_eq!(status(&daemon, "GET /api/events\nOrigin: https://evil.example"), 403);
    // A name that was made to point here.
    for (host, served) in [("evil.example", 403), ("evil.example:7700", 403), ("localhost:9", 200)] {
        for path in ["/", "/api/jobs", "/metrics", "/login"] {
            let code = status(&daemon, &format!("GET {path}\nHost: {host}"));
            assert_eq!((code == 403, host), (served == 403, host), "{path}");
        }
    }
    for path in ["/", "/healthz", "/metrics", "/api/jobs", "/octrees/none", "/nothing", "/login"] {
        let (_, head, _) = daemon.ask(&format!("GET {path}"), "");
        assert_eq!(header(&head, "x-content-type-options"), "nosniff", "{path}");
    }
}

#[test]
fn mapped_loopback_has_all_checks_of_loopback() {
    if TcpListener::bind("[::ffff:127.0.0.1]:0").is_err() {
        eprintln!("skipped: no addresses of IPv6 here");
        return;
    }
    let root = tempfile::tempdir().expect("a folder");
    let mut daemon = Daemon::start_with(&root.path().join("data"), &["--listen", "[::ffff:127.0.0.1]:0"]);
    // As clients write it.
    let port = daemon.address.rsplit(':').next().expect("a port").to_string();
    daemon.address = format!("127.0.0.1:{port}");
    assert_eq!(status(&daemon, "GET /api/jobs"), 200);
    assert_eq!(status(&daemon, &format!("GET /api/jobs\nHost: [::ffff:127.0.0.1]:{port}")), 200);
    assert_eq!(status(&daemon, "GET /api/jobs\nHost: evil.example"), 403);
    assert_eq!(status(&daemon, "POST /api/jobs/7/retry\nOrigin: https://evil.example"), 403);
}

#[test]
fn links_respect_the_public_address() {
    let root = tempfile::tempdir().expect("a folder");
    let args = ["--token", OPERATOR, "--public-url", "https://scans.example.com/lidar/"];
    let daemon = Daemon::start_with(&root.path().join("data"), &args);
    fs::write(daemon.inbox().join("a b.las"), las(1_000, 1)).expect("dropped");
    let cookie = log_in(&daemon, OPERATOR, "").1;
    let (_, head, _) = daemon.ask(
        "POST /login\nHost: scans.example.com\nOrigin: https://scans.example.com\n\
        Content-Type: application/x-www-form-urlencoded",
        &format!("token={OPERATOR}"),
    );
    assert_eq!(header(&head, "location"), "/lidar/");
    let set = header(&head, "set-cookie");
    assert!(set.contains("; Path=/lidar/;") && set.contains("; Secure"), "{set}");
    let (_, head, _) = daemon.ask("GET /lidar/\nHost: scans.example.com\nAccept: text/html", "");
    assert_eq!(header(&head, "location"), "/lidar/login?next=/lidar/");

    let job = crate::daemon_support::wait_for("the job", || {
        let (_, _, body) = daemon.ask(&format!("GET /lidar/api/jobs\nCookie: {cookie}"), "");
        let jobs: serde_json::Value = serde_json::from_slice(&body).ok()?;
        Some(jobs["jobs"][0].clone()).filter(|job| job["state"] == "done")
    });
    assert_eq!(job["octree"], "/lidar/octrees/a%20b/metadata.json");
    // Whether the proxy takes the path away or not.
    for path in ["/octrees/a%20b/metadata.json", "/lidar/octrees/a%20b/metadata.json"] {
        assert_eq!(status(&daemon, &format!("GET {path}\nCookie: {cookie}")), 200, "{path}");
        assert_eq!(status(&daemon, &format!("GET {path}")), 401, "{path}");
    }
    // And what a viewer on another page is given.
    let (made, _, link) =
        daemon.ask(&format!("POST /lidar/api/jobs/{}/links\nCookie: {cookie}", job["id"]), "");
    let link: serde_json::Value = serde_json::from_slice(&link).expect("JSON");
    let shared = link["file"].as_str().expect("an address").to_string();
    assert!(made == 201 && shared.starts_with("/lidar/share/") && !shared.contains(OPERATOR), "{shared}");
    assert_eq!(status(&daemon, &format!("GET {shared}\nOrigin: https://viewer.example")), 200);
    assert_eq!(status(&daemon, &format!("GET {}", shared.replace("share/1", "share/2"))), 404);
    let (_, _, page) = daemon.ask(&format!("GET /\nCookie: {cookie}"), "");
    let page = String::from_utf8_lossy(&page).into_owned();
    let links: Vec<&str> = page.split("=\"/").skip(1).filter_map(|link| link.split('"').next()).collect();
    assert!(
        links.len() > 3 && links.iter().all(|link| *link == "lidar" || link.starts_with("lidar/")),
        "{links:?}"
    );
}
