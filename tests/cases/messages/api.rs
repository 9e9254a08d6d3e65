//! Every error of the API is JSON and says what is wrong.

use serde_json::Value;

use crate::daemon_support::Daemon;

#[test]
fn every_error_of_the_api_is_json() {
    let root = tempfile::tempdir().expect("a folder");
    let daemon = Daemon::start(&root.path().join("data"));
    let json = "Content-Type: application/json";
    let long = "x".repeat(2 << 20);
    for (request, body, status, word) in [
        ("GET /api/nothing".to_string(), "", 404, "/api/nothing"),
        ("GET /api".to_string(), "", 404, "/api"),
        ("DELETE /api/jobs".to_string(), "", 405, "DELETE"),
        ("GET /api/jobs/1/retry".to_string(), "", 405, "GET"),
        ("GET /api/jobs/x".to_string(), "", 400, "x"),
        ("GET /api/jobs/99999999999999999999".to_string(), "", 400, "9"),
        ("GET /api/jobs/7".to_string(), "", 404, "job 7"),
        ("GET /api/jobs/7/events".to_string(), "", 404, "job 7"),
        ("GET /api/jobs?limit=many".to_string(), "", 400, "limit"),
        ("GET /api/jobs?colour=red".to_string(), "", 400, "colour"),
        ("GET /api/jobs?state=asleep".to_string(), "", 400, "asleep"),
        (format!("POST /api/jobs/1/priority\n{json}"), "{", 400, "JSON"),
        (format!("POST /api/jobs/1/priority\n{json}"), r#"{"priority": "high"}"#, 422, "priority"),
        ("POST /api/jobs/1/priority".to_string(), "{}", 415, "application/json"),
        (format!("POST /api/jobs/purge\n{json}"), r#"{"older": 3}"#, 422, "older"),
        (format!("POST /api/jobs/1/priority\n{json}"), &long, 413, "large"),
        ("POST /api/jobs/1/retry\nOrigin: http://evil.example".to_string(), "", 403, "refused"),
    ] {
        let (code, head, body) = daemon.ask(&request, body);
        let body = String::from_utf8_lossy(&body).into_owned();
        assert_eq!(code, status, "{request}: {body}");
        let lower = head.to_lowercase();
        assert!(lower.contains("content-type: application/json"), "{request}: {head}");
        let told: Value = serde_json::from_str(&body).unwrap_or_else(|e| panic!("{request}: {e}: {body}"));
        assert_eq!(told.as_object().map(|told| told.len()), Some(1), "{request}: {body}");
        let error = told["error"].as_str().expect("an error");
        assert!(error.contains(word), "{request}: {error}");
        assert_eq!(status == 405, lower.contains("allow:"), "{request}: {head}");
    }
    // States are taken in any letter case.
    assert_eq!(daemon.get("/api/jobs?state=DONE").0, 200);
}

#[test]
fn a_refusal_for_want_of_a_token_is_json() {
    let root = tempfile::tempdir().expect("a folder");
    let daemon = Daemon::start_with(&root.path().join("data"), &["--token", "a long secret"]);
    let (status, head, body) = daemon.ask("GET /api/jobs", "");
    let told: Value = serde_json::from_slice(&body).expect("JSON");
    assert_eq!(status, 401);
    assert!(told["error"].as_str().is_some_and(|error| error.contains("Bearer")), "{told}");
    assert!(head.to_lowercase().contains("www-authenticate: bearer"), "{head}");
}
