//! What no converter can do without: reading the input, decoding it once,
//! writing the output. The benchmark calls itself with these, so that they are
//! measured as the converter is.

use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom, Write};
use std::path::Path;

use laz::{LasZipDecompressor, LazVlr, ParLasZipDecompressor};

type Outcome<T> = Result<T, Box<dyn std::error::Error + Send + Sync>>;

const BLOCK: usize = 4 << 20;

/// Runs the floor of this name over its operands.
pub fn run(name: &str, operands: &[String]) -> Outcome<()> {
    match (name, operands) {
        ("copy", [from, to]) => copy(Path::new(from), Path::new(to)),
        ("decode", [file, threads]) => decode(Path::new(file), threads.parse()?),
        ("write", [file, bytes]) => write(Path::new(file), bytes.parse()?),
        ("unpack", [from, to]) => unpack(Path::new(from), Path::new(to)),
        _ => Err(format!("no floor {name} over {operands:?}").into()),
    }
}

/// By reads and writes: `std::fs::copy` would leave it to the kernel, which may
/// share the blocks and copy nothing.
fn copy(from: &Path, to: &Path) -> Outcome<()> {
    let (mut from, mut to) = (File::open(from)?, File::create(to)?);
    let mut block = vec![0; BLOCK];
    loop {
        let count = from.read(&mut block)?;
        if count == 0 {
            return Ok(());
        }
        to.write_all(&block[..count])?;
    }
}

/// Writes as many bytes, and makes them last as a published octree must.
fn write(file: &Path, bytes: u64) -> Outcome<()> {
    let mut file = File::create(file)?;
    let block = vec![0x5a; BLOCK];
    let mut left = bytes;
    while left > 0 {
        let part = left.min(BLOCK as u64) as usize;
        file.write_all(&block[..part])?;
        left -= part as u64;
    }
    Ok(file.sync_data()?)
}

/// Decodes all points and throws them away.
fn decode(file: &Path, threads: usize) -> Outcome<()> {
    let (source, vlr, points) = open(file)?;
    let size = vlr.items_size() as usize;
    let batch = vlr.chunk_size() as usize * size * 2 * threads;
    let mut left = points as usize * size;
    let mut block = vec![0; batch.min(left)];
    if threads == 1 {
        let mut decoder = LasZipDecompressor::new(source, vlr)?;
        while left > 0 {
            let part = left.min(batch);
            decoder.decompress_many(&mut block[..part])?;
            left -= part;
        }
        return Ok(());
    }
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
    pool.install(|| {
        let mut decoder = ParLasZipDecompressor::new(source, vlr)?;
        while left > 0 {
            let part = left.min(batch);
            decoder.decompress_many(&mut block[..part])?;
            left -= part;
        }
        Ok(())
    })
}

/// A well-formed LAZ file with fixed chunks, placed at its first point.
fn open(file: &Path) -> Outcome<(BufReader<File>, LazVlr, u64)> {
    let mut source = BufReader::with_capacity(1 << 20, File::open(file)?);
    let header = las::raw::Header::read_from(&mut source)?;
    source.seek(SeekFrom::Start(u64::from(header.header_size)))?;
    for _ in 0..header.number_of_variable_length_records {
        let record = las::raw::Vlr::read_from(&mut source, false)?;
        let user = record.user_id.split(|&byte| byte == 0).next().unwrap_or_default();
        if user == LazVlr::USER_ID.as_bytes() && record.record_id == LazVlr::RECORD_ID {
            let vlr = LazVlr::from_buffer(&record.data)?;
            source.seek(SeekFrom::Start(u64::from(header.offset_to_point_data)))?;
            let large = header.large_file.map(|large| large.number_of_point_records);
            let points = large.unwrap_or(u64::from(header.number_of_point_records));
            return Ok((source, vlr, points));
        }
    }
    Err(format!("{} is not a LAZ file", file.display()).into())
}

/// A LAZ file as LAS; no floor, but what makes its twin.
fn unpack(from: &Path, to: &Path) -> Outcome<()> {
    use lodestone::format::las::{LasFile, LasOptions, LasWriter};
    let file = LasFile::open(from)?;
    let header = file.header();
    let mut writer = LasWriter::create(
        to,
        &LasOptions {
            version: header.version,
            point_format: header.point_format,
            scale: header.scale,
            offset: header.offset,
            compressed: false,
            extra: header.extra.clone(),
            crs: Vec::new(),
            software: "lodestone bench".to_string(),
        },
    )?;
    let mut records = Vec::new();
    for slice in file.slices(1_000_000) {
        records.clear();
        file.read(slice, &mut records)?;
        writer.write(&records)?;
    }
    Ok(writer.finish()?)
}
