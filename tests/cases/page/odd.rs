//! Pages of jobs as nobody expects them: whatever names, figures and reports hold.

use super::rows;
use crate::daemon_support::Daemon;

#[test]
fn odd_jobs_are_told_plainly() {
    let root = tempfile::tempdir().expect("a folder");
    let data = root.path().join("data");
    let long = "ab ".repeat(1365);
    let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).expect("after 1970");
    let now = now.as_millis() as i64;
    let job = |name: &str, state: &str, points: i64, error: &str, report: &str, from: i64, to: i64| {
        [name, state, &points.to_string(), error, report, &from.to_string(), &to.to_string()]
            .map(str::to_string)
    };
    let report = r#"{"points_in": null, "points_out": -4, "lattice": {"scale": [null, "NaN", 1e400], "min": [1]},
        "max_error": [null], "guards": [{}, 7, null], "notes": [null, "a `note` with <b> and \u202e"], "repairs": 3,
        "seconds_by_stage": {"survey": -1, "index": "x"}, "spacing": null, "files_aside": {}, "options": [],
        "crs": "PROJCS[\"<i>", "projection": 7}"#;
    let report = report.replace("1e400", "1e300");
    rows::insert(
        &data,
        &[
            job(
                "huge",
                "done",
                1_000_000_000_000,
                "",
                r#"{"points_in": 1000000000000, "points_out": 1000000000000}"#,
                now - 5_000,
                now,
            ),
            job("back", "done", 5, "", "{}", now + 7_200_000, now - 7_200_000),
            job("odd", "done", 0, "", &report, now - 10, now),
            job("list", "done", 0, "", "[1, 2]", now, i64::MAX),
            job(
                &long,
                "failed",
                0,
                &format!("/in/{long}.laz: is `cut\u{202e} <b>{}", "x".repeat(100_000)),
                "",
                now,
                now,
            ),
            job("_שלום 🦀 [2J", "quarantined", 3, "`", "", now, now),
        ],
    );
    let daemon = Daemon::start_with(&data, &["--settle-seconds", "3600"]);
    let mut pages: Vec<String> = (1..=6).map(|id| format!("/jobs/{id}")).collect();
    let lists =
        ["/", "/?state=failed", "/?state=quarantined", "/?sort=took", "/?sort=took-up", "/?sort=points-up"];
    pages.extend(lists.map(str::to_string));
    // Addresses that mean nothing ask for nothing.
    for odd in [
        "/?sort=x-up&at=after~9~",
        "/?at=before~~",
        "/?at=after~-5~x&sort=name",
        "/?q=%00&state=%F0%9F%A6%80",
    ] {
        pages.push(odd.to_string());
    }
    for path in &pages {
        let (status, page) = daemon.get(path);
        assert_eq!(status, 200, "{path}: {page}");
        for raw in ["<b>", "<i>", "NaN", "null", "\u{202e}", "\u{1b}", "\u{0}", "-4 points"] {
            assert!(!page.contains(raw), "{path} has {raw:?}");
        }
        let lines = page.lines().count();
        assert!(page.len() < 400_000, "{path}: {} bytes in {lines} lines", page.len());
    }
    let list = daemon.get("/").1;
    for text in ["1 T<", "in the future", "<bdi>"] {
        assert!(list.contains(text), "{text}: {list}");
    }
    assert!(daemon.get("/jobs/1").1.contains("title=\"1\u{202f}000\u{202f}000\u{202f}000\u{202f}000\""));
    assert!(daemon.get("/jobs/3").1.contains("a <code>note</code> with &lt;b&gt; and \\u202e"));
}
