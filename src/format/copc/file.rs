//! All that stands around the chunks of a COPC file: the header and the records in front of
//! them, the chunk table and the extended records behind.
//!
//! The front has the same length whatever it will say, so chunks can be written before it is
//! known how many there are.

use std::borrow::Cow;

use serde::{Deserialize, Serialize};

use super::descriptor::DescribedElement;
use super::hierarchy::{self, CopcEntry, name};
use super::{CopcError, RecordLayout, statistics};
use crate::format::las::{Created, chunk_table, laszip_record};
use crate::octree::attribute::Attribute;
use crate::octree::cube::Cube;
use crate::octree::lattice::Lattice;
use crate::octree::moments::Moments;
use crate::octree::statistics::Statistics;

/// Bytes of the header of LAS 1.4.
pub const HEADER: usize = 375;
/// Bytes of COPC's own record.
pub const INFO: usize = 160;
/// Bytes in front of a record's data, and of an extended one's.
pub const RECORD_FRONT: usize = 54;
pub const EXTENDED_FRONT: usize = 60;
/// Cells on an axis of a node: spacing = 2 × halfsize / 128, exactly.
pub const CELLS: f64 = 128.0;
/// The global encoding's bit that says that the CRS is WKT.
const WKT_BIT: u16 = 1 << 4;
/// The bits that an input has a say in: standard GPS time, waveforms within and beside the
/// file, synthetic return numbers.
const INPUT_BITS: u16 = 0b1111;
/// What a record has room for.
const MAX_RECORD: usize = u16::MAX as usize;
/// The record with the octree's attributes as JSON, from which a reader of ours makes the
/// octree's records again.
pub const SCHEMA_USER: &str = "lodestone";
pub const SCHEMA_ID: u16 = 1;

/// What the record says: the attributes of the octree, and the names of the fields of extra
/// bytes. If those are not the file's, another program has passed the record on.
#[derive(Debug, Serialize, Deserialize)]
pub struct RecordedAttributes<'a> {
    pub attributes: Cow<'a, [Attribute]>,
    pub fields: Vec<String>,
}

/// The cube that all nodes divide.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CopcCube {
    pub center: [f64; 3],
    pub halfsize: f64,
}

impl CopcCube {
    /// The octree's cube, moved down by half a lattice unit: faces of nodes then lie between
    /// the places that points can have, so no reader's rounding puts a point outside of its
    /// node's box.
    pub fn of(lattice: &Lattice, cube: &Cube) -> CopcCube {
        let halfsize = cube.side() / 2.0;
        let center = std::array::from_fn(|axis| {
            let corner = f64::from(cube.corner[axis]) * lattice.scale[axis] + lattice.offset[axis];
            corner - cube.margin() + halfsize
        });
        CopcCube { center, halfsize }
    }

    pub fn spacing(&self) -> f64 {
        2.0 * self.halfsize / CELLS
    }
}

/// A record that means nothing here and is passed on.
#[derive(Debug, Clone, PartialEq)]
pub struct Record {
    pub user: String,
    pub id: u16,
    pub description: String,
    pub data: Vec<u8>,
}

/// What is known of a file before its first point is written.
#[derive(Debug, Clone)]
pub struct Head {
    pub layout: RecordLayout,
    /// World = integer × scale + offset.
    pub scale: [f64; 3],
    pub offset: [f64; 3],
    pub cube: CopcCube,
    /// WKT 1, if the CRS is known.
    pub wkt: Option<String>,
    /// The bits 0 to 3 that hold for all inputs; others do not matter.
    pub global_encoding: u16,
    /// Of the inputs, never of the clock.
    pub created: Option<Created>,
    pub software: String,
    pub system: String,
    /// Records that all inputs have.
    pub shared: Vec<Record>,
}

/// What is known at the end. Bounds and times are of points that are there.
#[derive(Debug, Clone)]
pub struct FileTotals {
    pub points: u64,
    /// From return 1 on.
    pub by_return: [u64; 15],
    /// World coordinates; anything if there are no points.
    pub min: [f64; 3],
    pub max: [f64; 3],
    /// Smallest and largest GPS time, if there is any.
    pub time: Option<(f64, f64)>,
    pub tail: Places,
}

/// Where [`tail`] put things.
#[derive(Debug, Clone)]
pub struct Places {
    table_at: u64,
    root_at: u64,
    root_size: u64,
    extended_at: u64,
    extended: u32,
    fields: Vec<DescribedElement>,
}

/// The bytes behind the last chunk.
#[derive(Debug, Clone)]
pub struct Tail {
    pub bytes: Vec<u8>,
    pub places: Places,
}

impl Head {
    /// Bytes in front of the first chunk: where it begins.
    ///
    /// # Errors
    /// Where the records do not fit.
    pub fn bytes_before_points(&self) -> Result<u64, CopcError> {
        let records = self.records(&[0; INFO], self.layout.fields())?;
        Ok((HEADER + records.bytes.len() + 8) as u64)
    }

    /// World coordinate of an integer, as every reader computes it.
    pub fn world(&self, axis: usize, stored: i32) -> f64 {
        f64::from(stored) * self.scale[axis] + self.offset[axis]
    }

    /// The header, the records, and the place of the chunk table.
    ///
    /// # Errors
    /// Where the records do not fit.
    pub fn bytes(&self, totals: &FileTotals) -> Result<Vec<u8>, CopcError> {
        let places = &totals.tail;
        let records = self.records(&self.info(totals), &places.fields)?;
        let mut bytes = Vec::with_capacity(HEADER + records.bytes.len() + 8);
        self.put_header(&mut bytes, totals, &records);
        bytes.extend_from_slice(&records.bytes);
        bytes.extend_from_slice(&(places.table_at as i64).to_le_bytes());
        Ok(bytes)
    }

    fn info(&self, totals: &FileTotals) -> [u8; INFO] {
        let (places, CopcCube { center: [x, y, z], halfsize }) = (&totals.tail, self.cube);
        let (first, last) = totals.time.unwrap_or((0.0, 0.0));
        let floats = [x, y, z, halfsize, self.cube.spacing()].map(f64::to_le_bytes).concat();
        let page = [places.root_at, places.root_size].map(u64::to_le_bytes).concat();
        let times = [first, last].map(f64::to_le_bytes).concat();
        let mut info = [0; INFO];
        let all = [floats, page, times].concat();
        info[..all.len()].copy_from_slice(&all);
        info
    }

    fn records(&self, info: &[u8], fields: &[DescribedElement]) -> Result<RecordBuffer, CopcError> {
        let mut records = RecordBuffer::default();
        records.put("copc", 1, "COPC info", info)?;
        let extra = self.layout.extra_bytes() as u16;
        let laszip = laszip_record(self.layout.point_format(), extra).map_err(CopcError::Unholdable)?;
        records.put("laszip encoded", 22204, "LASzip", &laszip)?;
        for (user, id, description, data) in self.own_records(fields) {
            if data.len() <= MAX_RECORD {
                records.put(user, id, description, &data)?;
            }
        }
        for Record { user, id, description, data } in &self.shared {
            records.put(user, *id, description, data)?;
        }
        Ok(records)
    }

    /// The records that are extended ones if they are too long.
    fn own_records(&self, fields: &[DescribedElement]) -> Vec<(&'static str, u16, &'static str, Vec<u8>)> {
        let mut records = Vec::new();
        if !fields.is_empty() {
            let data = fields.iter().flat_map(|field| field.bytes.iter().copied()).collect();
            records.push(("LASF_Spec", 4, "Extra bytes", data));
        }
        if let Some(wkt) = &self.wkt {
            records.push(("LASF_Projection", 2112, "CRS", wkt.bytes().chain([0]).collect()));
        }
        let told = RecordedAttributes {
            attributes: Cow::Borrowed(&self.layout.schema().attributes),
            fields: fields.iter().map(DescribedElement::name).collect(),
        };
        // JSON of plain values cannot fail.
        let schema = serde_json::to_vec(&told).unwrap_or_default();
        records.push((SCHEMA_USER, SCHEMA_ID, "Attributes of the octree", schema));
        records
    }

    fn put_header(&self, bytes: &mut Vec<u8>, totals: &FileTotals, records: &RecordBuffer) {
        let (places, layout) = (&totals.tail, &self.layout);
        let points_at = (HEADER + records.bytes.len()) as u32;
        let created = self.created.unwrap_or(Created { year: 0, day: 0 });
        bytes.extend_from_slice(b"LASF");
        bytes.extend_from_slice(&0u16.to_le_bytes());
        bytes.extend_from_slice(&(self.global_encoding & INPUT_BITS | WKT_BIT).to_le_bytes());
        bytes.extend_from_slice(&[0; 16]);
        bytes.extend_from_slice(&[1, 4]);
        for text in [&self.system, &self.software] {
            bytes.extend_from_slice(&text_field::<32>(text));
        }
        bytes.extend_from_slice(&created.day.to_le_bytes());
        bytes.extend_from_slice(&created.year.to_le_bytes());
        bytes.extend_from_slice(&(HEADER as u16).to_le_bytes());
        bytes.extend_from_slice(&points_at.to_le_bytes());
        bytes.extend_from_slice(&records.count.to_le_bytes());
        bytes.push(layout.point_format() | 0x80);
        bytes.extend_from_slice(&(layout.record_length() as u16).to_le_bytes());
        // Counts of 32 bits are of the formats 0 to 5.
        bytes.extend_from_slice(&[0; 24]);
        self.scale
            .iter()
            .chain(&self.offset)
            .for_each(|number| bytes.extend_from_slice(&number.to_le_bytes()));
        for axis in 0..3 {
            let (min, max) =
                if totals.points > 0 { (totals.min[axis], totals.max[axis]) } else { (0.0, 0.0) };
            bytes.extend_from_slice(&max.to_le_bytes());
            bytes.extend_from_slice(&min.to_le_bytes());
        }
        bytes.extend_from_slice(&0u64.to_le_bytes());
        bytes.extend_from_slice(&places.extended_at.to_le_bytes());
        bytes.extend_from_slice(&places.extended.to_le_bytes());
        bytes.extend_from_slice(&totals.points.to_le_bytes());
        totals.by_return.iter().for_each(|points| bytes.extend_from_slice(&points.to_le_bytes()));
    }
}

/// The chunk table and the extended records, which go where the last chunk ends. `entries`
/// are in the order in which their chunks lie in the file, one behind the other from
/// [`Head::bytes_before_points`] on; those without points may stand anywhere.
///
/// # Errors
/// Where the chunks are not so, or more than a table has room for.
pub fn tail(
    head: &Head,
    points_end: u64,
    entries: &[CopcEntry],
    statistics: &Statistics,
    moments: &Moments,
) -> Result<Tail, CopcError> {
    let chunks: Vec<&CopcEntry> = entries.iter().filter(|entry| entry.points > 0).collect();
    let mut at = head.bytes_before_points()?;
    for entry in &chunks {
        if entry.offset != at {
            let (key, offset) = (name(entry.key), entry.offset);
            return Err(CopcError::Records(format!("the chunk of node {key} lies at {offset}, not at {at}")));
        }
        at += u64::from(entry.size);
    }
    if at != points_end {
        return Err(CopcError::Records(format!("the last chunk ends at {at}, not at {points_end}")));
    }
    let sizes = chunks.iter().map(|entry| (u64::from(entry.points), u64::from(entry.size)));
    let mut bytes = chunk_table(sizes).map_err(CopcError::Records)?;
    let extended_at = points_end + bytes.len() as u64;
    let root_at = extended_at + EXTENDED_FRONT as u64;
    let pages = hierarchy::pages(entries, root_at);
    put_extended(&mut bytes, "copc", 1000, "EPT Hierarchy", &pages.bytes);
    let schema = head.layout.schema();
    let told = statistics::json(schema, head.scale, head.offset, statistics, moments);
    put_extended(&mut bytes, "qgis", 0, "Contains calculated statistics", told.as_bytes());
    let mut extended = 2;
    let fields = ranged(head, statistics);
    for (user, id, description, data) in head.own_records(&fields) {
        if data.len() > MAX_RECORD {
            put_extended(&mut bytes, user, id, description, &data);
            extended += 1;
        }
    }
    let root_size = pages.root_size;
    let places = Places { table_at: points_end, root_at, root_size, extended_at, extended, fields };
    Ok(Tail { bytes, places })
}

/// The descriptions of extra bytes with the smallest and largest values that are there.
fn ranged(head: &Head, statistics: &Statistics) -> Vec<DescribedElement> {
    let mut fields = head.layout.fields().to_vec();
    for field in &mut fields {
        let scalar = head.layout.schema().attributes[field.attribute].scalar;
        let Some(known) = statistics.attributes.get(field.attribute) else { continue };
        if let (Some(min), Some(max)) = (known.min.get(field.element), known.max.get(field.element)) {
            field.set_range(scalar, *min, *max);
        }
    }
    fields
}

/// Records one behind the other.
#[derive(Default)]
struct RecordBuffer {
    bytes: Vec<u8>,
    count: u32,
}

impl RecordBuffer {
    fn put(&mut self, user: &str, id: u16, description: &str, data: &[u8]) -> Result<(), CopcError> {
        let length = u16::try_from(data.len()).map_err(|_| {
            CopcError::Unholdable(format!("the record \"{user}\" {id} of {} bytes is too long", data.len()))
        })?;
        put_front(&mut self.bytes, user, id, &length.to_le_bytes(), description);
        self.bytes.extend_from_slice(data);
        self.count += 1;
        Ok(())
    }
}

fn put_extended(bytes: &mut Vec<u8>, user: &str, id: u16, description: &str, data: &[u8]) {
    put_front(bytes, user, id, &(data.len() as u64).to_le_bytes(), description);
    bytes.extend_from_slice(data);
}

fn put_front(bytes: &mut Vec<u8>, user: &str, id: u16, length: &[u8], description: &str) {
    bytes.extend_from_slice(&[0, 0]);
    bytes.extend_from_slice(&text_field::<16>(user));
    bytes.extend_from_slice(&id.to_le_bytes());
    bytes.extend_from_slice(length);
    bytes.extend_from_slice(&text_field::<32>(description));
}

/// As much of a text as fits, the rest zero.
fn text_field<const N: usize>(text: &str) -> [u8; N] {
    let mut field = [0; N];
    let mut end = text.len().min(N);
    while !text.is_char_boundary(end) {
        end -= 1;
    }
    field[..end].copy_from_slice(&text.as_bytes()[..end]);
    field
}
