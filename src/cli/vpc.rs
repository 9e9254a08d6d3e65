//! `lodestone vpc`: the COPC files of a folder as one virtual point cloud.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::exit::Exit;
use super::output::{complain, failed, say};
use crate::convert::context::{Cancel, Context};
use crate::export::overview::{self, Overview, Place};
use crate::export::vpc;
use crate::platform::disk::Disk;
use crate::platform::limits;
use crate::words::{Plain, grouped};

/// List the COPC files of a folder as one virtual point cloud, which QGIS and PDAL open as one
/// layer
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// A folder with COPC files in it, or in the folders in it
    folder: PathBuf,
    /// The file to write; NAME.vpc in the folder, after its name, if not given
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// A COPC file with some points of all the others, to show from afar; made as
    /// NAME-overview.copc.laz beside the list if not given
    #[arg(long, value_name = "COPC")]
    overview: Option<PathBuf>,
    /// Make no overview
    #[arg(long, conflicts_with = "overview")]
    no_overview: bool,
    /// Print the list and write no file
    #[arg(long, conflicts_with = "output")]
    print: bool,
}

pub fn run(arguments: Arguments) -> Exit {
    let folder = arguments.folder;
    if !folder.is_dir() {
        complain(format_args!("{} is no folder", Plain(folder.display())));
        return Exit::Failed;
    }
    let output = arguments.output.unwrap_or_else(|| folder.join(format!("{}.vpc", name_of(&folder))));
    let beside = output.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut place = Place::of_list(&output);
    let is_given = |path: &PathBuf| arguments.overview.as_ref().is_some_and(|given| is_same(given, path));
    let files: Vec<PathBuf> =
        vpc::found(&folder).into_iter().filter(|path| !place.has(path) && !is_given(path)).collect();
    let memory_limit = limits::default_memory_limit();
    let overviews = match &arguments.overview {
        Some(path) => vec![Overview { path: path.clone(), crs: None }],
        None if arguments.print => place.existing(),
        None => {
            let wanted: &[PathBuf] = if arguments.no_overview { &[] } else { &files };
            match overview::update(wanted, &mut place, &context(memory_limit)) {
                Ok(overviews) => overviews,
                Err(error) => return failed(&error),
            }
        }
    };
    let made = vpc::list(&files, beside, &overviews, memory_limit);
    for (path, reason) in &made.left_out {
        complain(format_args!("{} is left out: {}", Plain(path.display()), Plain(reason)));
    }
    if made.files == 0 {
        complain(format_args!("{} has no COPC file (*.copc.laz) that can be read", Plain(folder.display())));
        return Exit::Failed;
    }
    if arguments.print {
        say!("{}", made.json.trim_end());
    } else {
        if let Err(error) = Disk::new().write_atomic(&output, made.json.as_bytes()) {
            return failed(&error);
        }
        let (path, files, points) =
            (Plain(output.display()), grouped(made.files as u64), grouped(made.points));
        say!("{path}: {files} COPC files with {points} points");
    }
    if made.left_out.is_empty() { Exit::Done } else { Exit::Failed }
}

fn context(memory_limit: u64) -> Context {
    Context {
        disk: Disk::new(),
        // It gets one of its own beside the list.
        scratch: PathBuf::new(),
        threads: limits::threads(),
        memory_limit,
        cancel: Cancel::default(),
        progress: Arc::default(),
    }
}

fn is_same(a: &Path, b: &Path) -> bool {
    matches!((std::fs::canonicalize(a), std::fs::canonicalize(b)), (Ok(a), Ok(b)) if a == b)
}

fn name_of(folder: &Path) -> String {
    let absolute = std::fs::canonicalize(folder).unwrap_or_else(|_| folder.to_path_buf());
    absolute.file_name().map_or("clouds".to_string(), |name| name.to_string_lossy().into_owned())
}
