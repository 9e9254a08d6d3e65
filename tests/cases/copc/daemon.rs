//! The daemon publishes, serves, shares and replaces a COPC file as it does an octree.

use std::fs;

use super::support::copc_bytes;
use crate::common::{convert, listing};
use crate::daemon_support::{Daemon, las, wait_for};
use lodestone::convert::formats::Formats;
use lodestone::convert::options::Options;

#[test]
fn a_copc_file_alone_is_served_counted_and_drawn() {
    let root = tempfile::tempdir().unwrap();
    let daemon = Daemon::start_with(
        &root.path().join("data"),
        &["--format", "copc", "--preview", "true", "--preview-frames", "0"],
    );
    fs::write(daemon.inbox().join("größe 1.las"), las(20_000, 1)).unwrap();
    let job = daemon.wait("größe 1", "done");
    assert_eq!(job["octree"].as_str(), None);
    assert_eq!(job["result"]["copc"]["alone"], true);
    let url = job["copc"].as_str().expect("an address");
    assert!(url.ends_with("/gr%C3%B6%C3%9Fe%201/gr%C3%B6%C3%9Fe%201.copc.laz"), "{url}");
    let folder = daemon.octree("größe 1");
    let file = copc_bytes(&folder);
    let (status, _, part) = daemon.ask(&format!("GET {url}\nRange: bytes=375-588"), "");
    assert_eq!((status, part.as_slice()), (206, &file[375..589]));

    // The same bytes as `convert` makes.
    let alone = root.path().join("alone");
    let options = Options { format: Formats::COPC, name: Some("größe 1".into()), ..Options::default() };
    convert(&[daemon.inbox().join("größe 1.las")], &alone, &options).unwrap();
    assert!(copc_bytes(&alone) == file);

    let metrics = format!("lodestone_copc_bytes_total {}", file.len());
    daemon.wait_metrics(&["lodestone_copc_files_total 1", &metrics]);
    let page = daemon.get(&format!("/jobs/{}", job["id"])).1;
    assert!(
        page.contains("größe 1.copc.laz")
            && page.contains("For QGIS")
            && page.contains("pdal info --summary "),
        "{page}"
    );
    assert!(!page.contains("metadata.json"), "there is no octree to be told of");
    wait_for("pictures", || folder.join("preview/thumbnail.png").exists().then_some(()));
    assert_eq!(listing(&folder), ["größe 1.copc.laz", "preview", "report.json"]);
}

#[test]
fn a_data_set_may_ask_for_both_and_is_replaced_whole() {
    let root = tempfile::tempdir().unwrap();
    let daemon = Daemon::start(&root.path().join("data"));
    let marker = |options: &str| format!(r#"{{"options": {options}}}"#).into_bytes();
    let both = marker(r#"{"format": ["potree", "copc"]}"#);
    daemon.drop_folder("city", &[("a.las", las(5_000, 1)), ("lodestone.json", both)]);
    let job = daemon.wait("city", "done");
    assert!(job["octree"].is_string() && job["copc"].is_string(), "{job}");
    let files = ["city.copc.laz", "hierarchy.bin", "metadata.json", "octree.bin", "report.json"];
    let folder = daemon.octree("city");
    assert_eq!(listing(&folder).into_iter().filter(|name| name != "preview").collect::<Vec<_>>(), files);
    // New content as an octree alone: the file goes with what it replaces.
    fs::remove_file(daemon.inbox().join("city/lodestone.json")).unwrap();
    fs::write(daemon.inbox().join("city/a.las"), las(6_000, 2)).unwrap();
    fs::write(daemon.inbox().join("city/lodestone.json"), b"{}").unwrap();
    wait_for("the new octree", || (!folder.join("city.copc.laz").exists()).then_some(()));
    assert!(folder.join("octree.bin").exists());
}

#[test]
fn list_and_overview_of_all_are_served() {
    let root = tempfile::tempdir().unwrap();
    let daemon = Daemon::start_with(&root.path().join("data"), &["--format", "copc"]);
    for (name, seed) in [("a", 1), ("b", 2)] {
        fs::write(daemon.inbox().join(format!("{name}.las")), las(8_000, seed)).unwrap();
        daemon.wait(name, "done");
    }
    let listed = || {
        let (status, text) = daemon.get("/octrees/lodestone.vpc");
        let list: serde_json::Value = serde_json::from_str(&text).ok().filter(|_| status == 200)?;
        let overviews = list["features"].as_array()?.iter();
        let overviews: Vec<_> =
            overviews.filter_map(|item| item["assets"]["overview"]["href"].as_str()).collect();
        (overviews == ["./lodestone-overview.copc.laz"; 2]).then_some(())
    };
    wait_for("the overview of both", listed);
    let (status, _, part) = daemon.ask("GET /octrees/lodestone-overview.copc.laz\nRange: bytes=375-588", "");
    assert_eq!((status, &part[2..6]), (206, b"copc".as_slice()));
    // It is no octree of its own.
    assert_eq!(daemon.json("/api/jobs")["jobs"].as_array().unwrap().len(), 2);
}
