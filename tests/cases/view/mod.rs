//! The viewer: what the daemon sends it, what its scripts make of that, and how it looks.

mod browser;
mod data;
mod served;
mod twins;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::common::judge::write_scene;
use lodestone::convert::options::Options;
use lodestone::format::potree::NodeName;
use lodestone::lab::synth::{Recipe, SceneKind};
use lodestone::render::octree::Octree;
use lodestone::render::viewer::pages;

/// An octree of a scene.
fn octree_of(kind: SceneKind, points: u64, folder: &Path, options: &Options) -> PathBuf {
    let cloud = write_scene(Recipe::new(kind, points, 5), folder);
    let output = folder.join("octree");
    crate::common::convert(&[cloud], &output, options).unwrap();
    output
}

/// All pages of an octree, of so many nodes each, by the node they begin with; and its nodes
/// by name with their points, read from the pages alone.
fn all_pages(octree: &mut Octree, nodes: usize) -> (BTreeMap<NodeName, Vec<u8>>, BTreeMap<NodeName, u32>) {
    let (mut found, mut read) = (BTreeMap::new(), BTreeMap::new());
    let mut wanted = vec![NodeName::ROOT];
    while let Some(root) = wanted.pop() {
        let page = pages::bounded_page(octree, root, nodes).unwrap().unwrap();
        assert!(page.len() <= pages::RECORD * nodes, "{} bytes", page.len());
        let mut names = vec![root];
        for (at, record) in page.chunks_exact(pages::RECORD).enumerate() {
            let name = names[at];
            let points = u32::from_le_bytes(record[2..].try_into().unwrap());
            assert_eq!(*found.entry(name).or_insert(points), points, "{name} is the same on every page");
            if record[1] & pages::ELSEWHERE != 0 {
                assert!(at > 0, "a page leads on");
                wanted.push(name);
            } else {
                names.extend(
                    (0..8).filter(|digit| record[0] >> digit & 1 == 1).map(|d| name.child(d).unwrap()),
                );
            }
        }
        assert_eq!(names.len() * pages::RECORD, page.len());
        assert!(read.insert(root, page).is_none(), "no page twice");
    }
    (read, found)
}

/// A folder with the viewer's scripts and those of the tests, for Node.
fn scripts(folder: &Path) -> PathBuf {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let target = folder.join("scripts");
    std::fs::create_dir_all(&target).unwrap();
    for from in ["src/serve/web/pages/assets/viewer", "tests/cases/view"] {
        for entry in std::fs::read_dir(root.join(from)).unwrap() {
            let path = entry.unwrap().path();
            if path.extension().is_some_and(|extension| extension == "js" || extension == "mjs") {
                std::fs::copy(&path, target.join(path.file_name().unwrap())).unwrap();
            }
        }
    }
    std::fs::write(target.join("package.json"), r#"{"type":"module"}"#).unwrap();
    target
}
