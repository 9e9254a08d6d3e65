//! The coordinate reference system of a data set: of what its files say, what the
//! points do not contradict.

use crate::format::crs;
use crate::format::las::LasFile;
use crate::octree::lattice::Lattice;

/// A data set's system.
#[derive(Debug, Default, PartialEq)]
pub struct ReferenceSystem {
    /// WKT wherever it is known, or a name; or empty.
    pub crs: String,
    /// For viewers: its horizontal part as a proj4 string, or empty.
    pub projection: String,
}

/// The system that was asked for, or the first file's that says something; files
/// that differ from it are noted.
pub fn find(
    files: &[LasFile],
    asked: Option<&str>,
    lattice: &Lattice,
    notes: &mut Vec<String>,
) -> ReferenceSystem {
    if let Some(asked) = asked {
        return ReferenceSystem { crs: asked.to_string(), projection: crs::proj4(asked).unwrap_or_default() };
    }
    let mut chosen: Option<ReferenceSystem> = None;
    for file in files {
        let Some(found) = &file.header().crs else { continue };
        let name = file.path().display();
        let Some(first) = &chosen else {
            if crs::is_geographic(&found.text) && !are_degrees(lattice) {
                notes.push(format!(
                    "{name}: its coordinate reference system counts in degrees, but the coordinates are none; \
                     it is left out"
                ));
                continue;
            }
            let projection = crs::proj4(&found.text).unwrap_or_default();
            chosen = Some(ReferenceSystem { crs: found.text.clone(), projection });
            continue;
        };
        let is_same =
            || !first.projection.is_empty() && crs::proj4(&found.text).as_ref() == Some(&first.projection);
        if first.crs != found.text && !is_same() {
            notes.push(format!(
                "{name}: its coordinate reference system differs from the first file's, which is kept"
            ));
        }
    }
    let reference = chosen.unwrap_or_default();
    if crs::is_geographic(&reference.crs) {
        notes.push(
            "x and y are degrees of longitude and latitude, heights are not: spacing and the octree's cube are \
             in both at once, and lengths in viewers mean nothing. A projected copy (UTM, for example) shows \
             true shapes"
                .to_string(),
        );
    }
    reference
}

/// Whether all positions could be degrees; longitudes may go round to 360.
fn are_degrees(lattice: &Lattice) -> bool {
    const MOST: [f64; 2] = [360.0, 90.0];
    (0..2).all(|axis| {
        let ends = [lattice.min[axis], lattice.max[axis]].map(|end| lattice.world(axis, end.into()));
        ends.iter().all(|end| end.abs() <= MOST[axis] + 1e-6)
    })
}
