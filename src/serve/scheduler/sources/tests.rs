//! Files that somebody may have no second copy of.

use std::fs;
use std::os::unix::fs::{MetadataExt, symlink};
use std::path::{Path, PathBuf};

use super::*;

struct Place {
    folder: tempfile::TempDir,
    plan: SourceActionPlan,
}

impl Place {
    /// A data set of these files, converted as they are.
    fn new(what: OnDone, source: &str, files: &[&str]) -> Place {
        let folder = tempfile::tempdir().expect("a folder");
        let root = folder.path().canonicalize().expect("a path").join("inbox");
        let source = root.join(source);
        let mut plan = SourceActionPlan {
            source: source.clone(),
            name: "city".into(),
            revision: 2,
            inputs: vec![],
            what,
            roots: vec![root],
            done: folder.path().join("done"),
            reserve: 0,
            octree: folder.path().join("octrees/city"),
            seal: None,
        };
        fs::create_dir_all(&plan.octree).expect("made");
        fs::write(plan.octree.join("metadata.json"), "{}").expect("written");
        plan.seal = seal(&plan.octree);
        for file in files {
            let path = if file.is_empty() { source.clone() } else { source.join(file) };
            fs::create_dir_all(path.parent().expect("a folder")).expect("made");
            fs::write(&path, format!("content of {file}")).expect("written");
            plan.inputs.push(input(&path));
        }
        Place { folder, plan }
    }

    fn put_away(&self) -> Result<SourceActionOutcome, NotMoved> {
        put_away(&self.plan, &Disk::new(), &Cancel::default())
    }

    fn done(&self, name: &str) -> PathBuf {
        self.folder.path().join("done/city").join(name)
    }

    /// What was refused, and that nothing was touched.
    fn stays(&self, word: &str) {
        let Err(NotMoved::ForGood(why)) = self.put_away() else { panic!("it was put away") };
        assert!(why.contains(word), "{why}");
        for input in &self.plan.inputs {
            assert!(input.path.symlink_metadata().is_ok(), "{} is gone", input.path.display());
        }
    }
}

fn input(path: &Path) -> QueuedFile {
    let meta = fs::metadata(path).expect("there");
    QueuedFile {
        path: path.to_path_buf(),
        size: meta.len(),
        mtime_ns: meta.mtime() * 1_000_000_000 + meta.mtime_nsec(),
        hash: blake3::hash(&fs::read(path).expect("readable")).to_hex().to_string(),
        inode: meta.ino(),
        ctime_ns: meta.ctime() * 1_000_000_000 + meta.ctime_nsec(),
    }
}

#[test]
fn a_file_moves_and_nothing_in_its_place_is_ever_overwritten() {
    for (there, name) in
        [(vec![], "a.las"), (vec!["a.las"], "a-r2.las"), (vec!["a.las", "a-r2.las"], "a-r2-2.las")]
    {
        let place = Place::new(OnDone::Move, "a.las", &[""]);
        for name in &there {
            fs::create_dir_all(place.done("")).expect("made");
            fs::write(place.done(name), "of old").expect("written");
        }
        assert_eq!(place.put_away(), Ok(SourceActionOutcome::Moved(place.done(name))));
        assert!(there.iter().all(|name| fs::read_to_string(place.done(name)).expect("there") == "of old"));
        assert_eq!(fs::read_to_string(place.done(name)).expect("there"), "content of ");
        assert!(!place.plan.source.exists());
        assert_eq!(place.put_away(), Ok(SourceActionOutcome::Gone), "asked again after a crash");
    }
}

#[test]
fn a_folder_moves_as_a_folder_with_all_that_is_in_it() {
    let place = Place::new(OnDone::Move, "tiles", &["a.las", "deep/b.las"]);
    fs::write(place.plan.source.join("notes.txt"), "mine").expect("written");
    assert_eq!(place.put_away(), Ok(SourceActionOutcome::Moved(place.done("tiles"))));
    for name in ["a.las", "deep/b.las", "notes.txt"] {
        assert!(place.done("tiles").join(name).exists(), "{name}");
    }
    assert!(!place.plan.source.exists());
}

#[test]
fn deleting_a_folder_takes_what_was_converted_and_leaves_what_is_somebodys_own() {
    let place = Place::new(OnDone::Delete, "tiles", &["a.las", "deep/b.las"]);
    fs::write(place.plan.source.join(marker::NAME), "{}").expect("written");
    assert_eq!(place.put_away(), Ok(SourceActionOutcome::Removed));
    assert!(!place.plan.source.exists());

    let place = Place::new(OnDone::Delete, "tiles", &["a.las", "deep/b.las"]);
    fs::write(place.plan.source.join("notes.txt"), "mine").expect("written");
    assert_eq!(place.put_away(), Ok(SourceActionOutcome::Removed));
    let left: Vec<_> =
        fs::read_dir(&place.plan.source).expect("there").map(|e| e.expect("one").file_name()).collect();
    assert_eq!(left, ["notes.txt"]);
}

#[test]
fn what_changed_or_came_since_is_never_touched() {
    for what in [OnDone::Move, OnDone::Delete] {
        let place = Place::new(what, "a.las", &[""]);
        fs::write(&place.plan.source, "other content").expect("written");
        place.stays("has changed");

        let place = Place::new(what, "tiles", &["a.las"]);
        fs::write(place.plan.source.join("late.laz"), "not converted").expect("written");
        place.stays("late.laz");
        fs::rename(place.plan.source.join("late.laz"), place.plan.source.join("late.laz.part"))
            .expect("renamed");
        place.stays("late.laz.part");
    }
    let place = Place::new(OnDone::Move, "tiles", &["a.las", "b.las"]);
    fs::remove_file(place.plan.source.join("b.las")).expect("removed");
    let Err(NotMoved::ForGood(why)) = place.put_away() else { panic!("half of it was moved") };
    assert!(why.contains("b.las"), "{why}");
}

#[test]
fn nothing_is_done_through_links_or_outside_of_the_watched_folders() {
    for what in [OnDone::Move, OnDone::Delete] {
        let mut place = Place::new(what, "a.las", &[""]);
        place.plan.roots = vec![place.folder.path().join("elsewhere")];
        place.stays("watched folder");

        // The tile, a folder, or the source itself is a link.
        let place = Place::new(what, "tiles", &["a.las", "deep/b.las"]);
        let away = place.folder.path().join("away");
        for name in ["a.las", "deep"] {
            fs::rename(place.plan.source.join(name), &away).expect("moved");
            symlink(&away, place.plan.source.join(name)).expect("linked");
            let Err(NotMoved::ForGood(_)) = place.put_away() else { panic!("through a link") };
            assert!(away.exists());
            fs::remove_file(place.plan.source.join(name)).expect("removed");
            fs::rename(&away, place.plan.source.join(name)).expect("back");
        }
        fs::rename(&place.plan.source, &away).expect("moved");
        symlink(&away, &place.plan.source).expect("linked");
        let Err(NotMoved::ForGood(_)) = place.put_away() else { panic!("through a link") };
        assert!(away.join("a.las").exists() && away.join("deep/b.las").exists());
    }
}

#[test]
fn a_missing_mount_is_waited_for() {
    let place = Place::new(OnDone::Delete, "a.las", &[""]);
    fs::rename(place.folder.path().join("inbox"), place.folder.path().join("away")).expect("gone");
    assert!(matches!(place.put_away(), Err(NotMoved::ForNow(_))));
}

/// Everything but the rename itself, of a move to another file system: as if cut
/// off by a crash before the sources were removed, and in the middle of that.
#[test]
fn a_copy_to_another_disk_is_whole_before_anything_is_removed() {
    let files = ["a.las", "deep/b.las", "deep/c.las"];
    for removed in 0..=files.len() {
        let place = Place::new(OnDone::Move, "tiles", &files);
        let looked = listing::look(&place.plan.roots[0], "tiles".as_ref()).expect("fine").expect("there");
        let (disk, cancel) = (Disk::new(), Cancel::default());
        fs::create_dir_all(place.done("")).expect("made");
        relocate::copy(&place.plan, &looked, &place.done(""), &place.done("tiles"), &disk, &cancel)
            .expect("copied");
        for file in &files[..removed] {
            assert_eq!(
                fs::read(place.plan.source.join(file)).expect("still there"),
                fs::read(place.done("tiles").join(file)).expect("copied")
            );
            fs::remove_file(place.plan.source.join(file)).expect("removed");
        }
        assert_eq!(
            place.put_away(),
            Ok(SourceActionOutcome::Moved(place.done("tiles"))),
            "{removed} removed"
        );
        assert!(!place.plan.source.exists());
        assert_eq!(fs::read_dir(place.done("")).expect("there").count(), 1, "no second copy");
        assert_eq!(fs::read_dir(place.done("tiles/deep")).expect("there").count(), 2);
    }
}

/// With a full disk, or another fault, at each step in turn: the source is there
/// whole, or its copy is.
#[test]
fn a_fault_at_any_step_of_a_copy_loses_nothing() {
    let mut finished = false;
    for nth in 0..40 {
        let place = Place::new(OnDone::Move, "a.las", &[""]);
        let looked = listing::look(&place.plan.roots[0], "a.las".as_ref()).expect("fine").expect("there");
        fs::create_dir_all(place.done("")).expect("made");
        let disk = Disk::failing_from(nth, std::io::ErrorKind::StorageFull);
        let target = place.done("a.las");
        let copied =
            relocate::copy(&place.plan, &looked, &place.done(""), &target, &disk, &Cancel::default());
        finished |= copied.is_ok();
        assert!(place.plan.source.exists());
        assert!(!target.exists() || fs::read(&target).expect("whole") == b"content of ");
        assert_eq!(
            place.put_away(),
            Ok(SourceActionOutcome::Moved(target)),
            "after fault {nth}, with room again"
        );
    }
    assert!(finished, "the faults never ended");
}

#[test]
fn a_copy_to_another_disk_leaves_the_reserve_alone() {
    let mut place = Place::new(OnDone::Move, "a.las", &[""]);
    place.plan.reserve = u64::MAX / 2;
    let looked = listing::look(&place.plan.roots[0], "a.las".as_ref()).expect("fine").expect("there");
    fs::create_dir_all(place.done("")).expect("made");
    let target = place.done("a.las");
    let copied =
        relocate::copy(&place.plan, &looked, &place.done(""), &target, &Disk::new(), &Cancel::default());
    let Err(NotMoved::ForNow(why)) = copied else { panic!("it was copied") };
    assert!(why.contains("free") && !target.exists(), "{why}");
}

#[test]
fn a_content_that_is_not_what_was_converted_is_not_moved_to_another_disk() {
    let mut place = Place::new(OnDone::Move, "a.las", &[""]);
    place.plan.inputs[0].hash = blake3::hash(b"other").to_hex().to_string();
    let looked = listing::look(&place.plan.roots[0], "a.las".as_ref()).expect("fine").expect("there");
    let target = place.done("a.las");
    let disk = Disk::new();
    disk.create_dir_all(&place.done("")).expect("made");
    let copied = relocate::copy(&place.plan, &looked, &place.done(""), &target, &disk, &Cancel::default());
    assert!(matches!(copied, Err(NotMoved::ForGood(_))) && !target.exists() && place.plan.source.exists());
}

#[test]
fn the_marker_of_a_folder_decides_and_a_spoiled_one_keeps_all() {
    let place = Place::new(OnDone::Move, "tiles", &["a.las"]);
    let layer = toml::from_str("on_done = 'delete'").expect("a layer");
    let config = Config::from_layer(layer).expect("a configuration");
    for (text, what) in [
        ("{}", OnDone::Delete),
        (r#"{"on_done": "keep"}"#, OnDone::Keep),
        (r#"{"on_done": "move"}"#, OnDone::Move),
        ("not JSON", OnDone::Keep),
    ] {
        fs::write(place.plan.source.join(marker::NAME), text).expect("written");
        assert_eq!(wish(&config, &place.plan.source), what, "{text}");
    }
    assert_eq!(wish(&config, &place.plan.source.join("a.las")), OnDone::Delete);
}

/// Neither size nor time tells; reading it does.
#[test]
fn other_content_of_the_same_size_and_time_stays() {
    for what in [OnDone::Move, OnDone::Delete] {
        for files in [&[""][..], &["a.las", "deep/b.las"][..]] {
            let place = Place::new(what, "set", files);
            let path = &place.plan.inputs[files.len() - 1].path;
            let time = fs::metadata(path).expect("there").modified().expect("a time");
            let other = vec![b'x'; place.plan.inputs[files.len() - 1].size as usize];
            fs::write(path, other).expect("written");
            fs::File::options().append(true).open(path).expect("there").set_modified(time).expect("set");
            place.stays("not what was converted");
        }
    }
}

#[test]
fn without_its_octree_a_source_stays() {
    for what in [OnDone::Move, OnDone::Delete] {
        let place = Place::new(what, "a.las", &[""]);
        fs::write(place.plan.octree.join("metadata.json"), "{\"another\": 1}").expect("written");
        place.stays("not the octree");
        fs::remove_dir_all(&place.plan.octree).expect("removed");
        place.stays("no longer there");
        fs::create_dir(&place.plan.octree).expect("made");
        place.stays("not the octree");
        let mut old = Place::new(what, "a.las", &[""]);
        old.plan.seal = None;
        assert!(old.put_away().is_ok(), "an earlier version noted nothing");
    }
}

#[test]
fn a_source_that_is_written_to_waits() {
    let place = Place::new(OnDone::Delete, "a.las", &[""]);
    let writer = fs::File::options().append(true).open(&place.plan.source).expect("opened");
    assert!(matches!(place.put_away(), Err(NotMoved::ForNow(_))));
    drop(writer);
    assert_eq!(place.put_away(), Ok(SourceActionOutcome::Removed));
}

#[test]
fn what_systems_left_goes_and_what_is_somebodys_own_keeps_it() {
    let apple = b"\0\x05\x16\x07rest";
    let place = Place::new(OnDone::Delete, "tiles", &["a.las", "deep/b.las"]);
    fs::write(place.plan.source.join("._a.las"), apple).expect("written");
    fs::write(place.plan.source.join("deep/.DS_Store"), "x").expect("written");
    fs::create_dir(place.plan.source.join("__MACOSX")).expect("made");
    fs::write(place.plan.source.join("__MACOSX/._a.las"), apple).expect("written");
    assert_eq!(place.put_away(), Ok(SourceActionOutcome::Removed));
    assert!(!place.plan.source.exists());
    for (name, text) in [("notes.txt", &b"mine"[..]), ("._b.las", b"LASF"), ("._c.las", b"")] {
        let place = Place::new(OnDone::Delete, "tiles", &["a.las"]);
        fs::write(place.plan.source.join(name), text).expect("written");
        fs::write(place.plan.source.join(".DS_Store"), "x").expect("written");
        assert_eq!(place.put_away(), Ok(SourceActionOutcome::Removed));
        assert!(
            place.plan.source.join(name).exists() && place.plan.source.join(".DS_Store").exists(),
            "{name}"
        );
    }
}
