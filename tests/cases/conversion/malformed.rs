//! Every malformed file, in both modes, by the program itself in an address space
//! that its size justifies: what becomes of it, what is said, how long it takes.
//! `docs/malformed.md` is that as a page. `LODESTONE_WRITE_DOCS=1` writes it;
//! otherwise the test fails where outcome or message are not the page's.
//!
//! Runs where LODESTONE_DATA names the folder of real clouds.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

const LODESTONE: &str = env!("CARGO_BIN_EXE_lodestone");
const PAGE: &str = "docs/malformed.md";

/// Address space that a file may take beyond what a small good one takes and its
/// own bytes justify.
const MOST_BEYOND: u64 = 256 << 20;
/// Bytes of memory that a byte of input justifies: its record decoded, in a run
/// and in a node, beside what finds the node.
const PER_BYTE: u64 = 16;
/// What a file may take beyond the cost of its readable points.
const MOST_TIME: Duration = Duration::from_secs(10);

const OPENING: &str = "\
# Malformed files

Made by `tests/cases/conversion/malformed.rs` from real files of other projects' tests; written
anew by `LODESTONE_WRITE_DOCS=1 cargo test --release --test malformed`. Each is
converted by a process that may take 256 MiB of address space beyond what a small
good file takes and its own size justifies. What is converted is verified. `fail`
and `keep` are the modes of `--damaged`.

";

/// One conversion of one file.
struct Row {
    file: String,
    mode: &'static str,
    outcome: String,
    said: String,
    time: Duration,
}

impl Row {
    /// A line of the table without the time, which no two runs share.
    fn lasting(&self) -> String {
        format!("| {} | {} | {} | {} |", self.file, self.mode, self.outcome, self.said.replace('|', "\\|"))
    }

    fn line(&self) -> String {
        format!("{} {} |", self.lasting(), rounded(self.time))
    }
}

/// So coarse that the page only changes where something changed.
fn rounded(time: Duration) -> &'static str {
    match time.as_millis() {
        0..1000 => "< 1 s",
        1000..3000 => "< 3 s",
        3000..10_000 => "< 10 s",
        _ => "> 10 s",
    }
}

fn limited(kilobytes: u64, arguments: &[&str]) -> std::process::Output {
    let line = format!("ulimit -v {kilobytes}; exec \"$@\"");
    Command::new("sh").args(["-c", &line, "sh", LODESTONE]).args(arguments).output().unwrap()
}

/// Kilobytes of address space without which a small good file is not converted:
/// the program, its threads' stacks and the allocator's arenas.
fn base(folder: &Path) -> u64 {
    let small = folder.join("small.las");
    crate::common::write_las(
        &small,
        &crate::common::options_of(1, false),
        &crate::common::surface(1, 100, 1),
    );
    let converts = |megabytes: u64| {
        let output = convert_arguments(&small, &folder.join("octree"), "fail");
        let arguments: Vec<&str> = output.iter().map(String::as_str).collect();
        limited(megabytes << 10, &arguments).status.success()
    };
    let (mut low, mut high) = (0, 4096);
    assert!(converts(high), "a small file takes more than 4 GiB");
    while high - low > 16 {
        let middle = (low + high) / 2;
        if converts(middle) { high = middle } else { low = middle }
    }
    high << 10
}

fn convert_arguments(input: &Path, octree: &Path, mode: &str) -> Vec<String> {
    let options =
        ["convert", "--threads", "2", "--memory-limit", "128M", "--overwrite", "--progress", "plain"];
    let mut line: Vec<String> = options.map(str::to_string).to_vec();
    line.extend(["--log", "off", "--damaged", mode, "-o"].map(str::to_string));
    line.extend([octree, input].map(|path| path.to_str().unwrap().to_string()));
    line
}

fn convert(input: &Path, folder: &Path, mode: &'static str, base: u64) -> Row {
    let octree = folder.join("octree");
    let _ = fs::remove_dir_all(&octree);
    let arguments = convert_arguments(input, &octree, mode);
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let file = input.file_name().unwrap().to_string_lossy().into_owned();
    let bytes = fs::metadata(input).unwrap().len();
    let start = Instant::now();
    let output = limited(base + ((MOST_BEYOND + PER_BYTE * bytes) >> 10), &arguments);
    let time = start.elapsed();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).replace(&input.display().to_string(), &file);
    let (stdout, stderr) = (text(&output.stdout), text(&output.stderr));
    assert!(!stderr.contains("panicked"), "{file}: {stderr}");
    let outcome = match output.status.code() {
        Some(0) => format!("converted: {} points", points(&octree)),
        Some(3) if stdout.lines().any(|line| line.ends_with("that the input promises could not be read")) => {
            format!("converted in part: {} points", points(&octree))
        }
        Some(3) => format!("converted: {} points, the others set aside", points(&octree)),
        Some(1) => "refused".to_string(),
        code => panic!("{file} ended with {code:?}: {stderr}"),
    };
    let said: Vec<&str> = if output.status.code() == Some(1) {
        assert!(!octree.exists(), "{file}: refused, and yet there is an octree");
        assert!(stderr.contains(&file), "the message does not name {file}: {stderr}");
        stderr.lines().filter_map(|line| line.strip_prefix("lodestone: ")).collect()
    } else {
        let verify = ["verify", octree.to_str().unwrap(), "--damaged", mode, "--against"];
        let verified = Command::new(LODESTONE).args(verify).arg(input).output().unwrap();
        assert!(verified.status.success(), "{file}: {}", String::from_utf8_lossy(&verified.stdout));
        stdout.lines().filter(|line| line.starts_with("note: ")).collect()
    };
    assert!(output.status.code() == Some(0) || !said.is_empty(), "{file}: nothing said: {stdout}{stderr}");
    Row { file, mode, outcome, said: said.join("; "), time }
}

fn points(octree: &Path) -> u64 {
    lodestone::format::potree::Metadata::read(octree).unwrap().points
}

#[test]
fn malformed_files_end_as_the_page_says() {
    let Some(data) = crate::common::data() else { return };
    let mut files: Vec<PathBuf> =
        fs::read_dir(data.join("malformed")).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    assert!(files.len() >= 16, "only {} malformed files", files.len());
    let folder = tempfile::tempdir().unwrap();
    let base = base(folder.path());
    let mut rows = Vec::new();
    for file in &files {
        for mode in ["fail", "keep"] {
            let row = convert(file, folder.path(), mode, base);
            println!("{}", row.line());
            assert!(row.time < MOST_TIME, "{} took {:?}", row.file, row.time);
            rows.push(row);
        }
    }
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join(PAGE);
    if std::env::var_os("LODESTONE_WRITE_DOCS").is_some_and(|wish| wish == "1") {
        let mut text =
            format!("{OPENING}| file | mode | outcome | what is said | time |\n|---|---|---|---|---|\n");
        rows.iter().for_each(|row| text.extend([row.line(), "\n".to_string()]));
        fs::write(&page, text).unwrap();
    }
    let there = fs::read_to_string(&page).unwrap_or_default();
    let there: Vec<&str> = there.lines().filter(|line| line.contains(".la")).collect();
    let stale: Vec<String> = rows
        .iter()
        .map(Row::lasting)
        .filter(|line| !there.iter().any(|other| other.starts_with(line)))
        .collect();
    let hint = "write it anew with LODESTONE_WRITE_DOCS=1, and look at what changed";
    assert!(stale.is_empty(), "{PAGE} does not say so; {hint}:\n{}", stale.join("\n"));
    let tables = there.iter().filter(|line| line.starts_with("| ")).count();
    assert_eq!(tables, rows.len(), "{PAGE} has lines of files that are no more; {hint}");
}
