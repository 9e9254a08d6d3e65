//! Keeps a list of all published COPC files beside them, `lodestone.vpc`, and overviews of
//! them: QGIS and PDAL open the whole folder as one cloud by it. Both are derived and never
//! waited for: whenever the files are others than those listed, the list is written anew;
//! the overviews follow as soon as that takes little of the machine.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant, UNIX_EPOCH};

use tokio::task::JoinHandle;

use super::tools::EngineContext;
use crate::convert::context::{Cancel, Context};
use crate::export::ExportError;
use crate::export::overview::{self, Place};
use crate::export::vpc;
use crate::platform::clock::Millis;
use crate::platform::disk::Disk;

/// The list's name in the folder of octrees, without its ending.
const STEM: &str = "lodestone";
/// The list's name.
const NAME: &str = "lodestone.vpc";
/// The least time between two looks at the folder, in milliseconds.
const MIN_PAUSE_MS: Millis = 5_000;
/// The pause is so many times what the last look took.
const PAUSE_FACTOR: u128 = 20;

/// Bytes of memory for it, however little there is for all: a part of the overview must fit.
const MIN_MEMORY: u64 = 128 << 20;

/// Path, bytes, and when each file was last changed.
type FileStates = Vec<(PathBuf, u64, Duration)>;

/// Which files list and overviews are of; nothing if they are to be made anew.
#[derive(Debug, Default, Clone, PartialEq)]
struct Known {
    listed: Option<FileStates>,
    shown: Option<FileStates>,
}

#[derive(Default)]
pub(super) struct VirtualCloud {
    look: Option<JoinHandle<(Known, [Duration; 2])>>,
    cancel: Cancel,
    known: Known,
    next_at: Millis,
    next_overview_at: Millis,
}

impl VirtualCloud {
    /// Takes note of what was written, and looks at the folder again if it is time.
    pub async fn turn(&mut self, tools: &EngineContext, resting: bool) {
        let now = tools.clock.now();
        if let Some(look) = self.look.take_if(|look| look.is_finished()) {
            let (known, took) = look.await.unwrap_or_else(|error| {
                tracing::error!(%error, "the list of COPC files could not be made");
                (Known::default(), [Duration::ZERO; 2])
            });
            self.known = known;
            let next = |took: Duration| now + MIN_PAUSE_MS.max((took.as_millis() * PAUSE_FACTOR) as Millis);
            self.next_at = next(took[0]);
            if !took[1].is_zero() {
                self.next_overview_at = next(took[1]);
            }
        }
        if resting {
            self.cancel.cancel();
            return;
        }
        // A clock that was set back must not silence it.
        let is_due = |at: Millis, most: Millis| now >= at || at - now > most;
        if self.look.is_some() || !is_due(self.next_at, 100 * MIN_PAUSE_MS) {
            return;
        }
        let is_overview_due = is_due(self.next_overview_at, 1_000 * MIN_PAUSE_MS);
        let (folder, known) = (tools.config.octrees(), std::mem::take(&mut self.known));
        let context = Context {
            disk: tools.disk.clone(),
            // It gets one of its own in the folder of octrees.
            scratch: PathBuf::new(),
            threads: 1,
            memory_limit: (tools.config.memory_limit / 8).max(MIN_MEMORY),
            cancel: self.cancel.clone(),
            progress: Arc::default(),
        };
        self.look =
            Some(tokio::task::spawn_blocking(move || look(&folder, known, is_overview_due, &context)));
    }
}

/// Writes list and overviews if they are not those of the files. Gives what they are then of
/// (nothing if something is to be tried again), and how long each took.
fn look(folder: &Path, mut known: Known, with_overviews: bool, context: &Context) -> (Known, [Duration; 2]) {
    let begun = Instant::now();
    let mut place = Place::of_own_folder(folder, STEM);
    let files = files(folder, &place);
    if known.listed.as_ref() != Some(&files) {
        known.listed = write_list(folder, &files, &place, context);
    }
    let took = begun.elapsed();
    if !with_overviews || known.shown.as_ref() == Some(&files) {
        return (known, [took, Duration::ZERO]);
    }
    let before = place.existing();
    let paths: Vec<PathBuf> = files.iter().map(|(path, ..)| path.clone()).collect();
    match overview::update(&paths, &mut place, context) {
        Ok(overviews) => {
            // Those of before are sorted by name.
            let is_same =
                overviews.len() == before.len() && overviews.iter().all(|overview| before.contains(overview));
            if !is_same {
                known.listed = write_list(folder, &files, &place, context);
            }
            known.shown = Some(files);
        }
        Err(ExportError::Cancelled) => {}
        Err(error) => tracing::warn!(%error, "the overview of {NAME} could not be made; will retry"),
    }
    (known, [took, begun.elapsed() - took])
}

/// Writes the list and gives what it then has; nothing if it is to be tried again.
fn write_list(folder: &Path, files: &FileStates, place: &Place, context: &Context) -> Option<FileStates> {
    let (disk, path): (&Disk, _) = (&context.disk, folder.join(NAME));
    if files.is_empty() {
        if path.exists()
            && let Err(error) = disk.remove_file(&path)
        {
            tracing::warn!(%error, "the list of COPC files stays, though there are none");
        }
        return Some(files.clone());
    }
    let paths: Vec<PathBuf> = files.iter().map(|(path, ..)| path.clone()).collect();
    let list = vpc::list(&paths, folder, &place.existing(), context.memory_limit);
    for (path, reason) in &list.left_out {
        tracing::warn!(path = %path.display(), reason, "left out of {NAME}");
    }
    match disk.write_atomic(&path, list.json.as_bytes()) {
        Ok(()) => tracing::debug!(files = list.files, points = list.points, "wrote {NAME}"),
        Err(error) => {
            tracing::warn!(%error, "{NAME} could not be written; will retry");
            return None;
        }
    }
    list.left_out.is_empty().then(|| files.clone())
}

fn files(folder: &Path, place: &Place) -> FileStates {
    let stamp = |path: PathBuf| {
        let metadata = std::fs::metadata(&path).ok()?;
        let changed = metadata.modified().ok().and_then(|time| time.duration_since(UNIX_EPOCH).ok());
        Some((path, metadata.len(), changed.unwrap_or_default()))
    };
    vpc::found(folder).into_iter().filter(|path| !place.has(path)).filter_map(stamp).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::convert::formats::Formats;
    use crate::convert::options::Options;
    use crate::convert::request::ConversionRequest;
    use crate::convert::run;
    use crate::format::crs;
    use crate::format::las::{LasOptions, LasWriter, Vlr};

    fn context() -> Context {
        Context {
            disk: Disk::new(),
            scratch: PathBuf::new(),
            threads: 1,
            memory_limit: 256 << 20,
            cancel: Cancel::default(),
            progress: Arc::default(),
        }
    }

    /// A cloud of points in a row, published as `name`.
    fn publish(folder: &Path, name: &str, code: &str, points: i32) {
        let input = folder.join(".in.las");
        let options = LasOptions {
            version: (1, 4),
            point_format: 6,
            scale: [0.01; 3],
            offset: [0.0; 3],
            compressed: false,
            extra: Vec::new(),
            crs: vec![Vlr::wkt(&crs::named(code).expect("known"))],
            software: String::new(),
        };
        let mut writer = LasWriter::create(&input, &options).expect("made");
        let record = |number: i32| {
            let mut record = [0; 30];
            record[..4].copy_from_slice(&(number * 100).to_le_bytes());
            record[14] = 0x11;
            record
        };
        writer.write(&(0..points).flat_map(record).collect::<Vec<u8>>()).expect("written");
        writer.finish().expect("finished");
        let request = ConversionRequest {
            inputs: vec![input],
            output: folder.join(name),
            overwrite: false,
            keep_scratch: false,
            options: Options { format: Formats::COPC, name: Some(name.into()), ..Options::default() },
            hashes: Default::default(),
        };
        run::convert(&request, &Context { scratch: folder.join(".scratch"), ..context() })
            .expect("converted");
    }

    fn list(folder: &Path) -> Vec<(String, Option<String>)> {
        let list: serde_json::Value =
            serde_json::from_slice(&std::fs::read(folder.join(NAME)).expect("read")).expect("JSON");
        let text = |value: &serde_json::Value| value.as_str().map(str::to_string);
        let features = list["features"].as_array().expect("features");
        let told = |feature: &serde_json::Value| {
            (text(&feature["id"]).expect("an id"), text(&feature["assets"]["overview"]["href"]))
        };
        features.iter().map(told).collect()
    }

    #[test]
    fn the_list_follows_the_files() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join(NAME);
        let update = |known: Known| look(folder.path(), known, true, &context()).0;
        let nothing = Known { listed: Some(Vec::new()), shown: Some(Vec::new()) };
        assert_eq!(update(Known::default()), nothing);
        assert!(!path.exists());
        // A file that cannot be read is left out, and tried again.
        let below = folder.path().join("a");
        std::fs::create_dir(&below).expect("made");
        std::fs::write(below.join("a.copc.laz"), b"LASF").expect("written");
        assert_eq!(update(nothing.clone()).listed, None);
        assert!(list(folder.path()).is_empty());
        std::fs::remove_dir_all(&below).expect("removed");
        assert_eq!(update(Known::default()), nothing);
        assert!(!path.exists());
    }

    #[test]
    fn overviews_follow_the_files_of_each_system() {
        let folder = tempfile::tempdir().expect("a folder");
        let at = |name: &str| folder.path().join(name);
        let mut known = Known::default();
        let mut update = |with_overviews: bool| {
            known = look(folder.path(), std::mem::take(&mut known), with_overviews, &context()).0;
            list(folder.path())
        };
        let entry = |name: &str, overview: Option<&str>| (name.to_string(), overview.map(str::to_string));
        publish(folder.path(), "a", "EPSG:25832", 400);
        assert_eq!(update(true), [entry("a", None)], "one file is its own overview");
        publish(folder.path(), "b", "EPSG:25832", 800);
        // The list does not wait for the overview.
        assert_eq!(update(false), [entry("a", None), entry("b", None)]);
        let first = Some("./lodestone-overview.copc.laz");
        assert_eq!(update(true), [entry("a", first), entry("b", first)]);
        let points = |name: &str| {
            let file = crate::format::copc::CopcFile::open(&at(name), 1 << 26).expect("opens");
            file.front.points
        };
        assert!((300..=302).contains(&points("lodestone-overview.copc.laz")), "a quarter of all");
        for name in ["c", "d"] {
            publish(folder.path(), name, "EPSG:2154", 100);
        }
        let second = Some("./lodestone-overview-2.copc.laz");
        let all = [entry("a", first), entry("b", first), entry("c", second), entry("d", second)];
        assert_eq!(update(true), all);
        // A new start finds what is there.
        known = Known::default();
        let mut update = |with_overviews: bool| {
            known = look(folder.path(), std::mem::take(&mut known), with_overviews, &context()).0;
            list(folder.path())
        };
        assert_eq!(update(false), all);
        std::fs::remove_dir_all(at("a")).expect("removed");
        assert_eq!(update(true), [entry("b", None), entry("c", second), entry("d", second)]);
        assert!(!at("lodestone-overview.copc.laz").exists() && !at(".lodestone-overview").exists());
    }
}
