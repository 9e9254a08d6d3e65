//! What keeps points out of an octree, or a conversion from failing on them: distant
//! points, coincident points, exact duplicates, damaged files.

pub(super) mod coincident_points;
pub mod damaged_input;
pub(super) mod exact_duplicates;
pub mod outliers;
