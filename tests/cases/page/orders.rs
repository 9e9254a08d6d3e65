//! Orders to the daemon: none from a page of somebody else, whatever routes there
//! are; and those to many jobs that failed.

use std::collections::BTreeSet;

use super::rows;
use crate::daemon_support::{Daemon, ask};

const ROUTES: [&str; 2] =
    [include_str!("../../../src/serve/web/mod.rs"), include_str!("../../../src/serve/web/pages/mod.rs")];
const METHODS: [&str; 4] = ["post", "put", "patch", "delete"];

/// Method and path of every route that changes something, as the sources have them.
fn orders() -> BTreeSet<(String, String)> {
    let mut orders = BTreeSet::new();
    for call in ROUTES.iter().flat_map(|source| source.split(".route(\"").skip(1)) {
        let (path, rest) = call.split_once('"').expect("a path");
        let handlers = rest.split(".route(").next().unwrap_or("").split(".layer(").next().unwrap_or("");
        let handlers = handlers.split(';').next().unwrap_or("");
        for method in METHODS {
            if handlers.contains(&format!(" {method}(")) || handlers.contains(&format!(".{method}(")) {
                let path = path.replace("{id}", "4").replace("{link}", "1").replace("{*path}", "a/b");
                orders.insert((method.to_uppercase(), path));
            }
        }
    }
    orders
}

#[test]
fn no_order_comes_from_elsewhere() {
    let orders = orders();
    let is_there = |method: &str, path: &str| orders.contains(&(method.to_string(), path.to_string()));
    assert!(is_there("POST", "/api/jobs/4/retry") && is_there("POST", "/upload"), "{orders:?}");
    assert!(is_there("POST", "/api/queue") && is_there("POST", "/logout"), "{orders:?}");
    assert!(is_there("DELETE", "/api/jobs/4/links/1") && orders.len() >= 17, "{orders:?}");
    let root = tempfile::tempdir().expect("a folder");
    for (name, more) in [("open", &[][..]), ("locked", &["--token", "a long secret"][..])] {
        let data = root.path().join(name);
        rows::fill(&data, 12);
        let args: Vec<&str> = ["--settle-seconds", "3600"].iter().chain(more).copied().collect();
        let daemon = Daemon::start_with(&data, &args);
        let port = daemon.address.rsplit(':').next().expect("a port");
        // A browser that is logged in: its cookie must not help a foreign page.
        let form = "Content-Type: application/x-www-form-urlencoded";
        let (_, head, _) = daemon.ask(&format!("POST /login\n{form}"), "token=a long secret");
        let cookie = head.lines().find_map(|line| line.strip_prefix("set-cookie: ")?.split(';').next());
        let cookie = cookie.map(|cookie| format!("\nCookie: {cookie}")).unwrap_or_default();
        assert_eq!(cookie.is_empty(), more.is_empty(), "{head}");
        let state = || {
            let read = |path: &str| ask(&daemon.address, &format!("GET {path}{cookie}"), "").2;
            let queue: serde_json::Value = serde_json::from_slice(&read("/api/queue")).expect("JSON");
            let kept = [queue["mode"].to_string().into_bytes(), queue["jobs"].to_string().into_bytes()];
            (read("/api/jobs"), read("/api/jobs/4/links"), kept)
        };
        let before = state();
        for (method, path) in &orders {
            for foreign in [
                "Origin: https://evil.example".to_string(),
                "Origin: null".to_string(),
                format!("Origin: http://localhost.evil.example:{port}"),
                "Sec-Fetch-Site: cross-site".to_string(),
                "Sec-Fetch-Site: same-site".to_string(),
                format!("Host: evil.example:{port}"),
                format!("Host: evil.example:{port}\nOrigin: http://evil.example:{port}"),
            ] {
                for (kind, body) in [
                    (form, "mode=drain&order=cancel&all=paused&priority=7&token=a long secret"),
                    ("Content-Type: application/json", r#"{"mode": "drain", "priority": 7}"#),
                    ("Content-Type: multipart/form-data; boundary=x", "--x--"),
                ] {
                    let request = format!("{method} {path}\n{kind}\n{foreign}{cookie}");
                    let (status, head, _) = ask(&daemon.address, &request, body);
                    assert_eq!(status, 403, "{request}: {head}");
                    assert!(!head.to_lowercase().contains("set-cookie"), "{request}: {head}");
                }
            }
        }
        assert_eq!(state(), before);
        // The same from a page of ours comes through to the order itself.
        let own = format!("Origin: http://{}{cookie}", daemon.address);
        for (method, path) in &orders {
            let (status, _, _) = ask(&daemon.address, &format!("{method} {path}\n{form}\n{own}"), "x=y");
            assert!(status != 403, "{method} {path}: {status}");
        }
    }
}

#[test]
fn hundreds_that_failed_are_understood_and_retried() {
    let root = tempfile::tempdir().expect("a folder");
    let data = root.path().join("data");
    // 600 of these failed, for three reasons that name files and numbers.
    rows::fill(&data, 2_400);
    let daemon = Daemon::start_with(&data, &["--settle-seconds", "3600"]);
    let post =
        |body: &str| daemon.ask("POST /jobs/order\nContent-Type: application/x-www-form-urlencoded", body).1;
    // Nothing is started, so that the counts stand.
    daemon.post("/api/queue", r#"{"mode": "drain"}"#);
    // The first click: the tab, which the list links.
    assert!(daemon.get("/").1.contains("href=\"/?state=failed\""));
    let page = daemon.get("/?state=failed").1;
    let (_, why) = page.split_once("id=\"why\"").expect("why they failed");
    let (why, _) = why.split_once("</section>").expect("its end");
    assert_eq!(why.matches("200 ×").count(), 3, "{why}");
    assert!(!why.contains("/in/Tile_"), "{why}");
    // One reason alone.
    let (_, rest) = why.split_once("name=\"reason\" value=\"").expect("a reason");
    let reason = rest.split('"').next().expect("its key");
    let head = post(&format!("all=failed&reason={reason}&order=retry&state=failed"));
    assert!(head.contains("said=retry&n=200&state=failed"), "{head}");
    let page = daemon.get("/?state=failed&said=retry&n=200").1;
    assert!(page.contains("200 jobs will be tried again.") && page.matches("200 ×").count() == 2);
    // The others: the button that asks, and its yes, are the second and the third click.
    assert!(page.contains("Retry all failed…") && page.contains("Yes, try all of them again"));
    assert!(post("all=failed&order=retry").contains("said=retry&n=400"));
    let counts = daemon.json("/api/queue")["jobs"].clone();
    assert_eq!((&counts["failed"], &counts["queued"]), (&0.into(), &600.into()), "{counts}");
}
