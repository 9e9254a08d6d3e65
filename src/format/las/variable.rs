//! What a LAZ file whose chunks have any number of points needs beside them, as COPC is
//! one: the LASzip record and the chunk table.

use std::io::Cursor;

use laz::LazVlrBuilder;
use laz::laszip::{ChunkTable, ChunkTableEntry};

use super::coding::guard;

/// The data of the LASzip record (user "laszip encoded", number 22204).
///
/// # Errors
/// For point formats that LAZ does not have.
pub fn laszip_record(point_format: u8, extra_bytes: u16) -> Result<Vec<u8>, String> {
    let vlr = vlr(point_format, extra_bytes)?;
    guard(|| {
        let mut data = Vec::new();
        vlr.write_to(&mut data).map_err(std::io::Error::other)?;
        Ok(data)
    })
}

fn vlr(point_format: u8, extra_bytes: u16) -> Result<laz::LazVlr, String> {
    let builder = LazVlrBuilder::default().with_point_format(point_format, extra_bytes);
    Ok(builder.map_err(|error| error.to_string())?.with_variable_chunk_size().build())
}

/// The chunk table of chunks of so many points and bytes each.
///
/// # Errors
/// Where there are more than the table can count.
pub fn chunk_table(chunks: impl ExactSizeIterator<Item = (u64, u64)>) -> Result<Vec<u8>, String> {
    let vlr = vlr(6, 0)?;
    let mut table = ChunkTable::with_capacity(chunks.len());
    chunks.for_each(|(point_count, byte_count)| table.push(ChunkTableEntry { point_count, byte_count }));
    guard(|| {
        let mut bytes = Vec::new();
        table.write_to(&mut bytes, &vlr).map_err(std::io::Error::other)?;
        Ok(bytes)
    })
}

/// Points and bytes of each chunk from the bytes that begin with a table, which may have at
/// most so many.
///
/// # Errors
/// Where there is no table that can be.
pub fn read_chunk_table(bytes: &[u8], max_chunks: u64) -> Result<Vec<(u64, u64)>, String> {
    let word =
        |at: usize| bytes.get(at..at + 4).and_then(|word| word.try_into().ok()).map(u32::from_le_bytes);
    let (Some(version), Some(count)) = (word(0), word(4)) else {
        return Err("it has no chunk table".to_string());
    };
    if version != 0 || u64::from(count) > max_chunks {
        return Err(format!("its chunk table of version {version} with {count} chunks is nonsense"));
    }
    let table = guard(|| ChunkTable::read(&mut Cursor::new(bytes), true).map_err(std::io::Error::other));
    let table = table.map_err(|reason| format!("its chunk table cannot be read: {reason}"))?;
    Ok(table.into_iter().map(|entry| (entry.point_count, entry.byte_count)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_come_back() {
        let chunks = [(1, 70), (100_000, 1 << 20), (3, 100)];
        let bytes = chunk_table(chunks.into_iter()).unwrap();
        assert_eq!(read_chunk_table(&bytes, 3).unwrap(), chunks);
        assert!(read_chunk_table(&bytes, 2).is_err());
        assert!(read_chunk_table(&bytes[..6], 2).is_err());
        let empty = chunk_table([].into_iter()).unwrap();
        assert_eq!(read_chunk_table(&empty, 0).unwrap(), []);
    }

    #[test]
    fn the_record_says_variable_and_layered() {
        let data = laszip_record(7, 3).unwrap();
        assert_eq!(data[..2], 3u16.to_le_bytes(), "layered and chunked");
        assert_eq!(data[2..4], [0, 0], "the arithmetic coder");
        assert_eq!(data[12..16], u32::MAX.to_le_bytes());
        assert_eq!(data[32..34], 3u16.to_le_bytes(), "items");
    }
}
