//! A real Prometheus, with the configuration of `deploy/`, scrapes a real daemon
//! and answers what its operator would ask. Runs where LODESTONE_PROMETHEUS is 1;
//! Debian's package `prometheus` is enough.

use std::fs;
use std::net::TcpListener;
use std::path::Path;
use std::process::{Child, Command, Stdio};

use crate::daemon_support::{Daemon, ask, las, wait_for};
use serde_json::Value;

fn deployed(name: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("deploy").join(name);
    fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// Replaces what must be there to be replaced.
fn change(text: &str, from: &str, to: &str) -> String {
    assert!(text.contains(from), "deploy/prometheus.yml says nothing of {from}");
    text.replace(from, to)
}

struct Prometheus {
    child: Child,
    address: String,
}

impl Prometheus {
    /// The configuration is the deployed one but for the daemon's address and the
    /// pace.
    fn start(folder: &Path, scraped: &str) -> Prometheus {
        let config = change(&deployed("prometheus.yml"), "127.0.0.1:7700", scraped);
        let config = change(&config, "scrape_interval: 15s", "scrape_interval: 1s");
        fs::write(folder.join("prometheus.yml"), config).expect("written");
        fs::write(folder.join("alerts.yml"), deployed("alerts.yml")).expect("written");
        // Free a moment ago; Prometheus cannot pick one itself.
        let free = TcpListener::bind("127.0.0.1:0").expect("a port").local_addr().expect("an address");
        let address = free.to_string();
        let log = fs::File::create(folder.join("prometheus.log")).expect("a log");
        let child = Command::new("prometheus")
            .arg(format!("--config.file={}", folder.join("prometheus.yml").display()))
            .arg(format!("--storage.tsdb.path={}", folder.join("tsdb").display()))
            .arg(format!("--web.listen-address={address}"))
            .stdout(Stdio::null())
            .stderr(log)
            .spawn()
            .expect("prometheus is in the path (Debian: apt-get install prometheus)");
        let prometheus = Prometheus { child, address };
        wait_for("Prometheus to be ready", || {
            std::net::TcpStream::connect(&prometheus.address).ok()?;
            (ask(&prometheus.address, "GET /-/ready", "").0 == 200).then_some(())
        });
        prometheus
    }

    fn json(&self, path: &str) -> Value {
        let (status, _, body) = ask(&self.address, &format!("GET {path}\nAccept-Encoding: identity"), "");
        let body = String::from_utf8_lossy(&body);
        assert_eq!(status, 200, "{path}: {body}");
        // The body may be sent in one chunk, between its length and an end.
        let json = &body[body.find('{').expect("JSON")..=body.rfind('}').expect("JSON")];
        serde_json::from_str(json).unwrap_or_else(|e| panic!("{path}: {e}: {body}"))
    }

    /// The value of the only series that answers.
    fn query(&self, encoded: &str) -> Option<String> {
        let answer = self.json(&format!("/api/v1/query?query={encoded}"));
        let found = answer["data"]["result"].as_array().expect("a list").clone();
        assert!(found.len() <= 1, "{answer}");
        Some(found.first()?["value"][1].as_str().expect("a figure").to_string())
    }
}

impl Drop for Prometheus {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[test]
fn a_real_prometheus_scrapes_the_daemon_and_counts_its_finished_jobs() {
    if std::env::var("LODESTONE_PROMETHEUS").as_deref() != Ok("1") {
        eprintln!("LODESTONE_PROMETHEUS is not 1: not run");
        return;
    }
    let root = tempfile::tempdir().expect("a folder");
    let daemon = Daemon::start(&root.path().join("data"));
    let prometheus = Prometheus::start(root.path(), &daemon.address);
    let done = "lodestone_jobs%7Bstate%3D%22done%22%7D";
    wait_for("a first scrape", || (prometheus.query(done)? == "0").then_some(()));

    for (name, seed) in [("a", 1), ("b", 2)] {
        fs::write(daemon.inbox().join(name).with_extension("las"), las(2_000, seed)).expect("dropped");
        daemon.wait(name, "done");
    }
    wait_for("two finished jobs", || (prometheus.query(done)? == "2").then_some(()));
    wait_for("their points", || {
        (prometheus.query("lodestone_points_written_total")? == "4000").then_some(())
    });
    assert_eq!(prometheus.query("up%7Bjob%3D%22lodestone%22%7D").as_deref(), Some("1"));

    // The alerts are loaded, work, and none is raised by a daemon in good health.
    let rules = prometheus.json("/api/v1/rules?type=alert");
    let rules = rules["data"]["groups"][0]["rules"].as_array().expect("rules").clone();
    assert_eq!(rules.len(), deployed("alerts.yml").matches("- alert:").count());
    for rule in rules {
        assert_eq!(rule["lastError"].as_str().unwrap_or(""), "", "{rule}");
        assert_ne!(rule["state"], "firing", "{rule}");
    }
}
