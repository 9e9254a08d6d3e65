//! By what means everything is measured: the program, threads, rounds, a folder
//! for what is large and temporary, and a way to stop it all.

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

use super::process::{self, ProcessEnd};
use crate::convert::context::Cancel;
use crate::format::inputs::InputsError;
use crate::format::las::LasError;
use crate::format::potree::PotreeError;
use crate::lab::synth::{Recipe, SceneKind};
use crate::render::RenderError;

/// The point format of all clouds: colours, 26 bytes.
const FORMAT: &str = "2";

#[derive(Debug, Clone)]
pub struct BenchmarkSettings {
    /// The program that converts: this one.
    pub program: PathBuf,
    pub threads: usize,
    /// Times that each conversion is done.
    pub rounds: usize,
    /// Clouds and octrees go below this folder, and are removed afterwards.
    pub folder: PathBuf,
    /// Stops it all, and leaves nothing behind.
    pub cancel: Cancel,
}

/// How far it is.
#[derive(Debug, Clone)]
pub struct Step {
    pub done: usize,
    pub of: usize,
    pub what: String,
}

/// Why there are no figures. A conversion that fails is a figure of its own
/// where stability is measured, and an error elsewhere.
#[derive(Debug, thiserror::Error)]
pub enum MeasureError {
    #[error("could not work in {}: {source} (choose another place with --temp-dir)", path.display())]
    Folder { path: PathBuf, source: io::Error },
    #[error("the report was stopped on request; nothing was written")]
    Stopped,
    #[error("could not measure {what}: {source}")]
    Run { what: String, source: io::Error },
    #[error("could not write {}: {source}", path.display())]
    Write { path: PathBuf, source: io::Error },
    #[error("{what} failed: {words}")]
    Failed { what: String, words: String },
    #[error("{}: {problem}", path.display())]
    Earlier { path: PathBuf, problem: String },
    #[error(transparent)]
    Inputs(#[from] InputsError),
    #[error(transparent)]
    Las(#[from] LasError),
    #[error(transparent)]
    Potree(#[from] PotreeError),
    #[error(transparent)]
    Render(#[from] RenderError),
}

pub type Result<T> = std::result::Result<T, MeasureError>;

impl BenchmarkSettings {
    pub fn go_on(&self) -> Result<()> {
        if self.cancel.is_cancelled() { Err(MeasureError::Stopped) } else { Ok(()) }
    }

    /// What became of a process, unless it was called off.
    pub fn ended<T>(&self, what: &str, ended: io::Result<T>) -> Result<T> {
        self.go_on()?;
        ended.map_err(|source| MeasureError::Run { what: what.to_string(), source })
    }

    /// Makes the cloud of a recipe in a folder that is emptied before: one file or
    /// several.
    pub fn synthesise(&self, recipe: &Recipe, title: &str, folder: &Path) -> Result<()> {
        let fault = |source| MeasureError::Folder { path: folder.to_path_buf(), source };
        match std::fs::remove_dir_all(folder) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(fault(error)),
            _ => std::fs::create_dir_all(folder).map_err(fault)?,
        }
        let Recipe { kind, points, seed, share, twins, teapot, span } = *recipe;
        let mut command = Command::new(&self.program);
        command.args(["synth", kind.name(), "--format", FORMAT]);
        command.args(["--points", &points.to_string(), "--seed", &seed.to_string()]);
        command.args(["--share", &share.to_string(), "--span", &span.to_string()]);
        command.args(twins.then_some("--twins")).args(teapot.then_some("--teapot"));
        // The scene of many tiles makes a folder of its own.
        let output = if kind == SceneKind::Strips { folder.to_path_buf() } else { folder.join("cloud.las") };
        command.arg("-o").arg(output);
        let made = process::run_until(&mut command, &self.cancel);
        self.ended(&format!("making {title}"), made)?;
        Ok(())
    }

    /// Converts, with these arguments beside the usual ones. What the program
    /// says goes into the file `words`.
    pub fn convert(
        &self,
        arguments: &[&str],
        cloud: &Path,
        octree: &Path,
        words: &Path,
        patience: Duration,
    ) -> Result<ProcessEnd> {
        let file = File::create(words);
        let file = file.map_err(|source| MeasureError::Folder { path: words.to_path_buf(), source })?;
        let mut command = Command::new(&self.program);
        command.args(["convert", "--overwrite", "--progress", "json", "--log", "warn"]).args(arguments);
        command.args(["--threads", &self.threads.to_string()]);
        command.arg(cloud).arg("-o").arg(octree).stdout(Stdio::null()).stderr(file);
        self.ended("the conversion", process::run_within(&mut command, patience, &self.cancel))
    }
}

/// A folder that all happens in; it goes when this does.
pub struct WorkFolder(PathBuf);

impl WorkFolder {
    pub fn new(means: &BenchmarkSettings) -> Result<WorkFolder> {
        let path = means.folder.join(format!(".lodestone-report-{}", std::process::id()));
        std::fs::create_dir_all(&path)
            .map_err(|source| MeasureError::Folder { path: path.clone(), source })?;
        Ok(WorkFolder(path))
    }

    pub fn at(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }

    /// Removes a folder below, if there is one.
    pub fn clear(&self, name: &str) -> Result<()> {
        let path = self.at(name);
        match std::fs::remove_dir_all(&path) {
            Err(source) if source.kind() != io::ErrorKind::NotFound => {
                Err(MeasureError::Folder { path, source })
            }
            _ => Ok(()),
        }
    }
}

impl Drop for WorkFolder {
    fn drop(&mut self) {
        // Where this fails there is nobody left to tell but the log.
        if let Err(error) = std::fs::remove_dir_all(&self.0) {
            tracing::warn!(folder = %self.0.display(), %error, "left something behind");
        }
    }
}

/// The last words of a program that failed.
pub fn last_words(words: &Path) -> Option<String> {
    let text = std::fs::read_to_string(words).unwrap_or_default();
    text.lines().rev().find(|line| line.starts_with("lodestone:")).map(str::to_string)
}
