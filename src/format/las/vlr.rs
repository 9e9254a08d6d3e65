//! Variable length records, plain and extended (LAS 1.4 R15, tables 5 and 24),
//! found by walking the file's bytes and never by a header's counts, which lie:
//! a test file claims 1 069 128 089 of them in 14 kB.

use super::error::LasError;
use super::source::FileReader;
use super::text;

/// Bytes in front of a record's data, and of an extended one's.
pub(super) const FRONT: u64 = 54;
const EXTENDED_FRONT: u64 = 60;
/// Data of records that is kept of a file, in all; the longest that can mean anything
/// are GeoTIFF's numbers of 64-bit floats, 512 KiB of them, and WKT. More is passed over.
const MOST_DATA_IN_ALL: u64 = 4 << 20;
/// Extended records that are passed over and told of one by one.
const MOST_TOLD: usize = 5;
/// Records that are looked at; real files have a handful, and hostile ones
/// could have one every 54 bytes.
const MOST_RECORDS: usize = 10_000;

/// One record that means something here.
#[derive(Debug, Clone, PartialEq)]
pub struct Vlr {
    pub user: String,
    pub id: u16,
    pub data: Vec<u8>,
}

impl Vlr {
    pub fn is(&self, user: &str, id: u16) -> bool {
        self.id == id && self.user.eq_ignore_ascii_case(user)
    }

    /// A CRS as WKT (LAS 1.4 R15, table 13).
    pub fn wkt(text: &str) -> Vlr {
        let data = text.bytes().chain([0]).collect();
        Vlr { user: "LASF_Projection".into(), id: WKT, data }
    }

    /// Whether it marks a file in LASzip's compatibility mode.
    pub fn is_mark_of_compatibility(&self) -> bool {
        is_mark_of_compatibility(&self.user, self.id)
    }

    /// Whether it says where on Earth the coordinates are, or a part of that.
    pub fn is_of_crs(&self) -> bool {
        is_of_crs(&self.user, self.id)
    }
}

/// The number of records that hold a CRS as WKT.
pub const WKT: u16 = 2112;

/// Whether a record marks a file in LASzip's compatibility mode; it holds what a header
/// of LAS 1.4, or 1.5, has more than that of the file.
pub fn is_mark_of_compatibility(user: &str, id: u16) -> bool {
    id == 22204 && user.eq_ignore_ascii_case("lascompatible")
}

fn is_of_crs(user: &str, id: u16) -> bool {
    let is = |name: &str| user.eq_ignore_ascii_case(name);
    match id {
        2111 | WKT => is("LASF_Projection") || is("liblas"),
        34735..=34737 => is("LASF_Projection"),
        _ => false,
    }
}

/// The records that lie between the header and the points.
pub fn read(
    source: &FileReader,
    start: u64,
    end: u64,
    said: u32,
    notes: &mut Vec<String>,
) -> Result<Vec<Vlr>, LasError> {
    let end = end.min(source.bytes());
    let mut records = Vec::new();
    let mut position = start;
    let mut found = 0;
    let mut room = MOST_DATA_IN_ALL;
    while position + FRONT <= end && found < MOST_RECORDS {
        let mut front = [0; FRONT as usize];
        source.read_exact_at(&mut front, position)?;
        let length = u64::from(u16::from_le_bytes([front[20], front[21]]));
        let (user, id) = (text::get(&front[2..18]), u16::from_le_bytes([front[18], front[19]]));
        let fits = position + FRONT + length <= end;
        // Behind the last one that the header counts, only what is certainly a
        // record is taken for one.
        if found >= said as usize && !(fits && is_known(&user, id)) {
            break;
        }
        if !fits {
            notes.push(format!("the variable length record \"{user}\" {id} is longer than the room for it"));
            if !is_known(&user, id) {
                break;
            }
        }
        if is_known(&user, id) && length <= room {
            let length = length.min(end - position - FRONT);
            room -= length;
            let mut data = vec![0; length as usize];
            source.read_exact_at(&mut data, position + FRONT)?;
            records.push(Vlr { user, id, data });
        }
        found += 1;
        position += FRONT + length;
    }
    if found != said as usize {
        notes.push(format!("the header says {said} variable length records, there are {found}"));
    }
    Ok(records)
}

/// The extended records, from `start` to the end of the file. What is not needed is
/// passed over, and so is what is needed once and comes again.
pub fn read_extended(
    source: &FileReader,
    start: u64,
    said: u32,
    notes: &mut Vec<String>,
) -> Result<Vec<Vlr>, LasError> {
    let end = source.bytes();
    let mut records: Vec<Vlr> = Vec::new();
    let mut position = start;
    let mut found = 0;
    let mut room = MOST_DATA_IN_ALL;
    while found < MOST_RECORDS && end.saturating_sub(position) >= EXTENDED_FRONT {
        let Extended { user, id, length } = extended_at(source, position)?;
        let next = (position + EXTENDED_FRONT).checked_add(length).filter(|next| *next <= end);
        // Behind the last one that the header counts, only what is certainly a
        // record is taken for one.
        if found >= said as usize && !(next.is_some() && is_known(&user, id)) {
            break;
        }
        let Some(next) = next else {
            notes.push(format!("the extended record \"{user}\" {id} reaches past the end of the file"));
            break;
        };
        // Of extra bytes there may be several; they are small.
        let is_new = id == 4 || !records.iter().any(|record| record.is(&user, id));
        if is_known(&user, id) && is_new && length <= room {
            let mut data = vec![0; length as usize];
            source.read_exact_at(&mut data, position + EXTENDED_FRONT)?;
            records.push(Vlr { user, id, data });
            room -= length;
        } else if is_known(&user, id) {
            let why = if is_new { "is too long to mean anything" } else { "comes again" };
            if found < MOST_TOLD {
                notes.push(format!(
                    "the extended record \"{user}\" {id} of {length} bytes {why}; it is passed over"
                ));
            }
        }
        found += 1;
        position = next;
    }
    if found != said as usize {
        notes.push(format!("the header says {said} extended records, there are {found}"));
    }
    Ok(records)
}

/// The front of an extended record.
struct Extended {
    user: String,
    id: u16,
    length: u64,
}

fn extended_at(source: &FileReader, position: u64) -> Result<Extended, LasError> {
    let mut front = [0; EXTENDED_FRONT as usize];
    source.read_exact_at(&mut front, position)?;
    let mut length = [0; 8];
    length.copy_from_slice(&front[20..28]);
    let length = u64::from_le_bytes(length);
    Ok(Extended { user: text::get(&front[2..18]), id: u16::from_le_bytes([front[18], front[19]]), length })
}

/// Whether an extended record begins there, beyond doubt: with the name of a user, in
/// letters, and data that the file has.
pub fn is_extended_record(source: &FileReader, position: u64) -> Result<bool, LasError> {
    if source.bytes().saturating_sub(position) < EXTENDED_FRONT {
        return Ok(false);
    }
    let mut user = [0; 16];
    source.read_exact_at(&mut user, position + 2)?;
    let letters = user.iter().take_while(|byte| (b' '..=b'~').contains(byte)).count();
    let length = extended_at(source, position)?.length;
    let fits = length <= source.bytes() - position - EXTENDED_FRONT;
    Ok(fits && letters > 2 && user[letters..].iter().all(|byte| *byte == 0))
}

fn is_known(user: &str, id: u16) -> bool {
    let is = |name: &str| user.eq_ignore_ascii_case(name);
    match id {
        4 => is("LASF_Spec"),
        22204 => is("laszip encoded") || is_mark_of_compatibility(user, id),
        1 => is("copc"),
        _ => is_of_crs(user, id),
    }
}

/// Appends a record.
pub fn put(to: &mut Vec<u8>, user: &str, id: u16, description: &str, data: &[u8]) -> Result<(), String> {
    let length = u16::try_from(data.len())
        .map_err(|_| format!("the record \"{user}\" {id} of {} bytes is too long", data.len()))?;
    put_front(to, user, id, &length.to_le_bytes(), description);
    to.extend_from_slice(data);
    Ok(())
}

/// Appends an extended record.
pub fn put_extended(to: &mut Vec<u8>, user: &str, id: u16, description: &str, data: &[u8]) {
    put_front(to, user, id, &(data.len() as u64).to_le_bytes(), description);
    to.extend_from_slice(data);
}

fn put_front(to: &mut Vec<u8>, user: &str, id: u16, length: &[u8], description: &str) {
    let mut user_field = [0; 16];
    text::put(&mut user_field, user);
    let mut description_field = [0; 32];
    text::put(&mut description_field, description);
    to.extend_from_slice(&[0, 0]);
    to.extend_from_slice(&user_field);
    to.extend_from_slice(&id.to_le_bytes());
    to.extend_from_slice(length);
    to.extend_from_slice(&description_field);
}

/// How many records `bytes`, written by [`put`], holds.
pub fn count(bytes: &[u8]) -> u32 {
    let mut count = 0;
    let mut position = 0;
    while position + FRONT as usize <= bytes.len() {
        let length = u16::from_le_bytes([bytes[position + 20], bytes[position + 21]]);
        position += FRONT as usize + usize::from(length);
        count += 1;
    }
    count
}
