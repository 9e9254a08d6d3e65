//! What browsers keep of octrees: nothing of one is taken for another.

use std::fs;

use crate::daemon_support::{Daemon, las, wait_for};

use super::header;

#[test]
fn a_replaced_octree_is_seen_at_once() {
    let root = tempfile::tempdir().expect("a folder");
    let daemon = Daemon::start(&root.path().join("data"));
    let source = daemon.inbox().join("a.las");
    fs::write(&source, las(5_000, 1)).expect("dropped");
    daemon.wait("a", "done");
    let files = ["metadata.json", "hierarchy.bin", "octree.bin"];
    let mut known = Vec::new();
    for file in files {
        let url = format!("GET /octrees/a/{file}");
        let (status, head, body) = daemon.ask(&url, "");
        assert_eq!((status, header(&head, "cache-control").as_str()), (200, "no-cache"), "{head}");
        let tag = header(&head, "etag");
        assert!(tag.starts_with('"'), "{head}");
        let (status, head, nothing) = daemon.ask(&format!("{url}\nIf-None-Match: {tag}"), "");
        assert_eq!((status, header(&head, "etag"), nothing.len()), (304, tag.clone(), 0));
        let (status, _, part) = daemon.ask(&format!("{url}\nRange: bytes=2-7\nIf-Range: {tag}"), "");
        assert_eq!((status, part.as_slice()), (206, &body[2..8]));
        // Longer than the file: the whole of it.
        let (status, head, part) = daemon.ask(&format!("{url}\nRange: bytes=-99999999"), "");
        assert_eq!((status, &part), (206, &body), "{head}");
        let size = body.len();
        assert_eq!(header(&head, "content-range"), format!("bytes 0-{}/{size}", size - 1));
        let (status, head, _) =
            daemon.ask(&format!("{url}\nRange: bytes={size}-\nOrigin: https://v.example"), "");
        assert_eq!((status, header(&head, "content-range")), (416, format!("bytes */{size}")));
        assert_eq!(header(&head, "access-control-allow-origin"), "*");
        let (status, head, nothing) = daemon.ask(&format!("HEAD /octrees/a/{file}"), "");
        assert_eq!((status, header(&head, "content-length"), nothing.len()), (200, size.to_string(), 0));
        known.push((url, tag, body));
    }
    fs::write(&source, las(6_000, 2)).expect("dropped");
    wait_for("the new octree", || {
        daemon.jobs().into_iter().find(|job| job["revision"] == 2 && job["state"] == "done")
    });
    for (url, tag, old) in known {
        let (status, head, body) = daemon.ask(&format!("{url}\nIf-None-Match: {tag}"), "");
        assert_eq!(status, 200, "{url}");
        assert_ne!((header(&head, "etag"), &body), (tag.clone(), &old), "{url}");
        // A range that belongs to the old one is answered with the whole of the new.
        for condition in [tag.as_str(), "\"dead.beef-1\"", "Wed, 21 Oct 2015 07:28:00 GMT"] {
            let (status, _, whole) =
                daemon.ask(&format!("{url}\nRange: bytes=0-15\nIf-Range: {condition}"), "");
            assert_eq!((status, whole == body), (200, true), "{url} {condition}");
        }
        assert_eq!(daemon.ask(&format!("{url}\nIf-Match: {tag}"), "").0, 412, "{url}");
    }
}

#[test]
fn refusals_can_be_read_on_other_pages() {
    let root = tempfile::tempdir().expect("a folder");
    let daemon = Daemon::start_with(&root.path().join("data"), &["--token", "correct-horse-battery"]);
    // The question before the request brings no token.
    let (status, head, _) = daemon.ask(
        "OPTIONS /octrees/a/octree.bin\nOrigin: https://v.example\nAccess-Control-Request-Method: GET\n\
         Access-Control-Request-Headers: authorization,content-type,range",
        "",
    );
    assert_eq!((status, header(&head, "access-control-allow-origin").as_str()), (200, "*"));
    let allowed = header(&head, "access-control-allow-headers").to_lowercase();
    for name in ["range", "content-type", "authorization"] {
        assert!(allowed.split(',').any(|one| one.trim() == name), "{allowed}");
    }
    let bearer = "Authorization: Bearer correct-horse-battery";
    for (request, expected) in [
        ("GET /octrees/a/octree.bin", 401),
        ("GET /share/1-0123/octree/octree.bin", 404),
        (&format!("GET /octrees/a/octree.bin\n{bearer}"), 404),
        (&format!("GET /octrees/.staged/1/octree.bin\n{bearer}"), 404),
        ("GET /octrees/a/octree.bin\nHost: evil.example", 403),
    ] {
        let (status, head, _) = daemon.ask(&format!("{request}\nOrigin: https://v.example"), "");
        assert_eq!(
            (status, header(&head, "access-control-allow-origin").as_str()),
            (expected, "*"),
            "{request}"
        );
        let exposed = header(&head, "access-control-expose-headers").to_lowercase();
        for name in ["content-range", "content-length", "etag", "accept-ranges"] {
            assert!(exposed.contains(name), "{exposed}");
        }
    }
    // The API itself is nobody else's.
    let (_, head, _) = daemon.ask(&format!("GET /api/jobs\n{bearer}\nOrigin: https://v.example"), "");
    assert_eq!(header(&head, "access-control-allow-origin"), "");
}
