//! A real cloud, copied slowly into the inbox with pauses longer than the settle
//! time: one job, begun only when the file is whole, and the same bytes as
//! `lodestone convert`. Runs where LODESTONE_DATA names the folder of real clouds.

use std::fs::{self, File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Duration;

use crate::daemon_support::{Daemon, content, converted, wait_for};

fn cloud() -> Option<PathBuf> {
    let Some(folder) = std::env::var_os("LODESTONE_DATA") else {
        eprintln!("LODESTONE_DATA is not set: not run");
        return None;
    };
    // LODESTONE_SLOW_COPY picks another file, as the large one, by hand.
    let file = std::env::var("LODESTONE_SLOW_COPY").unwrap_or_else(|_| "tiles/bcts/bcts_2.laz".into());
    Some(Path::new(&folder).join(file))
}

#[test]
fn a_slow_copy_is_one_job_begun_when_it_is_whole() {
    let Some(cloud) = cloud() else { return };
    let bytes = fs::read(&cloud).expect("the cloud");
    let root = tempfile::tempdir().expect("a folder");
    let daemon = Daemon::start(&root.path().join("data"));
    let target = daemon.inbox().join(cloud.file_name().expect("a name"));
    // Opened and closed for every piece, so that no open file gives it away.
    File::create(&target).expect("created");
    let pieces = 6;
    for piece in bytes.chunks(bytes.len() / pieces + 1) {
        let mut file = OpenOptions::new().append(true).open(&target).expect("opened");
        file.write_all(piece).expect("written");
        drop(file);
        let whole = fs::metadata(&target).expect("there").len() == bytes.len() as u64;
        if !whole {
            // Three settle times.
            std::thread::sleep(Duration::from_millis(1200));
            assert!(daemon.jobs().is_empty(), "begun before it was whole");
            wait_for("the word on it", || {
                let waiting = daemon.json("/api/watch")["waiting"].to_string();
                waiting.contains("not whole yet").then_some(())
            });
        }
    }
    let name = cloud.file_name().expect("a name").to_string_lossy().into_owned();
    let name = name.trim_end_matches(".laz").trim_end_matches(".las").trim_end_matches(".copc");
    let job = daemon.wait(name, "done");
    assert_eq!((daemon.jobs().len(), job["attempts"].as_u64()), (1, Some(1)));
    assert_eq!(job["result"]["points_in"], job["result"]["points_out"]);
    let expected = converted(&[&cloud], &root.path().join(name));
    assert!(content(&daemon.octree(name)) == expected, "other bytes than convert's");
}
