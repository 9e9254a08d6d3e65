//! The same kinds once more, other than the reports had them: names that come again,
//! markers among the tiles, temporary names that no list has, small gaps.

use std::os::unix::fs::symlink;

use super::*;

fn write_at_once(path: &Path, bytes: &[u8]) {
    let hidden = path.with_file_name(".on-its-way.part");
    fs::write(&hidden, bytes).expect("written");
    fs::rename(hidden, path).expect("renamed");
}

#[test]
fn tiles_that_come_again_are_another_octree() {
    let root = root();
    let mut daemon = start(root.path(), "delete", "1");
    for (number, name) in ["city", "city-2", "city-3"].iter().enumerate() {
        let (points_of_one, seed) = (100 * (number as u32 + 1), 10 * number as u64);
        let tiles = [
            ("a.las", las(points_of_one, seed)),
            ("sub/b.las", las(points_of_one, seed + 1)),
            ("lodestone.json", b"{}".to_vec()),
        ];
        let folder = daemon.drop_folder("city", &tiles);
        daemon.wait(name, "done");
        gone(&folder);
        if number == 1 {
            assert!(daemon.stop());
            daemon = start(root.path(), "delete", "1");
        }
    }
    // A file takes the folder's name.
    fs::write(daemon.inbox().join("city.las"), las(50, 7)).expect("dropped");
    daemon.wait("city-4", "done");
    for (name, count) in [("city", 200), ("city-2", 400), ("city-3", 600), ("city-4", 50)] {
        assert_eq!(points(&daemon, name), count, "{name}");
    }
}

#[test]
fn whatever_lies_under_a_name_stays() {
    let root = root();
    let daemon = start(root.path(), "delete", "1");
    let own = root.path().join("own");
    fs::create_dir(&own).expect("made");
    fs::write(own.join("diary"), "mine").expect("written");
    symlink(&own, daemon.octree("link")).expect("linked");
    symlink("/nowhere", daemon.octree("dangling")).expect("linked");
    fs::write(daemon.octree("plain"), "a file").expect("written");
    fs::create_dir(daemon.octree("empty")).expect("made");
    for (number, name) in ["link", "dangling", "plain", "empty"].iter().enumerate() {
        let source = daemon.inbox().join(format!("{name}.las"));
        fs::write(&source, las(10 + number as u32, number as u64)).expect("dropped");
        daemon.wait(&format!("{name}-2"), "done");
        gone(&source);
        assert_eq!(points(&daemon, &format!("{name}-2")), 10 + number as u64);
    }
    assert_eq!(fs::read_link(daemon.octree("link")).expect("a link"), own);
    assert_eq!(fs::read_link(daemon.octree("dangling")).expect("a link"), Path::new("/nowhere"));
    assert_eq!(fs::read_to_string(own.join("diary")).expect("there"), "mine");
    assert_eq!(fs::read_to_string(daemon.octree("plain")).expect("there"), "a file");
    assert!(fs::read_dir(daemon.octree("empty")).expect("there").next().is_none());
}

#[test]
fn temporary_names_that_no_list_has() {
    let root = root();
    let daemon = start(root.path(), "delete", "4");
    let bytes = las(8_000, 2);
    let names = ["tile2.las.bc!", ".goutputstream-X1Y2Z3", "part-tile2.las.xltd", "upload17"];
    let path = |number: usize| daemon.inbox().join(format!("city{number}")).join(names[number]);
    for number in 0..names.len() {
        let tiles = [(names[number], bytes[..300].to_vec()), ("tile1.las", las(500 + number as u32, 3))];
        daemon.drop_folder(&format!("city{number}"), &tiles);
    }
    // For twice as long as patience.
    for (piece, bytes) in bytes[300..].chunks(bytes.len() / 8 + 1).enumerate() {
        for number in 0..names.len() {
            let file = OpenOptions::new().append(true).open(path(number));
            file.expect("there").write_all(bytes).expect("written");
        }
        std::thread::sleep(Duration::from_secs(1));
        assert!(daemon.jobs().is_empty(), "taken after piece {piece}: {:?}", daemon.jobs());
    }
    for number in 0..names.len() {
        fs::rename(path(number), path(number).with_file_name("tile2.las")).expect("renamed");
    }
    for number in 0..names.len() as u64 {
        let name = format!("city{number}");
        daemon.wait(&name, "done");
        assert_eq!(points(&daemon, &name), 8_500 + number);
    }
    assert_eq!(daemon.jobs().len(), names.len());
}

/// A copy in the order of names: the marker before, among and after the tiles.
#[test]
fn markers_among_the_tiles_lose_none() {
    let root = root();
    let daemon = start(root.path(), "delete", "4");
    let marker = |number: usize| format!(r#"{{"name": "set{number}"}}"#);
    for (number, order) in ["m12", "1m2", "12m", "m1m2m"].iter().enumerate() {
        let folder = daemon.inbox().join(format!("folder{number}"));
        for step in order.chars() {
            let (name, bytes) = match step {
                'm' => ("lodestone.json", marker(number).into_bytes()),
                '1' => ("tile1.las", las(100 + number as u32, 1)),
                _ => ("tile2.las", las(200 + number as u32, 2)),
            };
            // Its copier makes the folder anew, should it be gone.
            fs::create_dir_all(&folder).expect("made");
            write_at_once(&folder.join(name), &bytes);
            std::thread::sleep(Duration::from_millis(50));
        }
    }
    for number in 0..4u64 {
        wait_for("both tiles", || {
            let name = |suffix: &str| format!("set{number}{suffix}");
            let octrees = [name(""), name("-2"), format!("folder{number}")];
            let there = octrees.iter().filter(|name| daemon.octree(name).join("metadata.json").exists());
            let sum: u64 = there.map(|name| points(&daemon, name)).sum();
            (sum == 300 + 2 * number).then_some(())
        });
        gone(&daemon.inbox().join(format!("folder{number}")));
    }
}

#[test]
fn small_gaps_are_never_deleted() {
    let root = root();
    let daemon = start(root.path(), "delete", "2");
    let bytes = |seed| las(9_000, seed);
    let zeroed = |seed, from: usize, count: usize| {
        let mut bytes = bytes(seed);
        bytes[227 + 20 * from..227 + 20 * (from + count)].fill(0);
        bytes
    };
    // One block that was never written, and room that was reserved and not filled.
    for (name, holes) in [("block.las", 40_960..45_056), ("reserved.las", 81_920..180_227)] {
        let bytes = bytes(holes.start as u64);
        let file = File::create(daemon.inbox().join(name)).expect("created");
        file.set_len(bytes.len() as u64).expect("set");
        file.write_all_at(&bytes[..holes.start], 0).expect("written");
        file.write_all_at(&bytes[holes.end..], holes.end as u64).expect("written");
    }
    write_at_once(&daemon.inbox().join("some.las"), &zeroed(1, 2_000, 20));
    write_at_once(&daemon.inbox().join("last.las"), &zeroed(2, 8_000, 1_000));
    write_at_once(&daemon.inbox().join("first.las"), &zeroed(3, 0, 3_000));
    for name in ["block", "reserved", "some", "last", "first"] {
        let job = daemon.wait(name, "done");
        assert!(job["result"]["notes"].to_string().contains("may not be whole"), "{name}: {job}");
    }
    // A single point at the offset is one.
    let whole = daemon.inbox().join("one.las");
    write_at_once(&whole, &zeroed(4, 2_000, 1));
    gone(&whole);
    all_debts_are_paid(&daemon);
    for name in ["block", "reserved", "some", "last", "first"] {
        assert!(daemon.inbox().join(format!("{name}.las")).exists(), "{name} is gone");
    }
}
