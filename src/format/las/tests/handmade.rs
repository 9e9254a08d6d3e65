//! LAZ files that no writer of ours makes, built chunk by chunk.

use laz::laszip::{ChunkTable, ChunkTableEntry};
use laz::{LazVlr, LazVlrBuilder};

use super::super::ReadMode;
use super::super::coding::Coding;
use super::*;
use crate::platform::disk::others::Links;

/// A LAZ file built by hand, chunk by chunk.
pub struct Handmade {
    pub bytes: Vec<u8>,
    /// Where its points and its chunk table begin.
    pub points_at: usize,
    pub table_at: usize,
    pub records: Vec<u8>,
}

impl Handmade {
    /// `fixed` is the chunk size that the LASzip record tells, if any; `chunks`
    /// are those that the file has.
    pub fn new(point_format: u8, fixed: Option<u32>, chunks: &[usize]) -> Handmade {
        let folder = tempfile::tempdir().unwrap();
        let records = records(point_format, 0, chunks.iter().sum(), 5);
        let path = written(folder.path(), &options(point_format, true), &records);
        let mut bytes = std::fs::read(path).unwrap();
        let points_at = u32::from_le_bytes(bytes[96..100].try_into().unwrap()) as usize;
        bytes.truncate(points_at);
        let builder = LazVlrBuilder::default().with_point_format(point_format, 0).unwrap();
        let vlr = match fixed {
            Some(points) => builder.with_fixed_chunk_size(points),
            None => builder.with_variable_chunk_size(),
        }
        .build();
        put_laszip(&mut bytes, &vlr);
        let coding = Coding::new(vlr.items(), point_format).unwrap();
        let mut table = ChunkTable::with_capacity(chunks.len());
        bytes.extend_from_slice(&[0; 8]);
        let mut rest = records.as_slice();
        for points in chunks {
            let (now, later) = rest.split_at(points * coding.record_length);
            let chunk = coding.encode(now).unwrap();
            table.push(ChunkTableEntry { point_count: *points as u64, byte_count: chunk.len() as u64 });
            bytes.extend_from_slice(&chunk);
            rest = later;
        }
        let table_at = bytes.len();
        table.write_to(&mut bytes, &vlr).unwrap();
        bytes[points_at..points_at + 8].copy_from_slice(&(table_at as u64).to_le_bytes());
        Handmade { bytes, points_at, table_at, records }
    }

    /// COPC of it: its info in front of all records, its hierarchy behind the chunk table.
    pub fn with_copc(mut self) -> Handmade {
        let mut info = vec![0; 54 + 160];
        info[2..6].copy_from_slice(b"copc");
        (info[18], info[20]) = (1, 160);
        let shift = info.len();
        let records_at = usize::from(u16::from_le_bytes([self.bytes[94], self.bytes[95]]));
        self.bytes.splice(records_at..records_at, info);
        self.points_at += shift;
        self.table_at += shift;
        self.bytes[96..100].copy_from_slice(&(self.points_at as u32).to_le_bytes());
        self.bytes[100] += 1;
        self.set_table_at(self.table_at as i64);
        let hierarchy_at = self.bytes.len() as u64;
        let mut hierarchy = vec![0; 60 + 32];
        hierarchy[2..6].copy_from_slice(b"copc");
        hierarchy[18..20].copy_from_slice(&1000u16.to_le_bytes());
        hierarchy[20] = 32;
        self.bytes.extend_from_slice(&hierarchy);
        self.bytes[235..243].copy_from_slice(&hierarchy_at.to_le_bytes());
        self.bytes[243] = 1;
        self
    }

    pub fn open(&self) -> Result<LasFile, LasError> {
        self.open_as(ReadMode::Whole)
    }

    pub fn open_as(&self, reading: ReadMode) -> Result<LasFile, LasError> {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), &self.bytes).unwrap();
        LasFile::open_as(file.path(), reading, Links::Followed)
    }

    /// Has the chunk table list the first of the chunks alone.
    pub fn list_only(&mut self, fixed: Option<u32>, chunks: usize) {
        let at = u32::from_le_bytes(self.bytes[96..100].try_into().unwrap()) as usize;
        let vlr = LazVlr::from_buffer(&self.bytes[at - laszip_length(&self.bytes[..at])..at]).unwrap();
        let table = &self.bytes[self.table_at..];
        let all = ChunkTable::read(&mut std::io::Cursor::new(table), fixed.is_none()).unwrap();
        let mut few = ChunkTable::with_capacity(chunks);
        all.into_iter().take(chunks).for_each(|entry| few.push(*entry));
        self.bytes.truncate(self.table_at);
        few.write_to(&mut self.bytes, &vlr).unwrap();
    }

    pub fn set_table_at(&mut self, at: i64) {
        self.bytes[self.points_at..self.points_at + 8].copy_from_slice(&at.to_le_bytes());
    }
}

/// Replaces the LASzip record's data, in its place at the end of the records.
pub fn put_laszip(bytes: &mut [u8], vlr: &LazVlr) {
    let mut data = Vec::new();
    vlr.write_to(&mut data).unwrap();
    let start = bytes.len() - data.len();
    bytes[start..].copy_from_slice(&data);
}

/// Of the LASzip record's data at the end of the records.
pub fn laszip_length(records: &[u8]) -> usize {
    let front = records.windows(14).rposition(|part| part == b"laszip encoded").unwrap() - 2;
    records.len() - front - 54
}
