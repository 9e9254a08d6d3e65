//! Extra bytes whose names viewers take for their own.

use lodestone::format::las::LasOptions;
use lodestone::octree::attribute::{ExtraField, Scalar};

use super::super::common::{options_of, surface};
use super::{case, octree_of, tile};

fn names(metadata: &lodestone::format::potree::Metadata) -> Vec<&str> {
    metadata.attributes.iter().map(|attribute| attribute.name.as_str()).collect()
}

#[test]
fn given_names_of_viewers_are_numbered() {
    for (file, right) in [("c18_RGBA_u4.las", "RGBA (2)"), ("c18_color_u2.las", "color (2)")] {
        let Some(path) = case(file) else { return };
        let folder = tempfile::tempdir().unwrap();
        let held = octree_of(&path, folder.path());
        let names = names(&held.metadata);
        assert!(names.contains(&right) && names.contains(&"rgb"), "{names:?}");
        assert!(!names.contains(&&right[..right.len() - 4]), "{names:?}");
    }
}

#[test]
fn names_that_viewers_look_up_are_numbered() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cloud.las");
    let own = ["indices", "Intensity", "returnNumber", "SPACING", "constructor", "mine"];
    let field = |(number, name): (usize, &&str)| ExtraField {
        name: name.to_string(),
        description: String::new(),
        scalar: Scalar::U8,
        elements: 1,
        position: 20 + number,
        scale: Vec::new(),
        offset: Vec::new(),
    };
    let options = LasOptions { extra: own.iter().enumerate().map(field).collect(), ..options_of(0, false) };
    // As long as the records of format 2 are.
    tile(&path, &options, &surface(2, 500, 3), &[]);
    let held = octree_of(&path, folder.path());
    let names = names(&held.metadata);
    let right = own[..5].iter().map(|name| format!("{name} (2)")).chain(["mine".to_string()]);
    assert!(
        names.ends_with(&right.collect::<Vec<_>>().iter().map(String::as_str).collect::<Vec<_>>()),
        "{names:?}"
    );
}
