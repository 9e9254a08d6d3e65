//! Every Prometheus series, named once. Base units, `_total` for counters, and
//! labels from closed sets only: no file name, no job number ever becomes one.

use prometheus::{
    Encoder, Gauge, Histogram, HistogramOpts, HistogramVec, IntCounter, IntCounterVec, IntGauge, IntGaugeVec,
    Opts, Registry, TextEncoder,
};

/// From a tenth of a second to a day: conversions take anything of that.
const SECONDS: [f64; 13] =
    [0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0, 3000.0, 10_000.0, 30_000.0, 86_400.0];

/// The stages of a conversion.
pub const STAGES: [&str; 5] = ["survey", "distribute", "index", "merge", "publish"];
/// Why points are set aside.
const SET_ASIDE: [&str; 4] = ["outlier", "duplicate", "twin", "other"];

/// All series. Cheap to clone.
#[derive(Debug, Clone)]
pub struct Metrics {
    registry: Registry,
    pub jobs: IntGaugeVec,
    pub jobs_held: IntGauge,
    pub running_jobs: IntGaugeVec,
    pub running_points: IntGaugeVec,
    pub running_points_done: IntGaugeVec,
    pub jobs_finished: IntCounterVec,
    pub attempts: IntCounter,
    pub oldest_queued_seconds: Gauge,
    pub job_seconds: Histogram,
    pub stage_seconds: HistogramVec,
    pub points_read: IntCounter,
    pub points_written: IntCounter,
    pub points_set_aside: IntCounterVec,
    pub input_bytes: IntCounter,
    pub output_bytes: IntCounter,
    pub copc_files: IntCounter,
    pub copc_bytes: IntCounter,
    pub free_bytes: IntGaugeVec,
    pub scratch_bytes: IntGauge,
    pub watched_folders: IntGaugeVec,
    pub watch_events: IntCounter,
    pub watch_overflows: IntCounter,
    pub watch_waiting: IntGauge,
    pub scans: IntCounter,
    pub last_scan_timestamp: Gauge,
    pub last_progress_timestamp: Gauge,
    pub queue_errors: IntCounter,
    pub jobs_stalled: IntCounter,
    pub sources: IntCounterVec,
    pub hooks: IntCounterVec,
    pub previews: IntCounterVec,
    pub previews_waiting: IntGauge,
    pub preview_seconds: Histogram,
    pub event_streams: IntGauge,
    pub runtime_tasks: IntGauge,
}

impl Metrics {
    /// Registers every series; an error is a name that stands twice.
    pub fn new() -> Result<Metrics, prometheus::Error> {
        let registry = Registry::new();
        let r = &registry;
        build_info(r)?;
        process(r)?;
        let metrics = Metrics {
            jobs: gauges(r, "lodestone_jobs", "Jobs in the queue by state.", "state")?,
            jobs_held: gauge(
                r,
                "lodestone_jobs_held",
                "Queued jobs that something holds, as too little room.",
            )?,
            running_jobs: gauges(
                r,
                "lodestone_running_jobs",
                "Conversions that are at work, by the stage they are in.",
                "stage",
            )?,
            running_points: gauges(
                r,
                "lodestone_running_points",
                "Points that conversions have to take through their present stage.",
                "stage",
            )?,
            running_points_done: gauges(
                r,
                "lodestone_running_points_done",
                "Points that conversions have taken through their present stage.",
                "stage",
            )?,
            jobs_finished: counters(
                r,
                "lodestone_jobs_finished_total",
                "Ended attempts by result.",
                "result",
            )?,
            attempts: counter(r, "lodestone_attempts_total", "Conversions begun.")?,
            oldest_queued_seconds: float(
                r,
                "lodestone_oldest_queued_seconds",
                "Age of the oldest queued job.",
            )?,
            job_seconds: {
                let opts = HistogramOpts::new("lodestone_job_seconds", "Duration of finished conversions.");
                let histogram = Histogram::with_opts(opts.buckets(SECONDS.to_vec()))?;
                r.register(Box::new(histogram.clone()))?;
                histogram
            },
            stage_seconds: {
                let opts =
                    HistogramOpts::new("lodestone_stage_seconds", "Duration of the stages of conversions.");
                let histogram = HistogramVec::new(opts.buckets(SECONDS.to_vec()), &["stage"])?;
                r.register(Box::new(histogram.clone()))?;
                histogram
            },
            points_read: counter(r, "lodestone_points_read_total", "Points read by finished conversions.")?,
            points_written: counter(r, "lodestone_points_written_total", "Points in published octrees.")?,
            points_set_aside: counters(
                r,
                "lodestone_points_set_aside_total",
                "Points set aside, by reason.",
                "reason",
            )?,
            input_bytes: counter(r, "lodestone_input_bytes_total", "Bytes of converted files.")?,
            output_bytes: counter(
                r,
                "lodestone_output_bytes_total",
                "Bytes of published octrees and COPC files.",
            )?,
            copc_files: counter(r, "lodestone_copc_files_total", "Published COPC files.")?,
            copc_bytes: counter(r, "lodestone_copc_bytes_total", "Bytes of published COPC files.")?,
            free_bytes: gauges(r, "lodestone_free_bytes", "Room on the disk of a folder.", "folder")?,
            scratch_bytes: gauge(r, "lodestone_scratch_bytes", "Bytes of intermediate files.")?,
            watched_folders: gauges(
                r,
                "lodestone_watched_folders",
                "Watched folders by how news of them comes.",
                "mode",
            )?,
            watch_events: counter(r, "lodestone_watch_events_total", "File events that mattered.")?,
            watch_overflows: counter(
                r,
                "lodestone_watch_overflows_total",
                "Times that file events were lost.",
            )?,
            watch_waiting: gauge(
                r,
                "lodestone_watch_waiting",
                "Data sets seen but not taken yet, or refused.",
            )?,
            scans: counter(r, "lodestone_scans_total", "Scans of the watched folders.")?,
            last_scan_timestamp: float(
                r,
                "lodestone_last_scan_timestamp_seconds",
                "When the watched folders were last scanned.",
            )?,
            last_progress_timestamp: float(
                r,
                "lodestone_last_progress_timestamp_seconds",
                "When a conversion last got further.",
            )?,
            queue_errors: counter(
                r,
                "lodestone_queue_errors_total",
                "Times that the queue's database failed.",
            )?,
            jobs_stalled: counter(
                r,
                "lodestone_jobs_stalled_total",
                "Runs that were stopped for want of any progress.",
            )?,
            sources: counters(
                r,
                "lodestone_sources_put_away_total",
                "Data sets whose sources were moved, deleted or kept after publishing.",
                "outcome",
            )?,
            hooks: counters(r, "lodestone_hooks_total", "Hooks that were run, by how they ended.", "result")?,
            previews: counters(
                r,
                "lodestone_previews_total",
                "Attempts at the pictures of an octree, by how they ended.",
                "outcome",
            )?,
            previews_waiting: gauge(
                r,
                "lodestone_previews_waiting",
                "Octrees whose pictures are still to be made.",
            )?,
            preview_seconds: {
                let opts = HistogramOpts::new(
                    "lodestone_preview_seconds",
                    "Duration of making an octree's pictures.",
                );
                let histogram = Histogram::with_opts(opts.buckets(SECONDS.to_vec()))?;
                r.register(Box::new(histogram.clone()))?;
                histogram
            },
            event_streams: gauge(r, "lodestone_event_streams", "Readers of the events that are connected.")?,
            runtime_tasks: gauge(
                r,
                "lodestone_runtime_tasks",
                "Tasks of the daemon's runtime that are alive.",
            )?,
            registry,
        };
        metrics.begin_at_zero();
        Ok(metrics)
    }

    /// A counter that appears with its first event has no increase: every label
    /// that there can be stands from the start.
    fn begin_at_zero(&self) {
        for result in ["done", "failed", "quarantined", "cancelled", "postponed"] {
            self.jobs_finished.with_label_values(&[result]);
        }
        for stage in STAGES {
            self.stage_seconds.with_label_values(&[stage]);
            self.running_jobs.with_label_values(&[stage]);
            self.running_points.with_label_values(&[stage]);
            self.running_points_done.with_label_values(&[stage]);
        }
        for reason in SET_ASIDE {
            self.points_set_aside.with_label_values(&[reason]);
        }
        for outcome in ["moved", "deleted", "kept", "gone"] {
            self.sources.with_label_values(&[outcome]);
        }
        for result in ["ok", "failed", "timeout"] {
            self.hooks.with_label_values(&[result]);
        }
        for outcome in ["done", "nothing", "postponed", "failed", "dropped"] {
            self.previews.with_label_values(&[outcome]);
        }
    }

    /// Counts points that were set aside; a reason that is not in the list is
    /// `other`, for labels come from closed sets only.
    pub fn set_aside(&self, reason: &str, points: u64) {
        let reason = SET_ASIDE.into_iter().find(|known| *known == reason).unwrap_or("other");
        self.points_set_aside.with_label_values(&[reason]).inc_by(points);
    }

    /// All series in the text format, with its content type.
    pub fn render(&self) -> Result<(String, Vec<u8>), prometheus::Error> {
        let encoder = TextEncoder::new();
        let mut text = Vec::new();
        encoder.encode(&self.registry.gather(), &mut text)?;
        Ok((encoder.format_type().to_string(), text))
    }
}

fn build_info(registry: &Registry) -> Result<(), prometheus::Error> {
    let info = gauges(registry, "lodestone_build_info", "Always 1; the version as a label.", "version")?;
    info.with_label_values(&[env!("CARGO_PKG_VERSION")]).set(1);
    Ok(())
}

#[cfg(target_os = "linux")]
fn process(registry: &Registry) -> Result<(), prometheus::Error> {
    registry.register(Box::new(prometheus::process_collector::ProcessCollector::for_self()))
}

#[cfg(not(target_os = "linux"))]
fn process(_registry: &Registry) -> Result<(), prometheus::Error> {
    Ok(())
}

fn counter(registry: &Registry, name: &str, help: &str) -> Result<IntCounter, prometheus::Error> {
    let counter = IntCounter::new(name, help)?;
    registry.register(Box::new(counter.clone()))?;
    Ok(counter)
}

fn counters(r: &Registry, name: &str, help: &str, label: &str) -> Result<IntCounterVec, prometheus::Error> {
    let counters = IntCounterVec::new(Opts::new(name, help), &[label])?;
    r.register(Box::new(counters.clone()))?;
    Ok(counters)
}

fn gauge(registry: &Registry, name: &str, help: &str) -> Result<IntGauge, prometheus::Error> {
    let gauge = IntGauge::new(name, help)?;
    registry.register(Box::new(gauge.clone()))?;
    Ok(gauge)
}

fn float(registry: &Registry, name: &str, help: &str) -> Result<Gauge, prometheus::Error> {
    let gauge = Gauge::new(name, help)?;
    registry.register(Box::new(gauge.clone()))?;
    Ok(gauge)
}

fn gauges(r: &Registry, name: &str, help: &str, label: &str) -> Result<IntGaugeVec, prometheus::Error> {
    let gauges = IntGaugeVec::new(Opts::new(name, help), &[label])?;
    r.register(Box::new(gauges.clone()))?;
    Ok(gauges)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_series_has_help_and_a_proper_name() {
        let metrics = Metrics::new().expect("no name stands twice");
        metrics.jobs.with_label_values(&["queued"]).set(1);
        metrics.jobs_finished.with_label_values(&["done"]).inc();
        metrics.stage_seconds.with_label_values(&["index"]).observe(1.0);
        let text = String::from_utf8(metrics.render().expect("text").1).expect("UTF-8");
        for line in text.lines().filter(|line| line.starts_with("# TYPE ")) {
            let mut words = line.split(' ').skip(2);
            let (name, kind) = (words.next().expect("name"), words.next().expect("type"));
            assert!(text.contains(&format!("# HELP {name} ")), "{name} has no help");
            assert_eq!(kind == "counter", name.ends_with("_total"), "{name} is a {kind}");
            assert!(!name.ends_with("_ms") && !name.ends_with("_milliseconds"), "{name}");
            assert!(name.starts_with("lodestone_") || name.starts_with("process_"), "{name}");
        }
    }
}
