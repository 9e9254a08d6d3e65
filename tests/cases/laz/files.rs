//! Real files, decoded by both.

use std::fs::File;
use std::io::{BufReader, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use laz::{LasZipDecompressor, LazVlr};
use lodestone::format::las::LasFile;

fn laz_files(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            laz_files(&path, found);
        } else if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("laz")) {
            found.push(path);
        }
    }
}

/// All points as `laz` reads them, without any lenience.
fn by_laz(path: &Path, points: u64) -> Result<Vec<u8>, String> {
    let mut source = BufReader::with_capacity(1 << 20, File::open(path).map_err(|e| e.to_string())?);
    let header = las::raw::Header::read_from(&mut source).map_err(|e| e.to_string())?;
    source.seek(SeekFrom::Start(u64::from(header.header_size))).map_err(|e| e.to_string())?;
    for _ in 0..header.number_of_variable_length_records {
        let record = las::raw::Vlr::read_from(&mut source, false).map_err(|e| e.to_string())?;
        if record.user_id.starts_with(LazVlr::USER_ID.as_bytes()) && record.record_id == LazVlr::RECORD_ID {
            let vlr = LazVlr::from_buffer(&record.data).map_err(|e| e.to_string())?;
            let start = SeekFrom::Start(u64::from(header.offset_to_point_data));
            source.seek(start).map_err(|e| e.to_string())?;
            let mut records = vec![0; points as usize * vlr.items_size() as usize];
            let mut decoder = LasZipDecompressor::new(source, vlr).map_err(|e| e.to_string())?;
            decoder.decompress_many(&mut records).map_err(|e| e.to_string())?;
            return Ok(records);
        }
    }
    Err("no LASzip record".to_string())
}

#[test]
fn real_files_are_decoded_as_laz_does() {
    let Some(data) = std::env::var_os("LODESTONE_DATA").map(PathBuf::from) else {
        eprintln!("LODESTONE_DATA names no folder: no real file is decoded");
        return;
    };
    let mut files = Vec::new();
    laz_files(&data, &mut files);
    let (mut same, mut points) = (0, 0);
    for path in files {
        let Ok(file) = LasFile::open(&path) else { continue };
        let said = file.header().points;
        let mut records = Vec::new();
        let mut own = Vec::new();
        for slice in file.slices(1_000_000) {
            if file.read(slice, &mut records).is_err() {
                break;
            }
            own.extend_from_slice(&records);
        }
        // It panics where a chunk table is missing.
        let oracle = std::panic::catch_unwind(|| by_laz(&path, said));
        let oracle = oracle.unwrap_or_else(|_| Err("a panic".to_string()));
        let whole = own.len() as u64 == said * file.header().record_length as u64;
        match oracle {
            Ok(records) if whole => assert!(records == own, "{}", path.display()),
            Ok(_) => panic!("{}: laz reads it to the end", path.display()),
            Err(reason) => {
                eprintln!("{}: laz does not read it: {reason}", path.display());
                continue;
            }
        }
        (same, points) = (same + 1, points + said);
    }
    eprintln!("{same} files, {points} points: the same");
    assert!(same > 20);
}
