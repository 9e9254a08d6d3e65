//! `lodestone info`: a page about an octree or a LAS file, for a person. It
//! tells what the file says of itself and reads no points.

mod copc;
mod json;
mod page;

use std::path::{Path, PathBuf};

use super::exit::Exit;
use super::output::{self, failed};
use crate::format::finished::{self, Finished};
use crate::format::las::{Header, LasFile};
use crate::format::potree::hierarchy::{inspect_hierarchy_file, most_nodes};
use crate::format::potree::{self, Metadata, files};
use crate::platform::limits::default_memory_limit;
use page::{las_page, octree_page};

/// Describe an octree or a LAS/LAZ file
#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// The folder of an octree, or a LAS or LAZ file
    path: PathBuf,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub fn run(arguments: Arguments) -> Exit {
    let path = arguments.path;
    let text = match finished::find(&path) {
        Finished::Octree(folder) => of_octree(&folder, arguments.json).map_err(|error| failed(&error)),
        Finished::Copc(file) => {
            copc::describe(&file, default_memory_limit(), arguments.json).map_err(|error| failed(&error))
        }
        Finished::Neither if path.is_dir() => {
            of_octree(&path, arguments.json).map_err(|error| failed(&error))
        }
        Finished::Neither => LasFile::open(&path)
            .map_err(|error| failed(&error))
            .map(|file| of_las(&path, file.header(), arguments.json)),
    };
    match text {
        Ok(text) => output::print(&text, Exit::Done),
        Err(exit) => exit,
    }
}

fn of_las(path: &Path, header: &Header, as_json: bool) -> String {
    if as_json { json::pretty(&json::las(path, header)) } else { las_page(path, header) }
}

fn of_octree(folder: &Path, as_json: bool) -> potree::Result<String> {
    let metadata = Metadata::read(folder)?;
    let (hierarchy, length) = files::open(folder, potree::HIERARCHY)?;
    let first = metadata.hierarchy.first_chunk_size;
    let (nodes, _) = inspect_hierarchy_file(&hierarchy, length, first, most_nodes(default_memory_limit()))?;
    Ok(match as_json {
        true => json::pretty(&json::octree(folder, &metadata, &nodes)),
        false => octree_page(folder, &metadata, &nodes),
    })
}
