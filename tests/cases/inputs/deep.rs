//! Tiles many folders deep.

use std::fs;

use super::*;
use crate::daemon_support::{Daemon, las};

#[test]
fn tiles_forty_folders_deep_are_not_left_out() {
    let folder = tempfile::tempdir().unwrap();
    let set = folder.path().join("set");
    let deep = (0..40).fold(set.clone(), |folder, _| folder.join("f"));
    fs::create_dir_all(&deep).unwrap();
    fs::write(set.join("a.las"), las(1_000, 1)).unwrap();
    fs::write(deep.join("b.las"), las(1_000, 2)).unwrap();
    becomes(&set, folder.path(), 2_000);

    let daemon = Daemon::start(&folder.path().join("root"));
    fs::rename(&set, daemon.inbox().join("set")).unwrap();
    assert_eq!(daemon.wait("set", "done")["result"]["points_out"], 2_000);
}
