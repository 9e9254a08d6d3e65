//! Inputs that claim more than they are: what they cost, as a table.
//!
//! `docs/bombs.md` is the table as a page; `LODESTONE_WRITE_DOCS=1` writes the part that
//! lies between its marks anew.

use std::fs::{self, File};
use std::os::unix::fs::FileExt;
use std::time::Duration;

use lodestone::convert::context::Cancel;
use lodestone::lab::process::run_within;

use super::*;

const PAGE: &str = "docs/bombs.md";
const BEGIN: &str = "<!-- inputs: made by tests/cases/inputs/bombs.rs -->";
const END: &str = "<!-- end of inputs -->";
const LIMIT: u64 = 256 << 20;
const BESIDE: u64 = 64 << 20;
/// Beyond what real points cost; and what those cost on a busy machine.
const MOST_TIME: Duration = Duration::from_secs(10);
const POINTS_A_SECOND: u64 = 100_000;

/// A file, what it claims, and how many points it really has.
struct Bomb {
    name: &'static str,
    claimed: &'static str,
    real: u64,
    make: fn(&Path),
}

/// An equal point, so often, in chunks of so many.
fn equal(path: &Path, format: u8, points: u64, chunk: u32) {
    let small = path.with_extension("small");
    let length = lodestone::format::las::record_length(format).unwrap();
    let records = records(format, 1);
    common::write_las(&small, &common::options_of(format, true), &records);
    let mut bytes = fs::read(&small).unwrap();
    let at = points_at(&bytes);
    bytes.truncate(at);
    let name = bytes.windows(14).position(|part| part == b"laszip encoded").unwrap() + 52;
    bytes[name + 12..name + 16].copy_from_slice(&chunk.to_le_bytes());
    let said = if format < 6 { LEGACY_COUNT } else { COUNT };
    bytes[said..said + 4].copy_from_slice(&(points as u32).to_le_bytes());
    let vlr = laz::LazVlr::from_buffer(&bytes[name..]).unwrap();
    let mut out = std::io::Cursor::new(bytes);
    out.set_position(at as u64);
    let mut compressor = laz::LasZipCompressor::new(&mut out, vlr).unwrap();
    let block = records.repeat(10_000);
    let mut left = points as usize;
    while left > 0 {
        let now = left.min(10_000);
        compressor.compress_many(&block[..now * length]).unwrap();
        left -= now;
    }
    compressor.done().unwrap();
    drop(compressor);
    fs::write(path, out.into_inner()).unwrap();
}

/// A small file with some of its bytes changed.
fn changed(path: &Path, format: u8, compressed: bool, change: impl FnOnce(&mut Vec<u8>)) {
    let mut bytes = cloud(path.parent().unwrap(), format, compressed, 1_000);
    change(&mut bytes);
    fs::write(path, bytes).unwrap();
}

fn grown(path: &Path, bytes: u64) {
    File::options().write(true).open(path).unwrap().set_len(bytes).unwrap();
}

fn extended_records(path: &Path, number: u32, each: u64) {
    changed(path, 6, false, |bytes| {
        let start = bytes.len() as u64;
        bytes[EVLR..EVLR + 8].copy_from_slice(&start.to_le_bytes());
        bytes[EVLR + 8..EVLR + 12].copy_from_slice(&number.to_le_bytes());
    });
    let start = fs::metadata(path).unwrap().len();
    grown(path, start + u64::from(number) * each);
    let file = File::options().write(true).open(path).unwrap();
    for record in 0..u64::from(number) {
        let mut front = [0; 60];
        front[2..17].copy_from_slice(b"LASF_Projection");
        front[18..20].copy_from_slice(&[2112u16, 34735, 34736, 34737][record as usize % 4].to_le_bytes());
        front[20..28].copy_from_slice(&(each - 60).to_le_bytes());
        file.write_all_at(&front, start + record * each).unwrap();
    }
}

fn bomb(name: &'static str, claimed: &'static str, real: u64, make: fn(&Path)) -> Bomb {
    Bomb { name, claimed, real, make }
}

fn bombs() -> Vec<Bomb> {
    vec![
        bomb("400 extended records of 16 MB, in holes", "6.4 GB of records", 1_000, |path| {
            extended_records(path, 400, 16 << 20);
        }),
        bomb("an extended record of 1 TiB, in holes", "1 TiB of WKT", 1_000, |path| {
            extended_records(path, 1, 1 << 40);
        }),
        bomb("10 000 variable length records of 64 kB", "640 MB of records", 0, |path| {
            changed(path, 1, false, |bytes| {
                let at = points_at(bytes);
                bytes[100..104].copy_from_slice(&10_000u32.to_le_bytes());
                let far = at as u32 + 10_000 * (54 + 65_535);
                bytes[POINTS_AT..POINTS_AT + 4].copy_from_slice(&far.to_le_bytes());
                bytes.truncate(at);
            });
            let start = fs::metadata(path).unwrap().len();
            grown(path, start + 10_000 * (54 + 65_535));
            let file = File::options().write(true).open(path).unwrap();
            let mut front = [0; 54];
            front[2..17].copy_from_slice(b"LASF_Projection");
            front[18..22].copy_from_slice(&[0x40, 0x08, 0xFF, 0xFF]);
            (0..10_000).for_each(|n| file.write_all_at(&front, start + n * (54 + 65_535)).unwrap());
        }),
        bomb("LAS of 10^9 points, all but 1 000 in a hole", "10^9 points", 1_000, |path| {
            changed(path, 6, false, |bytes| {
                bytes[COUNT..COUNT + 8].copy_from_slice(&1_000_000_000u64.to_le_bytes());
            });
            grown(path, 375 + 30 * 1_000_000_000);
        }),
        bomb("LAS with a hole of 1 TiB behind its points", "1 TiB of padding", 1_000, |path| {
            changed(path, 6, false, |_| {});
            grown(path, 1 << 40);
        }),
        bomb("LAZ with its chunk table behind a hole of 1 TiB", "4·10^9 chunks", 1_000, |path| {
            changed(path, 6, true, |bytes| {
                let at = points_at(bytes);
                bytes[at..at + 8].copy_from_slice(&(1u64 << 40).to_le_bytes());
            });
            grown(path, (1 << 40) + 64);
            let file = File::options().write(true).open(path).unwrap();
            file.write_all_at(&u32::MAX.to_le_bytes(), (1 << 40) + 4).unwrap();
        }),
        bomb("LAZ of 1 000 points that counts 50 million", "5·10^7 points", 1_000, |path| {
            changed(path, 6, true, |bytes| {
                bytes[COUNT..COUNT + 8].copy_from_slice(&50_000_000u64.to_le_bytes())
            });
        }),
        bomb("LAZ of 1 000 points that counts 4 billion", "4·10^9 points", 1_000, |path| {
            changed(path, 1, true, |bytes| {
                bytes[LEGACY_COUNT..LEGACY_COUNT + 4].copy_from_slice(&4_000_000_000u32.to_le_bytes());
            });
        }),
        bomb("LAZ in one chunk that counts 40 million", "4·10^7 points", 1_000, |path| {
            changed(path, 1, true, |bytes| {
                let name = bytes.windows(14).position(|part| part == b"laszip encoded").unwrap() + 52;
                bytes[name + 12..name + 16].copy_from_slice(&0xFFFF_FFF0u32.to_le_bytes());
                bytes[LEGACY_COUNT..LEGACY_COUNT + 4].copy_from_slice(&40_000_000u32.to_le_bytes());
            });
        }),
        bomb("LAZ, format 6, a layered chunk of 4 billion points", "4·10^9 points", 1_000, |path| {
            changed(path, 6, true, |bytes| {
                let front = points_at(bytes) + 8 + 30;
                bytes[front..front + 4].copy_from_slice(&u32::MAX.to_le_bytes());
            });
        }),
        bomb("LAZ, format 6, one point 4 million times in a chunk", "4·10^6 points", 4_000_000, |path| {
            equal(path, 6, 4_000_000, 4_000_000);
        }),
        bomb("LAZ, format 6, one point 6 million times in 2 chunks", "6·10^6 points", 6_000_000, |path| {
            equal(path, 6, 6_000_000, 3_000_000);
        }),
        bomb("LAZ, format 1, one point 4 million times in a chunk", "4·10^6 points", 4_000_000, |path| {
            equal(path, 1, 4_000_000, 4_000_000);
        }),
    ]
}

struct Row {
    lasting: String,
    size: String,
    time: f64,
    peak: u64,
}

impl Row {
    fn line(&self) -> String {
        let time = match self.time {
            time if time < 1.0 => "< 1 s",
            time if time < 3.0 => "< 3 s",
            time if time < 10.0 => "< 10 s",
            _ => "> 10 s",
        };
        format!("{} {} | {time} | {} MB |", self.lasting, self.size, self.peak.div_ceil(32) * 32)
    }
}

fn explode(bomb: &Bomb, folder: &Path) -> Row {
    let name = if bomb.name.starts_with("LAZ") { "bomb.laz" } else { "bomb.las" };
    let (input, octree) = (folder.join(name), folder.join("octree"));
    (bomb.make)(&input);
    let mut command = Command::new(LODESTONE);
    command.args([
        "convert",
        "--threads",
        "4",
        "--memory-limit",
        "256M",
        "--overwrite",
        "--progress",
        "none",
    ]);
    command.args(["--log", "off", "-o"]).args([&octree, &input]).stdout(std::process::Stdio::null());
    let said = folder.join("said");
    command.stderr(File::create(&said).unwrap());
    let most = MOST_TIME + Duration::from_secs(bomb.real.div_ceil(POINTS_A_SECOND));
    let ended = run_within(&mut command, most, &Cancel::default()).unwrap();
    let said = fs::read_to_string(said).unwrap();
    assert!(!ended.late, "{}: took more than {most:?}", bomb.name);
    assert!(ended.run.peak <= LIMIT + BESIDE, "{}: took {} MB", bomb.name, ended.run.peak >> 20);
    assert!(!said.contains("panicked"), "{}: {said}", bomb.name);
    let outcome = match ended.status.code() {
        Some(0 | 3) => {
            assert_eq!(points_in(&octree), bomb.real, "{}: {said}", bomb.name);
            "converted"
        }
        Some(1) => "refused",
        code => panic!("{} ended with {code:?}: {said}", bomb.name),
    };
    let bytes = fs::metadata(&input).unwrap().len();
    fs::remove_file(&input).unwrap();
    let _ = fs::remove_dir_all(&octree);
    let lasting = format!("| {} | {} | {} | {outcome} |", bomb.name, bomb.claimed, bomb.real);
    Row { lasting, size: grouped(bytes), time: ended.run.wall, peak: ended.run.peak >> 20 }
}

/// Of the octree and of what was set aside.
fn points_in(octree: &Path) -> u64 {
    let report = fs::read_to_string(octree.join("report.json")).unwrap();
    let report: serde_json::Value = serde_json::from_str(&report).unwrap();
    report["points_in"].as_u64().unwrap()
}

fn grouped(bytes: u64) -> String {
    match bytes {
        0..1_000_000 => format!("{} kB", bytes.div_ceil(1000)),
        1_000_000..1_000_000_000 => format!("{} MB", bytes / 1_000_000),
        _ => format!("{} GB", bytes / 1_000_000_000),
    }
}

#[test]
fn bombs_cost_no_more_than_their_real_points() {
    let folder = tempfile::tempdir().unwrap();
    let rows: Vec<Row> = bombs()
        .iter()
        .map(|bomb| {
            let row = explode(bomb, folder.path());
            println!("{}", row.line());
            row
        })
        .collect();
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(PAGE);
    let page = fs::read_to_string(&path).unwrap();
    let (begin, end) = (page.find(BEGIN).unwrap() + BEGIN.len(), page.find(END).unwrap());
    if std::env::var_os("LODESTONE_WRITE_DOCS").is_some_and(|wish| wish == "1") {
        let head = "| file | claims | real points | outcome | size | time | memory |\n|---|---|---|---|---|---|---|\n";
        let lines: String = rows.iter().map(|row| row.line() + "\n").collect();
        fs::write(&path, format!("{}\n\n{head}{lines}\n{}", &page[..begin], &page[end..])).unwrap();
        return;
    }
    for row in &rows {
        assert!(page[begin..end].contains(&row.lasting), "{PAGE} does not have: {}", row.lasting);
    }
}
