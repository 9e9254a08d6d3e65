//! Runs a hook: a program of the operator's, told of a job's end by environment
//! variables. Its time is bounded, and whatever it does, the job stays as it is.

use std::process::{ExitStatus, Stdio};
use std::time::Duration;

use rustix::process::{Pid, Signal, kill_process_group};
use tokio::io::{AsyncRead, AsyncReadExt};
use tokio::process::Command;

use crate::serve::config::Config;
use crate::serve::config::hook::Hook;
use crate::serve::job::State;
use crate::serve::queue::PendingHook;

/// Bytes of its last words that are kept.
const TAIL: usize = 2048;
/// What it started may hold its stderr open for ever; the last words are waited
/// for only so long after its end.
const LAST_WORDS: Duration = Duration::from_secs(1);

/// How a hook ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum HookEnd {
    Well,
    Badly,
    TooLate,
}

impl HookEnd {
    /// For the metrics.
    pub fn name(self) -> &'static str {
        match self {
            HookEnd::Well => "ok",
            HookEnd::Badly => "failed",
            HookEnd::TooLate => "timeout",
        }
    }
}

/// The hook that is to be told of this end, where there is one.
pub(super) fn of(config: &Config, end: State) -> Option<&Hook> {
    if end == State::Done { config.hook_done.as_ref() } else { config.hook_failed.as_ref() }
}

/// What the program is told.
pub(super) fn environment(config: &Config, telling: &PendingHook) -> Vec<(&'static str, String)> {
    let job = &telling.job;
    let octree = match telling.end {
        State::Done => config.octrees().join(&job.name).to_string_lossy().into_owned(),
        _ => String::new(),
    };
    // What was converted, rather than what the headers claim, where that is known.
    let converted = job.result.as_ref().and_then(|result| result["points_out"].as_u64());
    let error = if telling.end == State::Done { None } else { job.error.clone() };
    vec![
        ("LODESTONE_JOB", job.id.to_string()),
        ("LODESTONE_NAME", job.name.clone()),
        ("LODESTONE_STATE", telling.end.name().to_string()),
        ("LODESTONE_OCTREE", octree),
        ("LODESTONE_SOURCE", telling.source_now.clone()),
        // A zero byte ends a variable, and cannot be handed over.
        ("LODESTONE_ERROR", error.unwrap_or_default().replace('\0', " ")),
        ("LODESTONE_POINTS", converted.unwrap_or(job.points).to_string()),
    ]
}

/// Runs the program to its end, or to the end of its time. Dropped before that,
/// the whole group of processes is killed.
pub(super) async fn run(
    hook: &Hook,
    environment: Vec<(&'static str, String)>,
    limit: Duration,
) -> (HookEnd, String) {
    let mut command = Command::new(hook.program());
    command.args(hook.arguments()).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped());
    for (name, _) in std::env::vars_os() {
        // Our own settings, the token among them, and systemd's line to us.
        let ours = name.to_string_lossy();
        if ours.starts_with("LODESTONE_") || ours == "NOTIFY_SOCKET" || ours.starts_with("WATCHDOG_") {
            command.env_remove(&name);
        }
    }
    // A group of its own: what it starts ends with it, and a Ctrl-C meant for us
    // does not reach it.
    command.envs(environment).process_group(0);
    let mut child = match command.spawn() {
        Ok(child) => child,
        Err(error) => return (HookEnd::Badly, format!("{} could not be started: {error}", hook.program())),
    };
    let group = ProcessGroup(child.id().and_then(|id| Pid::from_raw(id as i32)));
    let stderr = child.stderr.take();
    let mut last_words = Vec::new();
    let ended = {
        let (reading, waiting) =
            (read_tail(stderr, &mut last_words), tokio::time::timeout(limit, child.wait()));
        tokio::pin!(reading, waiting);
        let mut silent = false;
        let ended = loop {
            tokio::select! {
                ended = &mut waiting => break ended,
                // It closed its stderr, but is perhaps still at work.
                () = &mut reading, if !silent => silent = true,
            }
        };
        if ended.is_err() {
            group.kill();
        }
        if !silent {
            let _ = tokio::time::timeout(LAST_WORDS, &mut reading).await;
        }
        ended
    };
    if ended.is_err() {
        // Reaped, so that no zombie stays.
        let _ = child.wait().await;
    }
    group.forget();
    tell(hook, ended, limit, &last_words)
}

type Waited = Result<std::io::Result<ExitStatus>, tokio::time::error::Elapsed>;

fn tell(hook: &Hook, ended: Waited, limit: Duration, last_words: &[u8]) -> (HookEnd, String) {
    let program = hook.program();
    let (ended, mut text) = match ended {
        Ok(Ok(status)) if status.success() => (HookEnd::Well, format!("{program}: done")),
        Ok(Ok(status)) => (HookEnd::Badly, format!("{program}: {status}")),
        Ok(Err(error)) => (HookEnd::Badly, format!("{program}: {error}")),
        Err(_) => (HookEnd::TooLate, format!("{program}: killed after {} s", limit.as_secs_f64())),
    };
    let said = String::from_utf8_lossy(last_words);
    if !said.trim().is_empty() {
        text += "; it said: ";
        text += said.trim();
    }
    (ended, text)
}

/// Reads to the end and keeps the tail.
async fn read_tail(from: Option<impl AsyncRead + Unpin>, tail: &mut Vec<u8>) {
    let Some(mut from) = from else { return };
    let mut block = [0u8; 1024];
    while let Ok(read @ 1..) = from.read(&mut block).await {
        tail.extend_from_slice(&block[..read]);
        if tail.len() > TAIL {
            tail.drain(..tail.len() - TAIL);
        }
    }
}

/// The processes of one hook; killed when this is dropped before it is forgotten.
struct ProcessGroup(Option<Pid>);

impl ProcessGroup {
    fn kill(&self) {
        if let Some(group) = self.0 {
            // It may have ended in this moment.
            let _ = kill_process_group(group, Signal::KILL);
        }
    }

    fn forget(mut self) {
        self.0 = None;
    }
}

impl Drop for ProcessGroup {
    fn drop(&mut self) {
        self.kill();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Instant;

    fn shell(script: &str) -> Hook {
        Hook::new(vec!["/bin/sh".into(), "-c".into(), script.into()]).expect("a hook")
    }

    async fn run_for(script: &str, seconds: f64) -> (HookEnd, String) {
        run(&shell(script), vec![("LODESTONE_NAME", "a; b $c".into())], Duration::from_secs_f64(seconds))
            .await
    }

    #[tokio::test]
    async fn it_is_told_by_its_environment_and_its_last_words_are_kept() {
        let (ended, text) = run_for("echo \"$LODESTONE_NAME\" >&2; exit 3", 60.0).await;
        assert_eq!(ended, HookEnd::Badly);
        assert!(text.contains("3") && text.ends_with("it said: a; b $c"), "{text}");
        let (ended, text) =
            run_for("i=0; while [ $i -lt 9000 ]; do echo $i >&2; i=$((i+1)); done", 60.0).await;
        assert_eq!(ended, HookEnd::Well);
        assert!(text.ends_with("8999") && text.len() < TAIL + 100, "{text}");
    }

    /// What it left running in the background is killed with it.
    #[tokio::test]
    async fn one_that_never_ends_is_killed_with_all_that_it_started() {
        let folder = tempfile::tempdir().expect("a folder");
        let alive = folder.path().join("alive");
        let script = format!("(while :; do date > {}; sleep 0.02; done) & sleep 3600", alive.display());
        let start = Instant::now();
        let (ended, text) = run_for(&script, 0.5).await;
        assert_eq!(ended, HookEnd::TooLate, "{text}");
        assert!(start.elapsed() < Duration::from_secs(60));
        let _ = std::fs::remove_file(&alive);
        tokio::time::sleep(Duration::from_millis(300)).await;
        assert!(!alive.exists(), "its child still writes");
    }

    #[tokio::test]
    async fn one_that_closes_its_stderr_is_still_waited_for() {
        let (ended, _) = run_for("exec 2>&-; sleep 0.2; exit 7", 60.0).await;
        assert_eq!(ended, HookEnd::Badly);
        let (ended, text) =
            run(&Hook::new(vec!["/no/such/program".into()]).expect("a hook"), vec![], LAST_WORDS).await;
        assert_eq!(ended, HookEnd::Badly);
        assert!(text.contains("/no/such/program could not be started"), "{text}");
    }
}
