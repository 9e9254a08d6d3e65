//! Configuration of the daemon: every key once, as a flag, as an environment
//! variable `LODESTONE_…` and in a TOML file, in this order of precedence.
//!
//! [`Layer`] is what one of these sources says; [`Config`] is the checked sum.
//! All is checked at start: a daemon that is left alone for a year must not find
//! a wrong value in its eleventh month.

pub mod access;
pub mod age;
mod error;
pub mod hook;
mod layer;
pub mod logging;
pub mod size;
pub mod sources;

use std::net::SocketAddr;
use std::path::PathBuf;

use crate::convert::options::{GuardMode, Options};
use crate::platform::limits;
use crate::render::color::ColorBy;
use crate::serve::job::retry_policy::Policy;
use access::{Access, PublicUrl, is_loopback};
pub use error::ConfigError;
use error::wrong;
use hook::Hook;
pub use layer::Layer;
use logging::LogFormat;
use size::Size;
use sources::OnDone;

/// Memory that a conversion needs to work out of core with usual records.
pub const LEAST_MEMORY: u64 = 64 << 20;

/// Of a turntable: two a degree.
const MOST_FRAMES: u32 = 720;

/// Milliseconds.
const MINUTE: f64 = 60_000.0;
const DAY: f64 = 86_400_000.0;

/// The checked configuration. Times are milliseconds, sizes bytes.
#[derive(Debug, Clone, PartialEq)]
pub struct Config {
    pub root: PathBuf,
    pub watch: Vec<PathBuf>,
    pub listen: SocketAddr,
    /// Tokens, allowed hosts and the public address.
    pub access: Access,
    pub settle: i64,
    pub patience: i64,
    pub rescan: i64,
    pub heavy_jobs: usize,
    pub light_jobs: usize,
    pub light_bytes: u64,
    pub threads: usize,
    pub memory_limit: u64,
    pub disk_reserve: u64,
    pub policy: Policy,
    pub shutdown: i64,
    pub on_done: OnDone,
    pub hook_done: Option<Hook>,
    pub hook_failed: Option<Hook>,
    /// How long a hook may take.
    pub hook_limit: i64,
    /// How long a run may stand still; `None` is for ever.
    pub stall: Option<i64>,
    /// How long ended jobs are kept; `None` is for ever.
    pub keep: Option<i64>,
    /// Options of conversions whose data set does not say its own.
    pub options: Options,
    /// Whether pictures of octrees are made.
    pub preview: bool,
    /// Of the turntable; 0 is no turntable.
    pub preview_frames: u32,
    pub preview_color: ColorBy,
    /// What is logged, as a filter.
    pub log: String,
    pub log_format: LogFormat,
    /// Whether files may be handed in by the page.
    pub upload: bool,
    /// Bytes of one upload.
    pub upload_limit: u64,
}

impl Config {
    pub fn inbox(&self) -> PathBuf {
        self.root.join("inbox")
    }
    pub fn octrees(&self) -> PathBuf {
        self.root.join("octrees")
    }
    pub fn scratch(&self) -> PathBuf {
        self.root.join("scratch")
    }
    /// Where `on_done = "move"` puts the files of published data sets.
    pub fn done(&self) -> PathBuf {
        self.root.join("done")
    }
    pub fn database(&self) -> PathBuf {
        self.root.join("lodestone.db")
    }

    /// Checks a layer and fills in the defaults.
    pub fn from_layer(layer: Layer) -> Result<Config, ConfigError> {
        let listen = layer.listen.as_deref().unwrap_or("127.0.0.1:7700");
        let listen: SocketAddr = listen.parse().map_err(|_| {
            wrong(
                "listen",
                format!("`{listen}` is no address with a port, as in 127.0.0.1:7700 or [::1]:7700"),
            )
        })?;
        let open = layer.open_to_network.unwrap_or(false);
        let access = Access::from_layer(&layer)?;
        if !is_loopback(listen.ip()) && access.token.is_none() && !open {
            let message = format!(
                "{listen} can be reached from other machines, which could then read every octree and control \
                 the queue; give a `token`, or say `open_to_network` to allow it to everybody"
            );
            return Err(wrong("listen", message));
        }
        let heavy_jobs = at_least_one("heavy_jobs", layer.heavy_jobs, 1)?;
        let light_jobs = layer.light_jobs.unwrap_or(2);
        let lanes = u64::from(heavy_jobs) + u64::from(light_jobs);
        Ok(Config {
            root: layer.root.unwrap_or_else(|| PathBuf::from("lodestone-data")),
            watch: layer.watch,
            listen,
            access,
            settle: millis("settle_seconds", layer.settle_seconds, 5.0)?,
            patience: millis("patience_seconds", layer.patience_seconds, 120.0)?,
            rescan: millis("rescan_seconds", layer.rescan_seconds, 30.0)?.max(100),
            heavy_jobs: heavy_jobs as usize,
            light_jobs: light_jobs as usize,
            light_bytes: layer.light_bytes.unwrap_or(Size(64 << 20)).0,
            threads: match layer.threads {
                Some(0) => return Err(wrong("threads", "at least one thread is needed")),
                Some(threads) => threads,
                None => limits::threads(),
            },
            memory_limit: match layer.memory_limit {
                Some(Size(bytes)) if bytes < lanes * LEAST_MEMORY => {
                    let message = format!(
                        "{lanes} conversions may run side by side and need at least {} each; allow more, or \
                         fewer `heavy_jobs` and `light_jobs`",
                        Size(LEAST_MEMORY)
                    );
                    return Err(wrong("memory_limit", message));
                }
                Some(Size(bytes)) => bytes,
                None => (limits::memory() / 2).max((lanes * LEAST_MEMORY).max(256 << 20)),
            },
            disk_reserve: layer.disk_reserve.unwrap_or(Size(256 << 20)).0,
            policy: Policy {
                max_strikes: at_least_one("max_strikes", layer.max_strikes, 3)?,
                max_postponements: at_least_one("max_postponements", layer.max_postponements, 20)?,
                first_wait: millis("retry_seconds", layer.retry_seconds, 5.0)?,
                ..Policy::default()
            },
            shutdown: millis("shutdown_seconds", layer.shutdown_seconds, 20.0)?,
            on_done: layer.on_done.unwrap_or_default(),
            hook_done: layer.hook_done,
            hook_failed: layer.hook_failed,
            hook_limit: millis("hook_seconds", layer.hook_seconds, 60.0)?.max(100),
            stall: span("stall_minutes", layer.stall_minutes, 30.0, MINUTE)?,
            keep: span("keep_days", layer.keep_days, 90.0, DAY)?,
            options: Options {
                format: layer.format.unwrap_or_default(),
                sampling: layer.sampling.unwrap_or_default(),
                encoding: layer.encoding.unwrap_or_default(),
                lod_color: layer.lod_color.unwrap_or_default(),
                damaged: layer.damaged.unwrap_or_default(),
                outliers: layer.outliers.unwrap_or(GuardMode::SetAside),
                duplicates: layer.duplicates.unwrap_or(GuardMode::SetAside),
                twins: layer.twins.unwrap_or(GuardMode::Keep),
                ..Options::default()
            },
            preview: layer.preview.unwrap_or(true),
            preview_frames: match layer.preview_frames.unwrap_or(36) {
                frames @ 0..=MOST_FRAMES => frames,
                frames => {
                    return Err(wrong(
                        "preview_frames",
                        format!("{frames} is not between 0 and {MOST_FRAMES}"),
                    ));
                }
            },
            preview_color: layer.preview_color.unwrap_or_default(),
            log: layer.log.unwrap_or_else(|| logging::DEFAULT_FILTER.to_string()),
            log_format: layer.log_format.unwrap_or_default(),
            upload: layer.upload.unwrap_or(true),
            upload_limit: layer.upload_limit.unwrap_or(Size(256 << 30)).0,
        })
    }

    /// The effective configuration in the form of its file; the token is not told.
    pub fn to_layer(&self) -> Layer {
        let seconds = |millis: i64| Some(millis as f64 / 1000.0);
        Layer {
            root: Some(self.root.clone()),
            watch: self.watch.clone(),
            listen: Some(self.listen.to_string()),
            token: told(&self.access.token, &self.access.token_file),
            token_file: self.access.token_file.clone(),
            read_token: told(&self.access.read_token, &self.access.read_token_file),
            read_token_file: self.access.read_token_file.clone(),
            allowed_hosts: self.access.allowed_hosts.clone(),
            public_url: self.access.public_url.as_ref().map(PublicUrl::text),
            open_to_network: Some(!is_loopback(self.listen.ip()) && self.access.token.is_none()),
            settle_seconds: seconds(self.settle),
            patience_seconds: seconds(self.patience),
            rescan_seconds: seconds(self.rescan),
            heavy_jobs: Some(self.heavy_jobs as u32),
            light_jobs: Some(self.light_jobs as u32),
            light_bytes: Some(Size(self.light_bytes)),
            threads: Some(self.threads),
            memory_limit: Some(Size(self.memory_limit)),
            disk_reserve: Some(Size(self.disk_reserve)),
            max_strikes: Some(self.policy.max_strikes),
            max_postponements: Some(self.policy.max_postponements),
            retry_seconds: seconds(self.policy.first_wait),
            shutdown_seconds: seconds(self.shutdown),
            on_done: Some(self.on_done),
            hook_done: self.hook_done.clone(),
            hook_failed: self.hook_failed.clone(),
            hook_seconds: seconds(self.hook_limit),
            stall_minutes: Some(self.stall.unwrap_or(0) as f64 / MINUTE),
            keep_days: Some(self.keep.unwrap_or(0) as f64 / DAY),
            format: Some(self.options.format),
            sampling: Some(self.options.sampling),
            encoding: Some(self.options.encoding),
            lod_color: Some(self.options.lod_color),
            damaged: Some(self.options.damaged),
            outliers: Some(self.options.outliers),
            duplicates: Some(self.options.duplicates),
            twins: Some(self.options.twins),
            preview: Some(self.preview),
            preview_frames: Some(self.preview_frames),
            preview_color: Some(self.preview_color),
            log: Some(self.log.clone()),
            log_format: Some(self.log_format),
            upload: Some(self.upload),
            upload_limit: Some(Size(self.upload_limit)),
        }
    }
}

fn millis(key: &'static str, seconds: Option<f64>, default: f64) -> Result<i64, ConfigError> {
    let seconds = seconds.unwrap_or(default);
    // NaN fails this as well.
    if !(0.0..=31_536_000.0).contains(&seconds) {
        return Err(wrong(key, format!("{seconds} is not between 0 seconds and a year")));
    }
    Ok((seconds * 1000.0).round() as i64)
}

/// A time in `unit`s, of which zero means for ever.
fn span(key: &'static str, value: Option<f64>, default: f64, unit: f64) -> Result<Option<i64>, ConfigError> {
    let value = value.unwrap_or(default);
    // A century is for ever, and stays far from the end of an i64. NaN fails this as well.
    if !(0.0..=36_525.0 * DAY / unit).contains(&value) {
        return Err(wrong(key, format!("{value} is no time between 0 (for ever) and a century")));
    }
    Ok((value > 0.0).then(|| (value * unit).round().max(1.0) as i64))
}

fn at_least_one(key: &'static str, value: Option<u32>, default: u32) -> Result<u32, ConfigError> {
    match value.unwrap_or(default) {
        0 => Err(wrong(key, "must be at least 1")),
        value => Ok(value),
    }
}

/// That a token is set, not which.
fn told(token: &Option<String>, file: &Option<PathBuf>) -> Option<String> {
    (token.is_some() && file.is_none()).then(|| "(set)".to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn layer(toml: &str) -> Layer {
        toml::from_str(toml).expect("a layer")
    }

    fn error(toml: &str) -> String {
        Config::from_layer(layer(toml)).expect_err("must be refused").to_string()
    }

    #[test]
    fn errors_name_the_key_in_all_its_forms() {
        let text = error("settle_seconds = -1");
        for name in ["`settle_seconds`", "--settle-seconds", "LODESTONE_SETTLE_SECONDS", "-1"] {
            assert!(text.contains(name), "{name} is missing in: {text}");
        }
        assert!(error("heavy_jobs = 0").contains("heavy_jobs"));
        assert!(error("threads = 0").contains("threads"));
        assert!(error("memory_limit = '1M'").contains("memory_limit"));
        assert!(error("stall_minutes = -1").contains("stall_minutes"));
        assert!(error("preview_frames = 721").contains("--preview-frames"));
        assert!(error("keep_days = nan").contains("keep_days"));
        assert!(error("listen = 'everywhere'").contains("`everywhere`"));
        let unknown = toml::from_str::<Layer>("setle_seconds = 1").expect_err("a typing error").to_string();
        assert!(unknown.contains("setle_seconds"), "{unknown}");
    }

    #[test]
    fn an_address_that_others_reach_needs_a_token_or_a_clear_word() {
        assert!(error("listen = '0.0.0.0:7700'").contains("open_to_network"));
        assert!(error("listen = '[::]:7700'").contains("token"));
        assert!(error("listen = '0.0.0.0:7700'\ntoken = 'short'").contains("token"));
        for fine in [
            "listen = '127.0.0.1:0'",
            "listen = '[::1]:7700'",
            "listen = '0.0.0.0:7700'\ntoken = 'long enough'",
            "listen = '0.0.0.0:7700'\nopen_to_network = true",
        ] {
            assert!(Config::from_layer(layer(fine)).is_ok(), "{fine}");
        }
    }

    #[test]
    fn the_upper_layer_wins_and_the_lower_fills_in() {
        let sum = layer("settle_seconds = 1").over(layer("settle_seconds = 2\nthreads = 3"));
        assert_eq!((sum.settle_seconds, sum.threads), (Some(1.0), Some(3)));
    }

    #[test]
    fn the_effective_configuration_reads_back_as_itself() {
        let config =
            Config::from_layer(layer("settle_seconds = 0.25\nmemory_limit = '2G'\nwatch = ['a', 'b c']\n\
                 on_done = 'move'\nhook_done = ['a b', '-c']\nhook_failed = '/d e'\nstall_minutes = 0.5\nkeep_days = 0\n\
                 format = 'potree,copc'\nlod_color = 'average'\npreview = false\npreview_frames = 72\npreview_color = 'height'\n\
                 upload = false\nupload_limit = '3G'"))
                .expect("a configuration");
        assert_eq!((config.stall, config.keep), (Some(30_000), None));
        let text = toml::to_string(&config.to_layer()).expect("TOML");
        assert_eq!(Config::from_layer(layer(&text)).expect("again"), config);
    }

    #[test]
    fn values_are_read_in_any_letter_case() {
        let config = Config::from_layer(layer(
            "sampling = 'Random'\nformat = ['COPC']\nencoding = 'brotli'\nlod_color = 'AVERAGE'\noutliers = 'Set_Aside'\n\
             damaged = 'Keep'\non_done = 'MOVE'\npreview_color = 'Height'\npreview = 'No'\nlog = 'debug'\n\
             log_format = 'JSON'\nopen_to_network = 1",
        ))
        .expect("a configuration");
        let text = toml::to_string(&config.to_layer()).expect("TOML");
        for line in [
            "sampling = \"random\"",
            "format = \"copc\"",
            "encoding = \"BROTLI\"",
            "outliers = \"set-aside\"",
            "on_done = \"move\"",
            "preview = false",
            "log = \"debug\"",
            "log_format = \"json\"",
        ] {
            assert!(text.contains(line), "{line} is missing in {text}");
        }
        let wrong = toml::from_str::<Layer>("sampling = 'best'").expect_err("none").to_string();
        assert!(wrong.contains("`best` is none of `poisson`"), "{wrong}");
    }

    #[test]
    fn the_variable_of_watched_folders_holds_a_list() {
        let watched = |variable: &str| {
            let layer = Layer { watch: vec![variable.into()], ..Layer::default() };
            layer.split_watched(Some(variable.as_ref())).watch
        };
        assert_eq!(watched("/srv/a:/srv/b c"), [PathBuf::from("/srv/a"), PathBuf::from("/srv/b c")]);
        assert_eq!(watched("/srv/a::"), [PathBuf::from("/srv/a")]);
        let folder = tempfile::Builder::new().prefix("a:b").tempdir().expect("a folder");
        assert_eq!(watched(folder.path().to_str().expect("UTF-8")), [folder.path()]);
        let flags = Layer { watch: vec!["/x:y".into(), "/z".into()], ..Layer::default() };
        assert_eq!(flags.clone().split_watched(Some("/z".as_ref())), flags);
    }

    #[test]
    fn the_token_is_never_told() {
        let config = Config::from_layer(layer("token = 'a great secret'")).expect("a configuration");
        assert!(!toml::to_string(&config.to_layer()).expect("TOML").contains("great"));
    }
}
