//! Octrees that people look at: kept open between the requests of their viewers, so that
//! each reads no more than what it asks for.
//!
//! An octree is known by its folder and its revision, which tells it from another that
//! stood or will stand under the same name. Memory is bounded: a few octrees at a time,
//! each with a bounded part of its hierarchy, and a bounded number of requests that read.
//! All of this blocks; who calls it from async code does so on a thread of its own.

use std::collections::HashMap;
use std::fs;
use std::ops::Range;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError, RwLock};

use tokio::sync::Semaphore;

use crate::format::finished::{self, Finished};
use crate::format::potree::{METADATA, Node};
use crate::render::RenderError;
use crate::render::octree::Octree;
use crate::render::sample::CoarseSample;
use crate::render::viewer::description::Point;
use crate::render::viewer::{Description, Paint, pages, points};

/// Octrees that are open at a time.
const MAX_OPEN: usize = 4;
/// Nodes of an octree's hierarchy that are held.
const MAX_NODES: usize = 200_000;
/// Ways to color that are remembered of an octree.
const MAX_PAINTS: usize = 64;
/// Requests that read at a time.
const MAX_READING: usize = 4;
/// Points of one answer at most: 9 MB.
const MAX_POINTS: u32 = 1 << 20;

/// Why a viewer does not get what it asks for.
#[derive(Debug, thiserror::Error)]
pub enum ViewError {
    #[error("there is no octree of that name")]
    NoOctree,
    #[error("the octree was replaced by another; ask for its description again")]
    Replaced,
    #[error("the octree has no {0}")]
    Missing(String),
    #[error(transparent)]
    Unreadable(#[from] RenderError),
}

pub use crate::format::potree::NodeName;

type Result<T> = std::result::Result<T, ViewError>;

/// The octrees that are open, the one used last at the end. Cheap to clone.
#[derive(Clone)]
pub struct Viewer {
    opened: Arc<Mutex<Vec<Arc<View>>>>,
    /// Places for requests that read.
    pub places: Arc<Semaphore>,
}

impl Default for Viewer {
    fn default() -> Viewer {
        Viewer { opened: Arc::default(), places: Arc::new(Semaphore::new(MAX_READING)) }
    }
}

/// An open octree.
pub struct View {
    folder: PathBuf,
    revision: String,
    octree: RwLock<Octree>,
    sample: CoarseSample,
    paints: Mutex<HashMap<String, Arc<Paint>>>,
}

impl Viewer {
    /// The octree that stands in a folder now.
    ///
    /// # Errors
    /// Where there is none, or it is damaged.
    pub fn open(&self, folder: &Path) -> Result<Arc<View>> {
        let revision = revision(folder).ok_or(ViewError::NoOctree)?;
        if let Some(view) = self.known(folder, &revision) {
            return Ok(view);
        }
        let mut octree = Octree::open(folder)?;
        let sample = CoarseSample::take(&mut octree)?;
        let view = Arc::new(View {
            folder: folder.to_path_buf(),
            revision,
            octree: RwLock::new(octree),
            sample,
            paints: Mutex::default(),
        });
        let mut opened = self.opened.lock().unwrap_or_else(PoisonError::into_inner);
        opened.retain(|other| other.folder != folder);
        opened.push(view.clone());
        let excess = opened.len().saturating_sub(MAX_OPEN);
        opened.drain(..excess);
        Ok(view)
    }

    /// The same, where it still is the one of that revision.
    ///
    /// # Errors
    /// Where another stands there, or none.
    pub fn open_revision(&self, folder: &Path, revision: &str) -> Result<Arc<View>> {
        let view = self.open(folder)?;
        if view.revision == revision { Ok(view) } else { Err(ViewError::Replaced) }
    }

    fn known(&self, folder: &Path, revision: &str) -> Option<Arc<View>> {
        let mut opened = self.opened.lock().unwrap_or_else(PoisonError::into_inner);
        let at = opened.iter().position(|view| view.folder == folder && view.revision == revision)?;
        let view = opened.remove(at);
        opened.push(view.clone());
        Some(view)
    }
}

/// What tells the octree in a folder from any other that stood there: which file its
/// metadata is, how long and of when. Of a COPC file without an octree, the file itself.
fn revision(folder: &Path) -> Option<String> {
    let file = match finished::find(folder) {
        Finished::Octree(folder) => folder.join(METADATA),
        Finished::Copc(file) => file,
        Finished::Neither => return None,
    };
    let metadata = fs::metadata(file).ok().filter(fs::Metadata::is_file)?;
    let time = i128::from(metadata.mtime()) * 1_000_000_000 + i128::from(metadata.mtime_nsec());
    Some(format!("{:x}-{:x}-{time:x}", metadata.ino(), metadata.len()))
}

impl View {
    pub fn revision(&self) -> &str {
        &self.revision
    }

    /// What a viewer begins with, whose picture has this size.
    pub fn description(&self, size: [u32; 2]) -> Description {
        Description::of(&self.octree.read().unwrap_or_else(PoisonError::into_inner), &self.sample, size)
    }

    /// A page of the hierarchy.
    ///
    /// # Errors
    /// Where there is no such node, or the hierarchy is damaged.
    pub fn page(&self, root: NodeName) -> Result<Vec<u8>> {
        let mut octree = self.octree.write().unwrap_or_else(PoisonError::into_inner);
        bound(&mut octree);
        pages::page(&mut octree, root)?.ok_or_else(|| missing(root))
    }

    /// Some points of a node, colored by an attribute; with their positions or without.
    ///
    /// # Errors
    /// Where there is no such node or attribute, or they cannot be read.
    pub fn points(
        &self,
        name: NodeName,
        range: Range<u32>,
        by: &str,
        with_positions: bool,
    ) -> Result<Vec<u8>> {
        let node = self.node(name)?;
        let range = range.start..range.end.min(range.start.saturating_add(MAX_POINTS));
        let octree = self.octree.read().unwrap_or_else(PoisonError::into_inner);
        let paint = self.paint(&octree, by)?;
        Ok(points::encode(&octree, &node, range, &paint, with_positions)?)
    }

    /// All that is known of one point of a node.
    ///
    /// # Errors
    /// Where there is no such point, or it cannot be read.
    pub fn point(&self, name: NodeName, place: u32) -> Result<Point> {
        let node = self.node(name)?;
        let octree = self.octree.read().unwrap_or_else(PoisonError::into_inner);
        let point = Point::at(&octree, &node, place)?;
        point.ok_or_else(|| ViewError::Missing(format!("point {place} in node {name}")))
    }

    fn node(&self, name: NodeName) -> Result<Node> {
        let held = self.octree.read().unwrap_or_else(PoisonError::into_inner).held(name);
        if let Some(node) = held {
            return Ok(node);
        }
        let mut octree = self.octree.write().unwrap_or_else(PoisonError::into_inner);
        bound(&mut octree);
        // A chunk of the hierarchy names the chunks below it.
        for level in 0..name.level() {
            let Some(ancestor) = name.ancestor(level) else { continue };
            if octree.node(ancestor)?.is_none() {
                return Err(missing(name));
            }
        }
        octree.node(name)?.ok_or_else(|| missing(name))
    }

    fn paint(&self, octree: &Octree, by: &str) -> Result<Arc<Paint>> {
        let lock = || self.paints.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(paint) = lock().get(by) {
            return Ok(paint.clone());
        }
        let paint = Paint::by(octree, &self.sample, by);
        let paint = Arc::new(paint.ok_or_else(|| ViewError::Missing(format!("attribute {by:?}")))?);
        let mut paints = lock();
        if paints.len() < MAX_PAINTS {
            paints.insert(by.to_string(), paint.clone());
        }
        Ok(paint)
    }
}

fn bound(octree: &mut Octree) {
    if octree.nodes_held() > MAX_NODES {
        octree.forget_nodes();
    }
}

fn missing(name: NodeName) -> ViewError {
    ViewError::Missing(format!("node {name}"))
}
