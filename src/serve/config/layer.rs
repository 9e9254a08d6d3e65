//! What one source of configuration says: flags, the environment, or a file.
//! Every key stands here once, with the text of its flag's help.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::error::ConfigError;
use super::hook::Hook;
use super::logging::LogFormat;
use super::size::Size;
use super::sources::OnDone;
use crate::convert::formats::Formats;
use crate::convert::options::{Damaged, Encoding, GuardMode, LodColor, Sampling};
use crate::render::color::ColorBy;
use crate::words;

/// What one source of configuration says; what it leaves out is empty.
#[derive(Debug, Clone, Default, PartialEq, clap::Args, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Layer {
    /// The folder of inbox, octrees, scratch and the queue [default: ./lodestone-data].
    #[arg(long, env = "LODESTONE_ROOT", value_name = "DIR")]
    pub root: Option<PathBuf>,
    /// Another folder to watch besides the inbox; may be given several times, and in the variable
    /// several folders stand with colons between them, as in PATH.
    #[arg(long, env = "LODESTONE_WATCH", value_name = "DIR")]
    pub watch: Vec<PathBuf>,
    /// Address of the HTTP API [default: 127.0.0.1:7700].
    #[arg(long, env = "LODESTONE_LISTEN", value_name = "ADDRESS")]
    pub listen: Option<String>,
    /// A secret that API requests must bring (`Authorization: Bearer …`).
    #[arg(long, env = "LODESTONE_TOKEN", value_name = "SECRET", hide_env_values = true)]
    pub token: Option<String>,
    /// A file that holds the token, instead of `token`.
    #[arg(long, env = "LODESTONE_TOKEN_FILE", value_name = "FILE")]
    pub token_file: Option<PathBuf>,
    /// A second secret, whose bearer may look at everything and change nothing.
    #[arg(long, env = "LODESTONE_READ_TOKEN", value_name = "SECRET", hide_env_values = true)]
    pub read_token: Option<String>,
    /// A file that holds it, instead of `read_token`.
    #[arg(long, env = "LODESTONE_READ_TOKEN_FILE", value_name = "FILE")]
    pub read_token_file: Option<PathBuf>,
    /// Another name under which the API may be asked, as that of a proxy; may be given several
    /// times, or as a list with commas.
    #[arg(long, env = "LODESTONE_ALLOWED_HOSTS", value_name = "HOST", value_delimiter = ',')]
    pub allowed_hosts: Vec<String>,
    /// Where browsers find the daemon behind a proxy, as in https://example.com/lodestone.
    #[arg(long, env = "LODESTONE_PUBLIC_URL", value_name = "URL")]
    pub public_url: Option<String>,
    /// Let everybody who reaches the address read and control the queue.
    #[arg(long, env = "LODESTONE_OPEN_TO_NETWORK", value_name = "YES|NO", num_args = 0..=1,
          default_missing_value = "true", value_parser = words::yes_or_no)]
    #[serde(deserialize_with = "words::optional_switch")]
    pub open_to_network: Option<bool>,
    /// How long a file's size and time must be quiet before it is taken, in seconds [default: 5].
    #[arg(long, env = "LODESTONE_SETTLE_SECONDS", value_name = "SECONDS")]
    pub settle_seconds: Option<f64>,
    /// How long a quiet file that is not whole may still become so before it counts as broken, in seconds [default: 120].
    #[arg(long, env = "LODESTONE_PATIENCE_SECONDS", value_name = "SECONDS")]
    pub patience_seconds: Option<f64>,
    /// The longest time between two scans of the watched folders, in seconds [default: 30].
    #[arg(long, env = "LODESTONE_RESCAN_SECONDS", value_name = "SECONDS")]
    pub rescan_seconds: Option<f64>,
    /// Large data sets that are converted at the same time [default: 1].
    #[arg(long, env = "LODESTONE_HEAVY_JOBS", value_name = "N")]
    pub heavy_jobs: Option<u32>,
    /// Small data sets that are converted beside them [default: 2].
    #[arg(long, env = "LODESTONE_LIGHT_JOBS", value_name = "N")]
    pub light_jobs: Option<u32>,
    /// Up to this size of its files a data set is small [default: 64M].
    #[arg(long, env = "LODESTONE_LIGHT_BYTES", value_name = "SIZE")]
    pub light_bytes: Option<Size>,
    /// Threads of a conversion [default: the cores this process may use].
    #[arg(long, env = "LODESTONE_THREADS", value_name = "N")]
    pub threads: Option<usize>,
    /// Memory that conversions may hold together [default: half of what the machine or its container has].
    #[arg(long, env = "LODESTONE_MEMORY_LIMIT", value_name = "SIZE")]
    pub memory_limit: Option<Size>,
    /// Room on disk that is always left free [default: 256M].
    #[arg(long, env = "LODESTONE_DISK_RESERVE", value_name = "SIZE")]
    pub disk_reserve: Option<Size>,
    /// Crashes and hopeless failures that send a job to quarantine [default: 3].
    #[arg(long, env = "LODESTONE_MAX_STRIKES", value_name = "N")]
    pub max_strikes: Option<u32>,
    /// Failures that may pass (no room, I/O errors) after which a job has failed [default: 20].
    #[arg(long, env = "LODESTONE_MAX_POSTPONEMENTS", value_name = "N")]
    pub max_postponements: Option<u32>,
    /// The wait after the first such failure, in seconds; it doubles up to ten minutes [default: 5].
    #[arg(long, env = "LODESTONE_RETRY_SECONDS", value_name = "SECONDS")]
    pub retry_seconds: Option<f64>,
    /// How long an orderly stop may take before the work in hand is abandoned, in seconds [default: 20].
    #[arg(long, env = "LODESTONE_SHUTDOWN_SECONDS", value_name = "SECONDS")]
    pub shutdown_seconds: Option<f64>,
    /// What becomes of a data set's files once its octree is published [default: keep].
    #[arg(long, env = "LODESTONE_ON_DONE", value_enum, ignore_case = true)]
    pub on_done: Option<OnDone>,
    /// A program to run after a job is done; with arguments as a JSON list, ["prog", "arg"].
    #[arg(long, env = "LODESTONE_HOOK_DONE", value_name = "PROGRAM")]
    pub hook_done: Option<Hook>,
    /// A program to run after a job has failed or was quarantined.
    #[arg(long, env = "LODESTONE_HOOK_FAILED", value_name = "PROGRAM")]
    pub hook_failed: Option<Hook>,
    /// How long such a program may take before it is killed, in seconds [default: 60].
    #[arg(long, env = "LODESTONE_HOOK_SECONDS", value_name = "SECONDS")]
    pub hook_seconds: Option<f64>,
    /// How long a job without any progress may run before it is stopped, in minutes; 0 is for ever [default: 30].
    #[arg(long, env = "LODESTONE_STALL_MINUTES", value_name = "MINUTES")]
    pub stall_minutes: Option<f64>,
    /// How long ended jobs without an octree stay in the list, in days; 0 is for ever [default: 90].
    #[arg(long, env = "LODESTONE_KEEP_DAYS", value_name = "DAYS")]
    pub keep_days: Option<f64>,
    /// What is written: a Potree octree, a COPC file, or both: potree, copc, or potree,copc
    /// [default: potree].
    #[arg(long, env = "LODESTONE_FORMAT", value_name = "FORMATS")]
    pub format: Option<Formats>,
    /// How nodes are sampled [default: poisson].
    #[arg(long, env = "LODESTONE_SAMPLING", value_enum, ignore_case = true)]
    pub sampling: Option<Sampling>,
    /// How points are stored [default: default].
    #[arg(long, env = "LODESTONE_ENCODING", value_enum, ignore_case = true)]
    pub encoding: Option<Encoding>,
    /// Colours of coarse levels: those of their points, or means of what these stand for, in an
    /// attribute of their own or in `rgb` [default: keep].
    #[arg(long, env = "LODESTONE_LOD_COLOR", value_enum, ignore_case = true)]
    pub lod_color: Option<LodColor>,
    /// What becomes of data sets with files that are cut, or of which a part cannot be decoded: they
    /// fail, or what can be read of them is converted [default: fail].
    #[arg(long, env = "LODESTONE_DAMAGED", value_enum, ignore_case = true)]
    pub damaged: Option<Damaged>,
    /// What becomes of a few points so far away that the octree would be built for them [default: set-aside].
    #[arg(long, env = "LODESTONE_OUTLIERS", value_enum, ignore_case = true)]
    pub outliers: Option<GuardMode>,
    /// What becomes of points at one position beyond the first 10 000 [default: set-aside].
    #[arg(long, env = "LODESTONE_DUPLICATES", value_enum, ignore_case = true)]
    pub duplicates: Option<GuardMode>,
    /// What becomes of records that equal another in every attribute [default: keep].
    #[arg(long, env = "LODESTONE_TWINS", value_enum, ignore_case = true)]
    pub twins: Option<GuardMode>,
    /// Make pictures of each octree after it is published, at low priority [default: true].
    #[arg(long, env = "LODESTONE_PREVIEW", value_name = "YES|NO", num_args = 0..=1,
          default_missing_value = "true", value_parser = words::yes_or_no)]
    #[serde(deserialize_with = "words::optional_switch")]
    pub preview: Option<bool>,
    /// Pictures of the turntable among them; 0 for none [default: 36].
    #[arg(long, env = "LODESTONE_PREVIEW_FRAMES", value_name = "N")]
    pub preview_frames: Option<u32>,
    /// What they are coloured by; where a cloud has no such attribute, by what it has [default: auto].
    #[arg(long, env = "LODESTONE_PREVIEW_COLOR", value_enum, ignore_case = true, value_name = "WHAT")]
    pub preview_color: Option<ColorBy>,
    /// What to log; on the command line a flag of all commands.
    #[arg(skip)]
    pub log: Option<String>,
    #[arg(skip)]
    pub log_format: Option<LogFormat>,
    /// Take files that are dropped on the page, into the inbox [default: true].
    #[arg(long, env = "LODESTONE_UPLOAD", value_name = "YES|NO", num_args = 0..=1,
          default_missing_value = "true", value_parser = words::yes_or_no)]
    #[serde(deserialize_with = "words::optional_switch")]
    pub upload: Option<bool>,
    /// The largest upload [default: 256G].
    #[arg(long, env = "LODESTONE_UPLOAD_LIMIT", value_name = "SIZE")]
    pub upload_limit: Option<Size>,
}

impl Layer {
    /// Reads a TOML file.
    pub fn read(path: &Path) -> Result<Layer, ConfigError> {
        let text = std::fs::read_to_string(path)
            .map_err(|source| ConfigError::Read { path: path.to_path_buf(), source })?;
        // The parser's message names the key and shows its line.
        toml::from_str(&text)
            .map_err(|e| ConfigError::Parse { path: path.to_path_buf(), message: e.to_string() })
    }

    /// Takes the variable `LODESTONE_WATCH` apart, which clap takes for one folder. What
    /// exists as it stands is one, colons and all.
    pub fn split_watched(mut self, variable: Option<&OsStr>) -> Layer {
        if let ([one], Some(variable)) = (self.watch.as_slice(), variable)
            && one.as_os_str() == variable
            && !one.exists()
        {
            self.watch =
                std::env::split_paths(variable).filter(|path| !path.as_os_str().is_empty()).collect();
        }
        self
    }

    /// This layer, and where it is silent the other.
    pub fn over(self, other: Layer) -> Layer {
        // A token and its file are one setting: the upper layer's word is the last on both.
        let (token, token_file) = match (self.token, self.token_file) {
            (None, None) => (other.token, other.token_file),
            upper => upper,
        };
        let (read_token, read_token_file) = match (self.read_token, self.read_token_file) {
            (None, None) => (other.read_token, other.read_token_file),
            upper => upper,
        };
        Layer {
            root: self.root.or(other.root),
            watch: if self.watch.is_empty() { other.watch } else { self.watch },
            listen: self.listen.or(other.listen),
            token,
            token_file,
            read_token,
            read_token_file,
            allowed_hosts: if self.allowed_hosts.is_empty() {
                other.allowed_hosts
            } else {
                self.allowed_hosts
            },
            public_url: self.public_url.or(other.public_url),
            open_to_network: self.open_to_network.or(other.open_to_network),
            settle_seconds: self.settle_seconds.or(other.settle_seconds),
            patience_seconds: self.patience_seconds.or(other.patience_seconds),
            rescan_seconds: self.rescan_seconds.or(other.rescan_seconds),
            heavy_jobs: self.heavy_jobs.or(other.heavy_jobs),
            light_jobs: self.light_jobs.or(other.light_jobs),
            light_bytes: self.light_bytes.or(other.light_bytes),
            threads: self.threads.or(other.threads),
            memory_limit: self.memory_limit.or(other.memory_limit),
            disk_reserve: self.disk_reserve.or(other.disk_reserve),
            max_strikes: self.max_strikes.or(other.max_strikes),
            max_postponements: self.max_postponements.or(other.max_postponements),
            retry_seconds: self.retry_seconds.or(other.retry_seconds),
            shutdown_seconds: self.shutdown_seconds.or(other.shutdown_seconds),
            on_done: self.on_done.or(other.on_done),
            hook_done: self.hook_done.or(other.hook_done),
            hook_failed: self.hook_failed.or(other.hook_failed),
            hook_seconds: self.hook_seconds.or(other.hook_seconds),
            stall_minutes: self.stall_minutes.or(other.stall_minutes),
            keep_days: self.keep_days.or(other.keep_days),
            format: self.format.or(other.format),
            sampling: self.sampling.or(other.sampling),
            encoding: self.encoding.or(other.encoding),
            lod_color: self.lod_color.or(other.lod_color),
            damaged: self.damaged.or(other.damaged),
            outliers: self.outliers.or(other.outliers),
            duplicates: self.duplicates.or(other.duplicates),
            twins: self.twins.or(other.twins),
            preview: self.preview.or(other.preview),
            preview_frames: self.preview_frames.or(other.preview_frames),
            preview_color: self.preview_color.or(other.preview_color),
            log: self.log.or(other.log),
            log_format: self.log_format.or(other.log_format),
            upload: self.upload.or(other.upload),
            upload_limit: self.upload_limit.or(other.upload_limit),
        }
    }
}
