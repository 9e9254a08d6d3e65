//! What the command line, the log and the API tell.

mod api;
mod info;
mod jobs;
mod output;
mod values;

use std::path::Path;
use std::process::{Command, Output};

/// Runs the program to its end.
fn lodestone(arguments: &[&str]) -> Output {
    command(arguments).output().expect("started")
}

fn command(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lodestone"));
    command.args(arguments).env_remove("LODESTONE_LOG");
    command
}

fn stdout(run: &Output) -> String {
    String::from_utf8_lossy(&run.stdout).into_owned()
}

fn stderr(run: &Output) -> String {
    String::from_utf8_lossy(&run.stderr).into_owned()
}

fn text(path: &Path) -> &str {
    path.to_str().expect("UTF-8")
}
