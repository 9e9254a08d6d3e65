//! What single readers of COPC are known to trip over, though the file may be right.

use super::super::report::Check;
use crate::format::copc::CopcFile;

/// What single readers are known to trip over; nothing where there is nothing.
pub fn notes(file: &CopcFile) -> Option<Check> {
    let front = &file.front;
    let mut notes: Vec<String> = file
        .hierarchy
        .oddities
        .iter()
        .filter(|oddity| !oddity.is_wrong)
        .map(|oddity| oddity.text.clone())
        .collect();
    let mut note = |holds: bool, text: &str| {
        if !holds {
            notes.push(text.to_string());
        }
    };
    let exact = 2.0 * front.info.halfsize / 128.0;
    note(
        (front.info.spacing - exact).abs() <= exact * 1e-9,
        "the spacing is not 1/128 of the cube, as QGIS takes it",
    );
    note(front.global_encoding & 1 << 4 != 0, "the global encoding does not say that the CRS is WKT");
    note(front.legacy == [0; 6], "counts of 32 bits are not 0, as they should be of these point formats");
    let hierarchy = file.extended.iter().find(|place| place.is("copc", 1000));
    let is_first = hierarchy.is_some_and(|place| place.data_at == front.info.root.0);
    note(is_first, "the root page is not the first of the hierarchy; las-rs misreads the others");
    note(front.points_at <= 1 << 16, "the records are longer than the 64 KiB that copc.js asks for at first");
    let all = || file.records.iter().chain(&file.extended);
    note(
        all().all(|place| place.is_padded),
        "texts of records are not padded with zeros; copc-lib refuses that",
    );
    let wkt = all().find(|place| place.is("LASF_Projection", 2112) && place.length > 1);
    note(wkt.is_some(), "there is no CRS as WKT; iTowns asks for one");
    note(
        file.extended.iter().any(|place| place.is("qgis", 0)),
        "QGIS will write its statistics into the file",
    );
    let cube = file.cube();
    let is_within = |axis: usize| {
        let (low, high) = (cube.center[axis] - cube.halfsize, cube.center[axis] + cube.halfsize);
        front.points == 0 || low <= front.min[axis] && front.max[axis] <= high
    };
    note((0..3).all(is_within), "the header's box reaches beyond the cube; copc-validator objects to that");
    let tuples = file.record("LASF_Spec", 4).ok().flatten().unwrap_or_default();
    note(
        tuples.chunks_exact(192).all(|field| field[2] <= 10),
        "extra bytes of several elements; copc.js refuses them",
    );
    let hollow = hollow(file);
    note(
        hollow == 0,
        &format!("{hollow} nodes without points stand above nodes with some; QGIS shows patches"),
    );
    if notes.is_empty() {
        return None;
    }
    let count = notes.len() as u64;
    let mut check = Check::note("readers", format!("{count} things that some readers trip over"));
    (check.count, check.examples) = (count, notes);
    Some(check)
}

/// Nodes without points above others; the root of an empty file is none.
fn hollow(file: &CopcFile) -> u64 {
    let empty = file.nodes().iter().filter(|entry| entry.points == 0 && entry.key.level < 31);
    empty.filter(|entry| (0..8).any(|index| file.node(entry.key.child(index)).is_some())).count() as u64
}
