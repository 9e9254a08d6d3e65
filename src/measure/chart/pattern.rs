//! What sample patterns look like: dots in squares, side by side.

#[derive(Debug, Clone, Default, PartialEq)]
pub struct Patterns {
    /// For those who hear the chart instead of seeing it.
    pub title: String,
    pub patterns: Vec<Pattern>,
}

#[derive(Debug, Clone, Default, PartialEq)]
pub struct Pattern {
    pub name: String,
    /// A few words below the name: "0.9 % too close".
    pub note: String,
    /// From 0 to 1 on both axes; y points up.
    pub dots: Vec<[f64; 2]>,
    /// Dots to point at, drawn over the others in another colour: pairs that are too
    /// close, say.
    pub marked: Vec<[f64; 2]>,
}
