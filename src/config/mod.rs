//! Configuration of the daemon: every key once, as a flag, as an environment
//! variable `LODESTONE_…` and in a TOML file, in this order of precedence.
//!
//! [`Layer`] is what one of these sources says; [`Config`] is the checked sum.
//! All is checked at start: a daemon that is left alone for a year must not find
//! a wrong value in its eleventh month.

pub mod size;

use std::net::{IpAddr, SocketAddr};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::job::verdict::Policy;
use crate::stage::machine;
use crate::stage::options::{Encoding, Options, Sampling};
use size::Size;

#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    #[error("could not read the configuration {}: {source}", path.display())]
    Read {
        path: PathBuf,
        #[source]
        source: std::io::Error,
    },
    #[error("the configuration {} is wrong: {message}", path.display())]
    Parse { path: PathBuf, message: String },
    #[error("`{key}` (flag --{}, environment LODESTONE_{}): {message}", key.replace('_', "-"), key.to_uppercase())]
    Value { key: &'static str, message: String },
}

/// What one source of configuration says; what it leaves out is empty.
#[derive(Debug, Clone, Default, PartialEq, clap::Args, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Layer {
    /// The folder of inbox, octrees, scratch and the queue [default: ./lodestone-data].
    #[arg(long, env = "LODESTONE_ROOT", value_name = "DIR")]
    pub root: Option<PathBuf>,
    /// Another folder to watch besides the inbox; may be given several times.
    #[arg(long, env = "LODESTONE_WATCH", value_name = "DIR")]
    pub watch: Vec<PathBuf>,
    /// Address of the HTTP API [default: 127.0.0.1:7700].
    #[arg(long, env = "LODESTONE_LISTEN", value_name = "ADDRESS")]
    pub listen: Option<String>,
    /// A secret that API requests must bring (`Authorization: Bearer …`).
    #[arg(long, env = "LODESTONE_TOKEN", value_name = "SECRET", hide_env_values = true)]
    pub token: Option<String>,
    /// Let everybody who reaches the address read and control the queue.
    #[arg(long, env = "LODESTONE_OPEN_TO_NETWORK", num_args = 0..=1, default_missing_value = "true")]
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
    /// How nodes are sampled [default: poisson].
    #[arg(long, env = "LODESTONE_SAMPLING", value_enum, ignore_case = true)]
    pub sampling: Option<Sampling>,
    /// How points are stored [default: default].
    #[arg(long, env = "LODESTONE_ENCODING", value_enum, ignore_case = true)]
    pub encoding: Option<Encoding>,
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

    /// This layer, and where it is silent the other.
    pub fn over(self, other: Layer) -> Layer {
        Layer {
            root: self.root.or(other.root),
            watch: if self.watch.is_empty() { other.watch } else { self.watch },
            listen: self.listen.or(other.listen),
            token: self.token.or(other.token),
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
            sampling: self.sampling.or(other.sampling),
            encoding: self.encoding.or(other.encoding),
        }
    }
}

/// The checked configuration. Times are milliseconds, sizes bytes.
#[derive(Debug, Clone, PartialEq)]
pub struct Config {
    pub root: PathBuf,
    pub watch: Vec<PathBuf>,
    pub listen: SocketAddr,
    pub token: Option<String>,
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
    /// Options of conversions whose data set does not say its own.
    pub options: Options,
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
        if layer.token.as_deref().is_some_and(|token| token.trim().len() < 8) {
            return Err(wrong("token", "a secret of fewer than 8 characters is none"));
        }
        if !is_loopback(listen.ip()) && layer.token.is_none() && !open {
            let message = format!(
                "{listen} can be reached from other machines, which could then read every octree and control \
                 the queue; give a `token`, or say `open_to_network` to allow it to everybody"
            );
            return Err(wrong("listen", message));
        }
        Ok(Config {
            root: layer.root.unwrap_or_else(|| PathBuf::from("lodestone-data")),
            watch: layer.watch,
            listen,
            token: layer.token,
            settle: millis("settle_seconds", layer.settle_seconds, 5.0)?,
            patience: millis("patience_seconds", layer.patience_seconds, 120.0)?,
            rescan: millis("rescan_seconds", layer.rescan_seconds, 30.0)?.max(100),
            heavy_jobs: at_least_one("heavy_jobs", layer.heavy_jobs, 1)? as usize,
            light_jobs: layer.light_jobs.unwrap_or(2) as usize,
            light_bytes: layer.light_bytes.unwrap_or(Size(64 << 20)).0,
            threads: match layer.threads {
                Some(0) => return Err(wrong("threads", "at least one thread is needed")),
                Some(threads) => threads,
                None => machine::threads(),
            },
            memory_limit: match layer.memory_limit {
                Some(Size(bytes)) if bytes < 128 << 20 => {
                    return Err(wrong("memory_limit", "a conversion needs at least 128M"));
                }
                Some(Size(bytes)) => bytes,
                None => (machine::memory() / 2).max(256 << 20),
            },
            disk_reserve: layer.disk_reserve.unwrap_or(Size(256 << 20)).0,
            policy: Policy {
                max_strikes: at_least_one("max_strikes", layer.max_strikes, 3)?,
                max_postponements: at_least_one("max_postponements", layer.max_postponements, 20)?,
                first_wait: millis("retry_seconds", layer.retry_seconds, 5.0)?,
                ..Policy::default()
            },
            shutdown: millis("shutdown_seconds", layer.shutdown_seconds, 20.0)?,
            options: Options {
                sampling: layer.sampling.unwrap_or_default(),
                encoding: layer.encoding.unwrap_or_default(),
                ..Options::default()
            },
        })
    }

    /// The effective configuration in the form of its file; the token is not told.
    pub fn to_layer(&self) -> Layer {
        let seconds = |millis: i64| Some(millis as f64 / 1000.0);
        Layer {
            root: Some(self.root.clone()),
            watch: self.watch.clone(),
            listen: Some(self.listen.to_string()),
            token: self.token.as_ref().map(|_| "(set)".to_string()),
            open_to_network: Some(!is_loopback(self.listen.ip()) && self.token.is_none()),
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
            sampling: Some(self.options.sampling),
            encoding: Some(self.options.encoding),
        }
    }
}

fn wrong(key: &'static str, message: impl Into<String>) -> ConfigError {
    ConfigError::Value { key, message: message.into() }
}

fn millis(key: &'static str, seconds: Option<f64>, default: f64) -> Result<i64, ConfigError> {
    let seconds = seconds.unwrap_or(default);
    // NaN fails this as well.
    if !(0.0..=31_536_000.0).contains(&seconds) {
        return Err(wrong(key, format!("{seconds} is not between 0 seconds and a year")));
    }
    Ok((seconds * 1000.0).round() as i64)
}

fn at_least_one(key: &'static str, value: Option<u32>, default: u32) -> Result<u32, ConfigError> {
    match value.unwrap_or(default) {
        0 => Err(wrong(key, "must be at least 1")),
        value => Ok(value),
    }
}

fn is_loopback(address: IpAddr) -> bool {
    match address {
        IpAddr::V4(v4) => v4.is_loopback(),
        IpAddr::V6(v6) => v6.is_loopback() || v6.to_ipv4_mapped().is_some_and(|v4| v4.is_loopback()),
    }
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
            Config::from_layer(layer("settle_seconds = 0.25\nmemory_limit = '2G'\nwatch = ['a', 'b c']"))
                .expect("a configuration");
        let text = toml::to_string(&config.to_layer()).expect("TOML");
        assert_eq!(Config::from_layer(layer(&text)).expect("again"), config);
    }

    #[test]
    fn the_token_is_never_told() {
        let config = Config::from_layer(layer("token = 'a great secret'")).expect("a configuration");
        assert!(!toml::to_string(&config.to_layer()).expect("TOML").contains("great"));
    }
}
