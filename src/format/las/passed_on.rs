//! Variable length records that mean nothing here and may be worth something to
//! others: what a file made of this one is to pass on.

use super::LasError;
use super::header;
use super::reader::LasFile;
use super::{text, vlr};

/// Bytes of them in all that are passed on: readers of files behind a network ask for
/// the first 64 KiB at once.
const MOST_BYTES: u64 = 32 << 10;
/// Records that are looked at.
const MOST_RECORDS: u32 = 1_000;

/// A record as it stands in a file.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct PassedOn {
    pub user: String,
    pub id: u16,
    pub description: String,
    pub data: Vec<u8>,
}

impl LasFile {
    /// The records between header and points but for those that say how the points are
    /// stored, what their extra bytes are, or where on Earth they lie: whoever writes a
    /// file has words of its own for that. Those that are too long are left out.
    ///
    /// # Errors
    /// Where the file cannot be read any more.
    pub fn records_to_pass_on(&self) -> Result<Vec<PassedOn>, LasError> {
        let source = &*self.source;
        let front = header::read(source, &mut Vec::new())?;
        let end = front.points_at().min(source.bytes());
        let (mut at, mut room) = (front.size, MOST_BYTES);
        let mut records = Vec::new();
        let said = front.raw.number_of_variable_length_records;
        for _ in 0..said.min(MOST_RECORDS) {
            if at + vlr::FRONT > end {
                break;
            }
            let mut bytes = [0; vlr::FRONT as usize];
            source.read_exact_at(&mut bytes, at)?;
            let length = u64::from(u16::from_le_bytes([bytes[20], bytes[21]]));
            let data_at = at + vlr::FRONT;
            at = data_at + length;
            if at > end {
                break;
            }
            let (user, id) = (text::get(&bytes[2..18]), u16::from_le_bytes([bytes[18], bytes[19]]));
            if is_ours(&user, id) || length > room {
                continue;
            }
            room -= length;
            let mut data = vec![0; length as usize];
            source.read_exact_at(&mut data, data_at)?;
            records.push(PassedOn { user, id, description: text::get(&bytes[22..54]), data });
        }
        Ok(records)
    }
}

/// Whether a record is about how this very file is written.
fn is_ours(user: &str, id: u16) -> bool {
    let is = |name: &str| user.eq_ignore_ascii_case(name);
    // Of the standard's own, those of waveforms and classes stay.
    let of_standard = is("LASF_Spec") && matches!(id, 4 | 7);
    let of_system = is("LASF_Projection") || is("liblas");
    let of_compression = is("laszip encoded") || vlr::is_mark_of_compatibility(user, id);
    of_standard || of_system || of_compression || is("copc") || is("lodestone") || is("lascompatible")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::las::{LasOptions, LasWriter, Vlr};

    /// Puts records into a file of LAS: ours has room for one that is not.
    fn with_records(records: &[(&str, u16, usize)]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.las");
        let options = LasOptions {
            version: (1, 2),
            point_format: 0,
            scale: [0.01; 3],
            offset: [0.0; 3],
            compressed: false,
            extra: Vec::new(),
            crs: vec![Vlr::wkt("PROJCS[\"x\"]")],
            software: String::new(),
        };
        let mut writer = LasWriter::create(&path, &options).unwrap();
        writer.write(&[0; 20]).unwrap();
        writer.finish().unwrap();
        let bytes = std::fs::read(&path).unwrap();
        let header = u16::from_le_bytes([bytes[94], bytes[95]]) as usize;
        let mut more = Vec::new();
        for (user, id, length) in records {
            vlr::put(&mut more, user, *id, "a description", &vec![7; *length]).unwrap();
        }
        let mut out = [&bytes[..header], &more, &bytes[header..]].concat();
        let points_at = u32::from_le_bytes(out[96..100].try_into().unwrap()) + more.len() as u32;
        let said = u32::from_le_bytes(out[100..104].try_into().unwrap()) + records.len() as u32;
        out[96..100].copy_from_slice(&points_at.to_le_bytes());
        out[100..104].copy_from_slice(&said.to_le_bytes());
        std::fs::write(&path, out).unwrap();
        folder
    }

    #[test]
    fn records_of_others_are_passed_on_and_ours_are_not() {
        let folder = with_records(&[
            ("LASF_Spec", 100, 26),
            ("LASF_Spec", 4, 0),
            ("NIIRS10", 1, 26),
            ("copc", 1, 160),
            ("big", 2, 40_000),
            ("LASF_Spec", 0, 16),
        ]);
        let file = LasFile::open(&folder.path().join("a.las")).unwrap();
        let records = file.records_to_pass_on().unwrap();
        let names: Vec<(&str, u16, usize)> =
            records.iter().map(|r| (r.user.as_str(), r.id, r.data.len())).collect();
        assert_eq!(names, [("LASF_Spec", 100, 26), ("NIIRS10", 1, 26), ("LASF_Spec", 0, 16)]);
        assert!(records.iter().all(|record| record.description == "a description"));
    }
}
