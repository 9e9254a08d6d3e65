//! From raw LAS records to the octree's records.
//!
//! Raw records stay raw, through scratch files too, until a point is written
//! into its node: then, once, its fields are moved to where the octree's schema
//! has them.

use super::attribute::{Attribute, ExtraField, RGB, Scalar, Schema};
use super::attribute_names::{merge, viewing_order};
use super::record_converter::RecordConverter;
use super::standard_fields::{FieldLocation, fields};

/// One file's raw records.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordFormat {
    /// LAS point format, 0 to 10.
    pub format: u8,
    /// Bytes a record, extra bytes included.
    pub record_length: usize,
    pub extra: Vec<ExtraField>,
}

impl RecordFormat {
    /// Every attribute the records hold, with where it lies.
    fn attributes(&self, second_color: Option<&'static str>) -> Vec<(Attribute, FieldLocation, bool)> {
        let standard = fields(self.format, second_color)
            .into_iter()
            .map(|f| (Attribute::new(f.name, f.scalar, f.elements), f.place, f.always));
        let extra = self.extra.iter().map(|e| {
            let mut attribute = Attribute::new(&e.name, e.scalar, e.elements);
            attribute.description.clone_from(&e.description);
            if !e.scale.is_empty() {
                attribute.scale.clone_from(&e.scale);
            }
            if !e.offset.is_empty() {
                attribute.offset.clone_from(&e.offset);
            }
            let place = FieldLocation::Bytes { at: e.position, len: attribute.size() };
            (attribute, place, true)
        });
        standard.chain(extra).collect()
    }

    /// Whether a field is anywhere but zero, by the bytes of all records ORed
    /// into one.
    fn is_used(place: FieldLocation, ored: &[u8]) -> bool {
        match place {
            FieldLocation::Bytes { at, len } => ored[at..at + len].iter().any(|b| *b != 0),
            FieldLocation::Bits { at, shift, mask } => ored[at] >> shift & mask != 0,
        }
    }
}

/// ORs records into one record, so that what no record uses shows as zero.
pub fn or_records(ored: &mut [u8], records: &[u8]) {
    for record in records.chunks_exact(ored.len()) {
        // Eight bytes at a time; the tail overlaps, which OR does not mind.
        for (to, from) in ored.iter_mut().zip(record) {
            *to |= from;
        }
    }
}

/// Where each source's fields go: the schema all files share, and the source's
/// attributes by their place in it.
#[derive(Debug, Clone, PartialEq)]
pub struct UnifiedSchema {
    pub schema: Schema,
    /// Names that were left out because no record uses them.
    pub unused: Vec<String>,
    /// Names that were left out because others were asked for.
    pub left_out: Vec<String>,
    movers: Vec<RecordConverter>,
    /// By source, the attribute of each of its extra fields.
    extra: Vec<Vec<String>>,
}

impl UnifiedSchema {
    /// The schema that holds every attribute of every source. `ored` has each
    /// source's records ORed into one. `wanted` names the attributes to keep:
    /// all where it is empty, and where it is `auto` those that are not zero in
    /// every record. `second_color` names one that goes with `rgb` and is a copy
    /// of it at first.
    pub fn new(
        sources: &[(RecordFormat, Vec<u8>)],
        wanted: &[String],
        second_color: Option<&'static str>,
    ) -> UnifiedSchema {
        let mut merged: Vec<(Attribute, bool)> = Vec::new();
        let mut places: Vec<Vec<(usize, FieldLocation)>> = Vec::new();
        let mut extra = Vec::new();
        for (source, ored) in sources {
            let mut of_source = Vec::new();
            let standard = fields(source.format, second_color).len();
            for (attribute, place, always) in source.attributes(second_color) {
                let used = (always && !is_auto(wanted)) || RecordFormat::is_used(place, ored);
                let taken: Vec<usize> = of_source.iter().map(|(i, _)| *i).collect();
                let is_extra = taken.len() >= standard;
                let index = merge(&mut merged, attribute, used, is_extra, &taken);
                of_source.push((index, place));
            }
            extra.push(of_source[standard..].iter().map(|(i, _)| merged[*i].0.name.clone()).collect());
            places.push(of_source);
        }
        let wants = |name: &str| {
            wanted.is_empty() || is_auto(wanted) || wanted.iter().any(|w| w.eq_ignore_ascii_case(name))
        };
        let mut schema = Schema { attributes: vec![position()] };
        let (mut unused, mut left_out) = (Vec::new(), Vec::new());
        let mut at = schema.record_size();
        let mut offsets = vec![None; merged.len()];
        for index in viewing_order(&merged) {
            let (attribute, used) = &merged[index];
            let is_second = second_color == Some(attribute.name.as_str());
            if *used && wants(if is_second { RGB } else { &attribute.name }) {
                offsets[index] = Some(at);
                at += attribute.size();
                schema.attributes.push(attribute.clone());
            } else if !is_second {
                // A second colour is in no file, so none lost it.
                let without = if *used { &mut left_out } else { &mut unused };
                without.push(attribute.name.clone());
            }
        }
        let movers = places.iter().map(|p| RecordConverter::new(p, &offsets, at)).collect();
        UnifiedSchema { schema, unused, left_out, movers, extra }
    }

    /// The names that a source's extra fields have as attributes, in their order.
    pub fn extra_names(&self, source: usize) -> &[String] {
        &self.extra[source]
    }

    /// How to move the fields of a source's records.
    pub fn mover(&self, source: usize) -> &RecordConverter {
        &self.movers[source]
    }
}

/// Whether the choice is left to the records.
pub fn is_auto(wanted: &[String]) -> bool {
    matches!(wanted, [only] if only.eq_ignore_ascii_case("auto"))
}

fn position() -> Attribute {
    Attribute::new("position", Scalar::I32, 3)
}

/// Copies a whole record. LAS records are 20 to 67 bytes and a bit: two moves
/// of a fixed size that may overlap, where a call to memcpy costs more than the
/// copying.
#[inline(always)]
pub fn copy_record(from: &[u8], to: &mut [u8]) {
    let len = from.len();
    match len {
        16..=32 => {
            to[..16].copy_from_slice(&from[..16]);
            to[len - 16..len].copy_from_slice(&from[len - 16..]);
        }
        33..=64 => {
            to[..32].copy_from_slice(&from[..32]);
            to[len - 32..len].copy_from_slice(&from[len - 32..]);
        }
        _ => to[..len].copy_from_slice(from),
    }
}

/// The position of a raw record, as the file's integers.
#[inline]
pub fn raw_position(record: &[u8]) -> [i32; 3] {
    // One check of the length instead of twelve; no record is shorter.
    let Some((axes, _)) = record.first_chunk::<12>().map(|p| p.as_chunks::<4>()) else {
        return [0; 3];
    };
    [0, 1, 2].map(|a| i32::from_le_bytes(axes[a]))
}

/// Writes the position at the start of an octree record.
#[inline]
pub fn put_position(out: &mut [u8], stored: [i32; 3]) {
    for (to, axis) in out[..12].chunks_exact_mut(4).zip(stored) {
        to.copy_from_slice(&axis.to_le_bytes());
    }
}

#[cfg(test)]
mod tests {
    use super::super::attribute::{RGB_AVERAGE, RGB_ORIGINAL};
    use super::*;

    fn source(format: u8, record_length: usize) -> RecordFormat {
        RecordFormat { format, record_length, extra: Vec::new() }
    }

    fn names(u: &UnifiedSchema) -> Vec<&str> {
        u.schema.attributes.iter().map(|a| a.name.as_str()).collect()
    }

    #[test]
    fn format_2_is_as_viewers_know_it() {
        let u = UnifiedSchema::new(&[(source(2, 26), vec![0; 26])], &[], None);
        assert_eq!(
            names(&u),
            [
                "position",
                "intensity",
                "return number",
                "number of returns",
                "classification",
                "scan angle rank",
                "user data",
                "point source id",
                "rgb"
            ]
        );
        assert_eq!(u.schema.record_size(), 27);
    }

    #[test]
    fn bits_without_a_place_get_one_when_they_are_used() {
        let mut ored = vec![0; 20];
        ored[14] = 0b1000_0000;
        ored[15] = 0b0100_0000;
        let u = UnifiedSchema::new(&[(source(0, 20), ored.clone())], &[], None);
        assert!(names(&u).contains(&"edge of flight line"));
        assert!(names(&u).contains(&"classification flags"));
        assert!(!names(&u).contains(&"scan direction flag"));
        let mut out = vec![0; u.schema.record_size()];
        u.mover(0).apply(&ored, 20, &mut out);
        assert_eq!(out[u.schema.offset_of("edge of flight line").unwrap()], 1);
        assert_eq!(out[u.schema.offset_of("classification flags").unwrap()], 2);
        assert_eq!(out[u.schema.offset_of("classification").unwrap()], 0);
    }

    #[test]
    fn every_bit_of_every_format_has_a_place() {
        for (format, len) in [20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67].into_iter().enumerate() {
            let s = source(format as u8, len);
            let mut covered = vec![0u8; len];
            covered[..12].fill(0xff);
            for (_, place, _) in s.attributes(None) {
                match place {
                    FieldLocation::Bytes { at, len } => covered[at..at + len].iter_mut().for_each(|b| {
                        assert_eq!(*b, 0, "format {format}: overlap");
                        *b = 0xff;
                    }),
                    FieldLocation::Bits { at, shift, mask } => {
                        assert_eq!(covered[at] & (mask << shift), 0, "format {format}: overlap");
                        covered[at] |= mask << shift;
                    }
                }
            }
            assert!(covered.iter().all(|b| *b == 0xff), "format {format}: {covered:?}");
        }
    }

    #[test]
    fn extra_bytes_of_the_same_name_but_another_type_stay_apart() {
        let extra = |scalar: Scalar| ExtraField {
            name: "above ground".into(),
            description: String::new(),
            scalar,
            elements: 1,
            position: 20,
            scale: vec![],
            offset: vec![],
        };
        let a = RecordFormat { format: 0, record_length: 24, extra: vec![extra(Scalar::F32)] };
        let b = RecordFormat { format: 0, record_length: 28, extra: vec![extra(Scalar::F64)] };
        let u = UnifiedSchema::new(&[(a, vec![1; 24]), (b, vec![1; 28])], &[], None);
        assert!(names(&u).contains(&"above ground") && names(&u).contains(&"above ground (2)"));
    }

    #[test]
    fn records_of_any_length_are_copied_whole() {
        for len in 0..100u8 {
            let from: Vec<u8> = (1..=len).collect();
            let mut to = vec![0; usize::from(len)];
            copy_record(&from, &mut to);
            assert_eq!(from, to);
        }
    }

    #[test]
    fn extra_bytes_never_take_a_name_that_viewers_know() {
        let named = |name: &str, position: usize| ExtraField {
            name: name.into(),
            description: String::new(),
            scalar: Scalar::U16,
            elements: 3,
            position,
            scale: vec![],
            offset: vec![],
        };
        let names_of_ours = ["rgb", "rgba", "position", RGB_AVERAGE, RGB_ORIGINAL];
        let extra: Vec<_> = names_of_ours.iter().zip(0..).map(|(name, i)| named(name, 20 + 6 * i)).collect();
        let bare = RecordFormat { format: 0, record_length: 50, extra };
        let u = UnifiedSchema::new(&[(bare, vec![1; 50]), (source(2, 26), vec![1; 26])], &[], None);
        for name in ["rgb (2)", "rgba (2)", "position (2)", "rgb average (2)", "rgb original (2)", "rgb"] {
            assert_eq!(names(&u).iter().filter(|n| **n == name).count(), 1, "{name}");
        }
        assert!(!names(&u).contains(&"rgba"));
    }

    #[test]
    fn a_second_colour_goes_with_the_first_and_begins_as_it() {
        let raw: Vec<u8> = (0..34).collect();
        let with = |wanted: &[String]| {
            UnifiedSchema::new(&[(source(3, 34), raw.clone())], wanted, Some(RGB_AVERAGE))
        };
        let u = with(&[]);
        let at = names(&u).iter().position(|name| *name == RGB).unwrap();
        assert_eq!(names(&u)[at + 1], RGB_AVERAGE);
        let mut out = vec![0xaa; u.schema.record_size()];
        u.mover(0).apply(&raw, 34, &mut out);
        for name in [RGB, RGB_AVERAGE] {
            assert_eq!(out[u.schema.offset_of(name).unwrap()..][..6], raw[28..34], "{name}");
        }
        assert_eq!(names(&with(&["RGB".into()])), ["position", RGB, RGB_AVERAGE]);
        for wanted in [["intensity".into()].as_slice(), &[RGB_AVERAGE.into()]] {
            let u = with(wanted);
            assert!(!names(&u).contains(&RGB_AVERAGE), "{wanted:?}");
            assert!(!u.left_out.contains(&RGB_AVERAGE.into()), "{wanted:?}");
        }
        let black = UnifiedSchema::new(&[(source(2, 26), vec![0; 26])], &["auto".into()], Some(RGB_AVERAGE));
        assert_eq!(names(&black), ["position"]);
        assert!(!black.unused.contains(&RGB_AVERAGE.into()) && black.unused.contains(&RGB.into()));
        let bare = UnifiedSchema::new(&[(source(1, 28), vec![1; 28])], &[], Some(RGB_AVERAGE));
        assert!(!names(&bare).contains(&RGB_AVERAGE));
    }

    #[test]
    fn files_with_and_without_colours_share_both() {
        let sources = [(source(1, 28), vec![1; 28]), (source(7, 36), vec![1; 36])];
        let u = UnifiedSchema::new(&sources, &[], Some(RGB_ORIGINAL));
        let mut out = vec![0xaa; u.schema.record_size()];
        u.mover(0).apply(&[1; 28], 28, &mut out);
        assert_eq!(out[u.schema.offset_of(RGB).unwrap()..][..12], [0; 12]);
        u.mover(1).apply(&[1; 36], 36, &mut out);
        assert_eq!(out[u.schema.offset_of(RGB).unwrap()..][..12], [1; 12]);
    }

    #[test]
    fn wanted_attributes_only() {
        let u = UnifiedSchema::new(&[(source(3, 34), vec![1; 34])], &["RGB".into()], None);
        assert_eq!(names(&u), ["position", "rgb"]);
        let raw: Vec<u8> = (0..34).collect();
        let mut out = vec![0; 18];
        u.mover(0).apply(&raw, 34, &mut out);
        assert_eq!(&out[12..], &raw[28..]);
    }
}
