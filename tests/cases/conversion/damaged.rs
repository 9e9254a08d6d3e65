//! Cut and damaged LAS and LAZ: refused with the number of points that could be
//! read, or converted as far as they can be read where that is asked for; and
//! then the octree holds exactly those points, as the checker finds on its own.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::common::{convert, options_of, surface, write_las};
use crate::daemon_support::{Daemon, las};
use lodestone::convert::options::{Damaged, Options};
use lodestone::convert::run::ConversionOutcome;
use lodestone::format::las::{LasFile, record_length};
use lodestone::verify::{self, SpacingRule, VerifyReport};

/// Three LAZ chunks, the last of them shorter.
const POINTS: u64 = 120_000;
const CHUNK: u64 = 50_000;

struct Bench {
    folder: tempfile::TempDir,
    records: Vec<u8>,
    format: u8,
}

impl Bench {
    fn new(format: u8, compressed: bool) -> Bench {
        let folder = tempfile::tempdir().unwrap();
        let records = surface(format, POINTS, 7);
        write_las(&folder.path().join("whole"), &options_of(format, compressed), &records);
        Bench { folder, records, format }
    }

    fn whole(&self) -> Vec<u8> {
        fs::read(self.folder.path().join("whole")).unwrap()
    }

    fn input(&self) -> PathBuf {
        self.folder.path().join("broken.laz")
    }

    fn octree(&self) -> PathBuf {
        self.folder.path().join("octree")
    }

    fn convert(&self, bytes: &[u8], damaged: Damaged) -> Result<ConversionOutcome, String> {
        fs::write(self.input(), bytes).unwrap();
        let _ = fs::remove_dir_all(self.octree());
        let options = Options { damaged, ..Options::default() };
        convert(&[self.input()], &self.octree(), &options).map_err(|e| e.to_string())
    }

    /// Refused, with these counts and the way out.
    fn is_refused(&self, bytes: &[u8], readable: u64) {
        let error = self.convert(bytes, Damaged::Fail).unwrap_err();
        assert!(error.contains(&format!("{readable} of its {POINTS} points")), "{error}");
        assert!(error.contains("--damaged keep") && error.contains("broken.laz"), "{error}");
        assert!(!self.octree().exists());
    }

    /// Converted as far as it can be read: these points of the whole, from and to.
    fn is_kept(&self, bytes: &[u8], points: &[(u64, u64)]) -> ConversionOutcome {
        let outcome = self.convert(bytes, Damaged::Keep).unwrap();
        let readable: u64 = points.iter().map(|(from, to)| to - from).sum();
        assert_eq!((outcome.points_in, outcome.points_missing), (readable, POINTS - readable));
        assert_eq!(outcome.points_out + outcome.points_set_aside, readable);
        // Not only as many points, but those: against a file made of them.
        let length = record_length(self.format).unwrap() as u64;
        let parts =
            points.iter().map(|(from, to)| &self.records[(from * length) as usize..(to * length) as usize]);
        let sound = self.folder.path().join("sound.las");
        write_las(&sound, &options_of(self.format, false), &parts.collect::<Vec<_>>().concat());
        assert!(verified(&self.octree(), &sound, false).unwrap().ok);
        let report = verified(&self.octree(), &self.input(), true).unwrap();
        assert!(report.ok, "{report:#?}");
        outcome
    }
}

fn verified(octree: &Path, input: &Path, damaged: bool) -> Result<VerifyReport, verify::VerifyError> {
    verify::verify(&verify::VerifyRequest {
        octree: octree.to_path_buf(),
        against: vec![input.to_path_buf()],
        damaged,
        memory_limit: 1 << 30,
        spacing: SpacingRule::Auto,
    })
}

/// Where a LAZ file's chunk table lies, as the eight bytes in front of its points
/// say, and where those are.
fn chunk_table(bytes: &[u8]) -> (usize, usize) {
    let start = u32::from_le_bytes(bytes[96..100].try_into().unwrap()) as usize;
    (start, u64::from_le_bytes(bytes[start..start + 8].try_into().unwrap()) as usize)
}

#[test]
fn of_a_cut_las_the_whole_records_are_kept() {
    let bench = Bench::new(3, false);
    let whole = bench.whole();
    let start = whole.len() - POINTS as usize * 34;
    let cut = &whole[..start + 70_000 * 34 + 17];
    bench.is_refused(cut, 70_000);
    let outcome = bench.is_kept(cut, &[(0, 70_000)]);
    assert!(
        outcome.repairs.iter().any(|n| n.contains("70000 of its 120000 points")),
        "{:?}",
        outcome.repairs
    );
    // Nobody who does not ask for it takes the part for the whole.
    assert!(verified(&bench.octree(), &bench.input(), false).is_err());
}

#[test]
fn a_whole_file_is_converted_the_same_in_both_modes() {
    for (format, compressed) in [(3, false), (3, true), (7, true)] {
        let bench = Bench::new(format, compressed);
        bench.convert(&bench.whole(), Damaged::Fail).unwrap();
        let expected = crate::common::octree_bytes(&bench.octree());
        let outcome = bench.is_kept(&bench.whole(), &[(0, POINTS)]);
        // Times are noise here, and some of them are no numbers.
        let told = [outcome.repairs, outcome.notes].concat();
        assert!(told.iter().all(|note| note.contains("no number")), "{told:?}");
        assert_eq!(crate::common::octree_bytes(&bench.octree()), expected);
    }
}

/// Points of the formats 0 to 5 are decoded up to the very cut, though the chunk
/// table is gone; of 6 to 10, whose chunks are layers, whole chunks.
#[test]
fn of_a_cut_laz_what_came_before_the_cut_is_kept() {
    let bench = Bench::new(3, true);
    let whole = bench.whole();
    let (start, table) = chunk_table(&whole);
    let cut = &whole[..start + (table - start) * 3 / 5];
    let outcome = bench.convert(cut, Damaged::Keep).unwrap();
    assert!((CHUNK..2 * CHUNK).contains(&outcome.points_in), "{}", outcome.points_in);
    bench.is_refused(cut, outcome.points_in);
    bench.is_kept(cut, &[(0, outcome.points_in)]);

    let bench = Bench::new(7, true);
    let whole = bench.whole();
    let (start, table) = chunk_table(&whole);
    let cut = &whole[..start + (table - start) * 3 / 5];
    bench.is_refused(cut, CHUNK);
    bench.is_kept(cut, &[(0, CHUNK)]);
}

#[test]
fn without_its_chunk_table_a_laz_loses_nothing() {
    for format in [3, 7] {
        let bench = Bench::new(format, true);
        let whole = bench.whole();
        let cut = &whole[..chunk_table(&whole).1];
        bench.is_kept(cut, &[(0, POINTS)]);
        assert_eq!(bench.convert(cut, Damaged::Fail).unwrap().points_in, POINTS);
    }
}

#[test]
fn a_damaged_chunk_in_the_middle_takes_only_its_own_points() {
    for format in [3, 7] {
        let bench = Bench::new(format, true);
        let mut bytes = bench.whole();
        let (start, table) = chunk_table(&bytes);
        // The second of three chunks, the last of which is the smallest; at its
        // front where it is layered, for only there damage shows.
        let second = LasFile::open(&bench.folder.path().join("whole")).unwrap().slices(1)[1];
        assert_eq!((second.first, u64::from(second.points)), (CHUNK, CHUNK));
        let at = match format {
            3 => start + (table - start) / 2,
            _ => second_layered(&bytes, start, format) + record_length(format).unwrap() + 4,
        };
        bytes[at..at + 24].fill(0xA5);
        bench.is_refused(&bytes, POINTS - CHUNK);
        let outcome = bench.is_kept(&bytes, &[(0, CHUNK), (2 * CHUNK, POINTS)]);
        let told = "the points 50000 to 99999 are lost";
        assert!(outcome.repairs.iter().any(|repair| repair.contains(told)), "{:?}", outcome.repairs);
    }
}

/// Where the second layered chunk begins: behind the first one's layers, whose
/// sizes stand behind its first record and the number of its points.
fn second_layered(bytes: &[u8], start: usize, format: u8) -> usize {
    let (first, layers) = (start + 8, 10);
    let sizes = first + record_length(format).unwrap() + 4;
    let words = bytes[sizes..sizes + 4 * layers].chunks_exact(4);
    sizes + 4 * layers + words.map(|w| u32::from_le_bytes(w.try_into().unwrap()) as usize).sum::<usize>()
}

/// A network drive that goes away in the middle is no damage: nothing of what it
/// holds is given up for it. More files than are kept open, so that some have to
/// be opened anew.
#[test]
fn a_file_that_cannot_be_read_is_not_taken_for_a_damaged_one() {
    let bench = Bench::new(3, true);
    let whole = bench.whole();
    for end in [whole.len(), chunk_table(&whole).1] {
        fs::write(bench.input(), &whole[..end]).unwrap();
        let mut files: Vec<LasFile> =
            (0..100).map(|_| LasFile::open_readable(&bench.input()).unwrap()).collect();
        fs::remove_file(bench.input()).unwrap();
        let last = files.last_mut().unwrap();
        assert!(last.leave_out_damaged(|_| true).is_err());
        assert_eq!((last.header().points, last.header().missing), (POINTS, 0));
    }
}

/// Of several tiles, the sound ones are converted whole, and one of which
/// nothing can be read is told of.
#[test]
fn a_broken_tile_does_not_keep_the_others_out() {
    let folder = tempfile::tempdir().unwrap();
    let tiles = folder.path().join("tiles");
    fs::create_dir(&tiles).unwrap();
    fs::write(tiles.join("a.las"), las(5_000, 1)).unwrap();
    fs::write(tiles.join("b.las"), &las(5_000, 2)[..227 + 20 * 1_000 + 3]).unwrap();
    fs::write(tiles.join("c.las"), &las(5_000, 3)[..227]).unwrap();
    let octree = folder.path().join("octree");
    let options = Options { damaged: Damaged::Keep, ..Options::default() };
    let outcome = convert(std::slice::from_ref(&tiles), &octree, &options).unwrap();
    assert_eq!((outcome.points_in, outcome.points_missing), (6_000, 9_000));
    assert!(verified(&octree, &tiles, true).unwrap().ok);
}

#[test]
fn the_exit_code_tells_that_points_are_missing() {
    let folder = tempfile::tempdir().unwrap();
    let (input, octree) = (folder.path().join("cut.las"), folder.path().join("octree"));
    fs::write(&input, &las(1_000, 1)[..10_000]).unwrap();
    let run = |command: &str, more: &[&str]| {
        let mut run = Command::new(env!("CARGO_BIN_EXE_lodestone"));
        match command {
            "convert" => run.arg("convert").arg(&input).arg("-o").arg(&octree),
            _ => run.arg("verify").arg(&octree).arg("--against").arg(&input),
        };
        let output = run.args(more).output().unwrap();
        let said = [output.stdout, output.stderr].concat();
        (output.status.code(), String::from_utf8(said).unwrap())
    };
    let (code, said) = run("convert", &[]);
    assert!(code == Some(1) && said.contains("488 of its 1000 points"), "{said}");
    let (code, said) = run("convert", &["--damaged", "keep", "--progress", "plain"]);
    assert_eq!(code, Some(3), "{said}");
    assert!(said.contains("512 of the 1000 points that the input promises could not be read"), "{said}");
    assert_eq!(run("verify", &[]).0, Some(1));
    assert_eq!(run("verify", &["--damaged", "keep"]).0, Some(0));
}

/// By its configuration, the daemon takes a cut file once its patience is over;
/// by `lodestone.json` a single data set says so for itself.
#[test]
fn the_daemon_converts_cut_files_where_it_is_told_to() {
    let root = tempfile::tempdir().unwrap();
    let cut = &las(1_000, 1)[..10_000];
    let daemon =
        Daemon::start_with(&root.path().join("keeps"), &["--patience-seconds", "1", "--damaged", "keep"]);
    fs::write(daemon.inbox().join("cut.las"), cut).unwrap();
    let job = daemon.wait("cut", "done");
    assert_eq!(job["result"]["points_out"], 488);
    let details = daemon.json(&format!("/api/jobs/{}", job["id"]));
    let text = details.to_string();
    assert!(text.contains("488 of its 1000 points") && text.contains("\"points_missing\":512"), "{text}");
    drop(daemon);

    let daemon = Daemon::start_with(&root.path().join("fails"), &["--patience-seconds", "1"]);
    fs::write(daemon.inbox().join("plain.las"), cut).unwrap();
    let error = daemon.wait("plain", "failed")["error"].to_string();
    assert!(error.contains("488 of its 1000 points") && error.contains("damaged = "), "{error}");
    let folder = daemon.inbox().join("set");
    fs::create_dir(&folder).unwrap();
    fs::write(folder.join("cut.las"), &las(1_000, 2)[..10_000]).unwrap();
    fs::write(folder.join("lodestone.json"), r#"{"options": {"damaged": "keep"}}"#).unwrap();
    assert_eq!(daemon.wait("set", "done")["result"]["points_out"], 488);
}
