//! Where each attribute of an octree's record lies in a LAS record.
//!
//! Standard attributes go to the standard fields of the point format, all others into the
//! extra bytes, so that nothing is lost: those of the inputs first, in their order, then
//! wave packets and what else the point format has no field for. `docs/copc.md` has it as
//! a table.

use super::CopcError;
use super::descriptor::{self, Described, DescribedElement};
use super::moves::Moves;
use crate::format::las::record_length;
use crate::octree::attribute::{Attribute, ExtraField, RGB, RGB_AVERAGE, RGB_ORIGINAL, Scalar, Schema};
use crate::octree::attribute_names::original_name;
use crate::octree::standard_fields::{FieldLocation, standard_attributes};

/// The LAS field of scan angles as whole degrees (formats 0 to 5), and as 0.006 degrees.
pub const RANK: &str = "scan angle rank";
pub const ANGLE: &str = "scan angle";
/// Where the angle lies in a record of the formats 6 to 10.
pub const ANGLE_AT: usize = 18;

/// How records of an octree are LAS records of one point format, and back.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordLayout {
    schema: Schema,
    point_format: u8,
    record_length: usize,
    /// The descriptions of the extra bytes, in their order.
    fields: Vec<DescribedElement>,
    moves: Moves,
}

impl RecordLayout {
    /// As a file of COPC has them: point format 8 if there is infrared, 7 if there are
    /// colors, else 6. Fails if a record is too long.
    pub fn new(schema: &Schema, described: &Described) -> Result<RecordLayout, CopcError> {
        let has = |name: &str, scalar, elements| has(schema, name, scalar, elements);
        let format = match (has("nir", Scalar::U16, 1), has(RGB, Scalar::U16, 3)) {
            (true, _) => 8,
            (_, true) => 7,
            _ => 6,
        };
        RecordLayout::of_format(schema, described, format)
    }

    /// As a LAS file has them: the least point format with a field for every standard
    /// attribute. The formats 0 to 5 only where `fit_legacy` says that all values fit their
    /// narrower fields.
    pub fn of_las(
        schema: &Schema,
        described: &Described,
        fit_legacy: bool,
    ) -> Result<RecordLayout, CopcError> {
        let has = |name: &str, scalar, elements| has(schema, name, scalar, elements);
        let (time, color) = (has("gps-time", Scalar::F64, 1), has(RGB, Scalar::U16, 3));
        let infrared = has("nir", Scalar::U16, 1);
        let waves = has("wave packet descriptor index", Scalar::U8, 1);
        let is_legacy = fit_legacy
            && has(RANK, Scalar::U8, 1)
            && !has(ANGLE, Scalar::I16, 1)
            && !has("scanner channel", Scalar::U8, 1)
            && !infrared;
        let format = match (is_legacy, waves) {
            (true, true) => 4 + u8::from(color),
            (true, false) => u8::from(time) + 2 * u8::from(color),
            (false, true) => 9 + u8::from(color || infrared),
            (false, false) if infrared => 8,
            (false, false) => 6 + u8::from(color),
        };
        RecordLayout::of_format(schema, described, format)
    }

    /// As records of this point format, 0 to 10.
    pub fn of_format(schema: &Schema, described: &Described, format: u8) -> Result<RecordLayout, CopcError> {
        let refuse = |what: String| Err(CopcError::Unholdable(what));
        let Some(standard_length) = record_length(format) else {
            return refuse(format!("there is no point format {format}"));
        };
        let standard = standard_attributes(format);
        let place_of = |a: &Attribute| {
            let found = standard
                .iter()
                .find(|(s, _)| (&s.name, s.scalar, s.elements) == (&a.name, a.scalar, a.elements));
            found.map(|(_, place)| *place)
        };
        let mut moves = Moves::new(schema.record_size());
        let (mut rank, mut angle) = (None, None);
        // What goes into the extra bytes: where from, which attribute.
        let mut extra = Vec::new();
        let mut at = 0;
        for (index, attribute) in schema.attributes.iter().enumerate() {
            let from = at;
            at += attribute.size();
            if index == 0 {
                moves.copy(0, 0, attribute.size());
                continue;
            }
            if is(attribute, ANGLE, Scalar::I16, 1) && format >= 6 {
                angle = Some(from);
            }
            match place_of(attribute) {
                Some(FieldLocation::Bytes { at, len }) => moves.copy(from, at, len),
                Some(FieldLocation::Bits { at, shift, mask }) => moves.bits(from, at, shift, mask),
                None if format >= 6 && is(attribute, RANK, Scalar::U8, 1) => rank = Some((index, from)),
                None => extra.push((index, from)),
            }
        }
        extra.sort_by_key(|(index, _)| is_ours(&schema.attributes[*index]));
        if let Some((index, from)) = rank {
            moves.rank(from, ANGLE_AT, angle);
            // Both, of inputs of both kinds: the angle alone would not tell which it was.
            if angle.is_some() {
                extra.push((index, from));
            }
        }
        let (mut fields, mut taken) = (Vec::new(), Vec::new());
        let mut to = standard_length;
        for (index, from) in extra {
            let attribute = &schema.attributes[index];
            moves.copy(from, to, attribute.size());
            to += attribute.size();
            fields.extend(descriptor::fields(attribute, index, described, &mut taken));
        }
        if to > usize::from(u16::MAX) {
            return refuse(format!("records of {to} bytes; LAS has room for {}", u16::MAX));
        }
        moves.finish(to);
        Ok(RecordLayout { schema: schema.clone(), point_format: format, record_length: to, fields, moves })
    }

    pub fn schema(&self) -> &Schema {
        &self.schema
    }

    pub fn point_format(&self) -> u8 {
        self.point_format
    }

    /// Bytes of a LAS record, extra bytes included.
    pub fn record_length(&self) -> usize {
        self.record_length
    }

    /// Bytes of it behind the point format's own.
    pub fn extra_bytes(&self) -> usize {
        self.record_length - record_length(self.point_format).unwrap_or(0)
    }

    /// The descriptions of the extra bytes.
    pub fn fields(&self) -> &[DescribedElement] {
        &self.fields
    }

    /// The same as the data of an extra-bytes record.
    pub fn description(&self) -> Vec<u8> {
        self.fields.iter().flat_map(|field| field.bytes.iter().copied()).collect()
    }

    /// The extra bytes as fields of a LAS file to be written, each attribute one, under the
    /// names that they had in the inputs.
    pub fn extra_fields(&self) -> Vec<ExtraField> {
        let mut indices: Vec<usize> = self.fields.iter().map(|field| field.attribute).collect();
        indices.dedup();
        let mut position = self.record_length - self.extra_bytes();
        let field = |index: usize| {
            let attribute = &self.schema.attributes[index];
            let unless = |values: &[f64], none: f64| match values.iter().all(|value| *value == none) {
                true => Vec::new(),
                false => values.to_vec(),
            };
            let at = position;
            position += attribute.size();
            ExtraField {
                name: original_name(&attribute.name).to_string(),
                description: attribute.description.clone(),
                scalar: attribute.scalar,
                elements: attribute.elements,
                position: at,
                scale: unless(&attribute.scale, 1.0),
                offset: unless(&attribute.offset, 0.0),
            }
        };
        indices.into_iter().map(field).collect()
    }

    /// LAS records from as many of the octree; what was in `records` is replaced.
    pub fn promote(&self, octree: &[u8], records: &mut Vec<u8>) {
        self.moves.promote(octree, records);
    }

    /// The octree's records from LAS records: the inverse of [`RecordLayout::promote`].
    pub fn demote(&self, records: &[u8], octree: &mut Vec<u8>) {
        self.moves.demote(records, octree);
    }

    /// The first value that does not fit its field of this point format, in words: only
    /// octrees of other programs have such.
    pub fn misfit(&self, octree: &[u8]) -> Option<String> {
        let (from, value, most) = self.moves.misfit(octree)?;
        let mut at = 0;
        let attribute = self.schema.attributes.iter().find(|attribute| {
            at += attribute.size();
            from < at
        });
        let name = attribute.map_or("an attribute", |attribute| attribute.name.as_str());
        Some(format!("'{name}' is {value}, and point format {} holds at most {most}", self.point_format))
    }
}

fn is(attribute: &Attribute, name: &str, scalar: Scalar, elements: usize) -> bool {
    (attribute.name.as_str(), attribute.scalar, attribute.elements) == (name, scalar, elements)
}

fn has(schema: &Schema, name: &str, scalar: Scalar, elements: usize) -> bool {
    schema.attributes.iter().any(|attribute| is(attribute, name, scalar, elements))
}

/// Whether an attribute is none of the inputs' extra bytes: these come first.
fn is_ours(attribute: &Attribute) -> bool {
    let is_averaged = [RGB_AVERAGE, RGB_ORIGINAL].contains(&attribute.name.as_str());
    is_averaged
        || (0..=10).any(|format| {
            standard_attributes(format).iter().any(|(standard, _)| standard.name == attribute.name)
        })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::octree::record::{RecordFormat, UnifiedSchema};
    use proptest::prelude::*;

    fn source(format: u8, extra: Vec<ExtraField>) -> RecordFormat {
        let length = record_length(format).unwrap()
            + extra.iter().map(|e| e.scalar.size() * e.elements).sum::<usize>();
        RecordFormat { format, record_length: length, extra }
    }

    fn extra(format: u8) -> Vec<ExtraField> {
        let mut position = record_length(format).unwrap();
        [("b", Scalar::U8, 5), ("intensity", Scalar::F64, 1), ("n", Scalar::I16, 3), ("nir", Scalar::U16, 1)]
            .into_iter()
            .map(|(name, scalar, elements)| {
                let field = ExtraField {
                    name: name.into(),
                    description: "what it is".into(),
                    scalar,
                    elements,
                    position,
                    scale: vec![],
                    offset: vec![],
                };
                position += scalar.size() * elements;
                field
            })
            .collect()
    }

    fn octree_records(unified: &UnifiedSchema, source: usize, raw: &[u8], length: usize) -> Vec<u8> {
        let mut out = vec![0; raw.len() / length * unified.schema.record_size()];
        unified.mover(source).apply(raw, length, &mut out);
        for (record, raw) in out.chunks_exact_mut(unified.schema.record_size()).zip(raw.chunks_exact(length))
        {
            record[..12].copy_from_slice(&raw[..12]);
        }
        out
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 60, ..ProptestConfig::default() })]
        /// Every bit of every format comes back, alone and mixed with another, through COPC
        /// and through every LAS format that may hold it.
        #[test]
        fn every_bit_comes_back(
            formats in proptest::collection::vec(0u8..11, 1..4),
            has_extra in any::<bool>(),
            bytes in proptest::collection::vec(any::<u8>(), 3000),
        ) {
            let sources: Vec<_> = formats.iter().map(|f| {
                let source = source(*f, if has_extra { extra(*f) } else { Vec::new() });
                let ored = vec![0xff; source.record_length];
                (source, ored)
            }).collect();
            let unified = UnifiedSchema::new(&sources, &[], Some(RGB_AVERAGE));
            let none = Described::default();
            let mut layouts = vec![
                RecordLayout::new(&unified.schema, &none).unwrap(),
                RecordLayout::of_las(&unified.schema, &none, formats.iter().all(|f| *f < 6)).unwrap(),
            ];
            layouts.push(RecordLayout::of_format(&unified.schema, &none, 9).unwrap());
            for (index, (source, _)) in sources.iter().enumerate() {
                let length = source.record_length;
                let raw = &bytes[..bytes.len() / length * length];
                let records = octree_records(&unified, index, raw, length);
                for layout in &layouts {
                    let (mut las, mut back) = (vec![1], vec![2]);
                    prop_assert_eq!(layout.misfit(&records), None);
                    layout.promote(&records, &mut las);
                    prop_assert_eq!(las.len(), raw.len() / length * layout.record_length());
                    layout.demote(&las, &mut back);
                    prop_assert!(back == records, "formats {:?} as {}", formats, layout.point_format());
                }
            }
        }

        /// A LAS file of one point format comes back as what it was, to the last bit.
        #[test]
        fn las_comes_back_as_las(format in 0u8..11, bytes in proptest::collection::vec(any::<u8>(), 2000)) {
            let source = source(format, extra(format));
            let length = source.record_length;
            let raw = &bytes[..bytes.len() / length * length];
            let unified = UnifiedSchema::new(&[(source, vec![0xff; length])], &[], None);
            let layout = RecordLayout::of_las(&unified.schema, &Described::default(), true).unwrap();
            prop_assert_eq!(layout.point_format(), format);
            let mut las = Vec::new();
            layout.promote(&octree_records(&unified, 0, raw, length), &mut las);
            // Format 10's infrared extra field of the same name stands where it stood, too.
            prop_assert!(las == raw, "format {}", format);
        }
    }

    fn copc_of(formats: &[u8]) -> RecordLayout {
        let sources: Vec<_> =
            formats.iter().map(|f| (source(*f, vec![]), vec![0xff; record_length(*f).unwrap()])).collect();
        RecordLayout::new(&UnifiedSchema::new(&sources, &[], None).schema, &Described::default()).unwrap()
    }

    #[test]
    fn point_formats_follow_what_is_there() {
        let formats = [6, 6, 7, 7, 6, 7, 6, 7, 8, 6, 8];
        for (from, to) in formats.into_iter().enumerate() {
            assert_eq!(copc_of(&[from as u8]).point_format(), to, "format {from}");
        }
        assert_eq!(copc_of(&[1]).record_length(), 30);
        assert_eq!(copc_of(&[4]).record_length(), 59);
        assert_eq!(copc_of(&[1, 6]).record_length(), 31, "which angle it was is kept");
        assert_eq!(copc_of(&[3, 8]).point_format(), 8);
    }

    #[test]
    fn classes_and_ranks_keep_their_values() {
        let sources = [(source(1, vec![]), vec![0xff; 28])];
        let unified = UnifiedSchema::new(&sources, &[], None);
        let layout = RecordLayout::new(&unified.schema, &Described::default()).unwrap();
        for rank in i8::MIN..=i8::MAX {
            let mut raw = [0; 28];
            (raw[14], raw[15], raw[16]) = (0b1101_0001, 0b0110_1100, rank as u8);
            let mut las = Vec::new();
            layout.promote(&octree_records(&unified, 0, &raw, 28), &mut las);
            assert_eq!(las[14..17], [0x21, 0b1100_0011, 12]);
            let angle = i16::from_le_bytes([las[18], las[19]]);
            assert_eq!(f64::from(angle), (f64::from(rank) / 0.006).round());
        }
    }

    #[test]
    fn what_no_field_can_hold_is_told() {
        let schema = Schema {
            attributes: ["position", "classification"]
                .map(|name| {
                    Attribute::new(
                        name,
                        if name == "position" { Scalar::I32 } else { Scalar::U8 },
                        if name == "position" { 3 } else { 1 },
                    )
                })
                .to_vec(),
        };
        let layout = RecordLayout::of_format(&schema, &Described::default(), 0).unwrap();
        let mut record = [0; 13];
        record[12] = 31;
        assert_eq!(layout.misfit(&record), None);
        record[12] = 64;
        assert_eq!(
            layout.misfit(&record).unwrap(),
            "'classification' is 64, and point format 0 holds at most 31"
        );
        let mut wide = schema.clone();
        wide.attributes.push(Attribute::new("much", Scalar::U8, 65_530));
        assert!(matches!(RecordLayout::new(&wide, &Described::default()), Err(CopcError::Unholdable(_))));
    }
}
