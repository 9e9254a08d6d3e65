//! Where a file's points lie, by the word of its header alone: for a copy that is
//! still on its way. Nothing is believed for it but to tell how far it is, and
//! which of its bytes must not be zeros.

use std::fs::File;
use std::os::unix::fs::FileExt;

/// No file is longer; what says so is no header yet.
const LONGEST: u64 = 1 << 50;

/// Where the points are to be.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Layout {
    pub compressed: bool,
    /// Bytes of a record, or of one before it was packed.
    pub record_length: u64,
    /// Bytes before the points.
    pub points_at: u64,
    /// Where they end: the chunk table of LAZ. Nothing where the header does not
    /// tell (yet): both are written last.
    pub points_end: Option<u64>,
}

impl Layout {
    /// Reads the first bytes of a file; nothing where they are no LAS header.
    pub fn read(file: &File) -> Option<Layout> {
        let mut head = [0u8; 255];
        let read = read_up_to(file, &mut head, 0);
        if read < 227 || &head[..4] != b"LASF" {
            return None;
        }
        let two = |at: usize| u16::from_le_bytes([head[at], head[at + 1]]);
        let four = |at: usize| u32::from_le_bytes([head[at], head[at + 1], head[at + 2], head[at + 3]]);
        let (points_at, record_length) = (u64::from(four(96)), u64::from(two(105)));
        let compressed = head[104] & 0x80 != 0;
        let end = if compressed {
            let mut table = [0u8; 8];
            let there = read_up_to(file, &mut table, points_at) == 8;
            // Until it is written it is -1, or what lies there is not there yet.
            there.then(|| u64::try_from(i64::from_le_bytes(table)).ok()).flatten()
        } else {
            let mut count = u64::from(four(107));
            if (head[24], head[25]) >= (1, 4) && read == head.len() {
                count = count.max(u64::from(four(247)) | u64::from(four(251)) << 32);
            }
            count.checked_mul(record_length).and_then(|bytes| bytes.checked_add(points_at))
        };
        let points_end = end.filter(|end| *end > points_at && *end < LONGEST);
        Some(Layout { compressed, record_length, points_at, points_end })
    }

    /// The least bytes that the whole file has: all its points and, for LAZ, the
    /// head of its chunk table.
    pub fn promised_bytes(&self) -> Option<u64> {
        self.points_end.map(|end| end + if self.compressed { 8 } else { 0 })
    }
}

fn read_up_to(file: &File, into: &mut [u8], at: u64) -> usize {
    let mut read = 0;
    while read < into.len() {
        match file.read_at(&mut into[read..], at.saturating_add(read as u64)) {
            Ok(0) | Err(_) => break,
            Ok(more) => read += more,
        }
    }
    read
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    fn promised(bytes: &[u8]) -> Option<u64> {
        let mut file = tempfile::tempfile().expect("a file");
        file.write_all(bytes).expect("written");
        Layout::read(&file)?.promised_bytes()
    }

    #[test]
    fn a_cut_file_tells_how_long_it_is_to_be() {
        let mut las = vec![0u8; 375];
        las[..4].copy_from_slice(b"LASF");
        (las[24], las[25]) = (1, 2);
        las[96..100].copy_from_slice(&375u32.to_le_bytes());
        las[105..107].copy_from_slice(&20u16.to_le_bytes());
        assert_eq!(promised(&las), None, "the count comes last");
        las[107..111].copy_from_slice(&10u32.to_le_bytes());
        assert_eq!(promised(&las), Some(575));
        las[25] = 4;
        las[247..255].copy_from_slice(&100u64.to_le_bytes());
        assert_eq!(promised(&las), Some(2_375));
        las[247..255].copy_from_slice(&u64::MAX.to_le_bytes());
        assert_eq!(promised(&las), None, "no such file");
        las[104] = 0x83;
        assert_eq!(promised(&las), None);
        las.extend_from_slice(&9_000i64.to_le_bytes());
        assert_eq!(promised(&las), Some(9_008));
        las[375..383].copy_from_slice(&(-1i64).to_le_bytes());
        assert_eq!(promised(&las), None);
        assert_eq!(promised(&las[..100]), None);
        assert_eq!(promised(b"anything else, as long as a header is or longer"), None);
    }
}
