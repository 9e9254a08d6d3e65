//! Decoding and encoding of LAZ chunks, by the `laz` crate and by our own codec, on one
//! thread: chunks as they come, by turns, in processor time.

use std::fs;
use std::io::Cursor;
use std::path::Path;
use std::process::Command;

use laz::record::{
    LayeredPointRecordCompressor, LayeredPointRecordDecompressor, RecordCompressor, RecordDecompressor,
    SequentialPointRecordCompressor, SequentialPointRecordDecompressor,
};
use laz::{LazItem, LazVlrBuilder};
use lodestone::format::las::LasFile;
use lodestone::format::laz::{Decoder, Encoder, RecordShape};
use lodestone::lab::process::{self as measure, Spread, spread};

use super::{BINARY, Outcome};

/// The point formats that are coded without `laz`, and the version of their items.
const FORMATS: [(u8, u16); 7] = [(0, 2), (1, 2), (2, 2), (3, 2), (6, 3), (7, 3), (8, 3)];
const POINTS: &str = "1M";
const CHUNK_POINTS: usize = 50_000;

/// Chunks of one point format.
struct Chunks {
    items: Vec<LazItem>,
    layered: bool,
    length: usize,
    shape: RecordShape,
    /// Records, and what `laz` makes of them.
    chunks: Vec<(Vec<u8>, Vec<u8>)>,
}

impl Chunks {
    fn make(point_format: u8, version: u16, folder: &Path) -> Outcome<Chunks> {
        let path = folder.join("codec.las");
        let (format, output) = (point_format.to_string(), path.display().to_string());
        let synth = ["synth", "terrain", "--format", &format, "--points", POINTS, "-o", &output];
        measure::run(Command::new(BINARY).args(synth))?;
        let file = LasFile::open(&path)?;
        let length = file.header().record_length;
        let vlr = LazVlrBuilder::default().with_point_format(point_format, 0)?.build();
        let shape = RecordShape::new(point_format, 0, version).ok_or("there is no codec of our own")?;
        let (items, layered) = (vlr.items().clone(), point_format >= 6);
        let mut made = Chunks { items, layered, length, shape, chunks: Vec::new() };
        let mut records = Vec::new();
        for slice in file.slices(CHUNK_POINTS as u32) {
            file.read(slice, &mut records)?;
            let chunk = made.encode_by_laz(&records)?;
            made.chunks.push((std::mem::take(&mut records), chunk));
        }
        fs::remove_file(&path)?;
        Ok(made)
    }

    fn points(&self) -> usize {
        self.chunks.iter().map(|(records, _)| records.len() / self.length).sum()
    }

    fn encode_by_laz(&self, records: &[u8]) -> Outcome<Vec<u8>> {
        if self.layered {
            let mut encoder = LayeredPointRecordCompressor::new(Vec::new());
            encoder.set_fields_from(&self.items)?;
            encoder.compress_many(records)?;
            encoder.done()?;
            return Ok(encoder.into_inner());
        }
        let mut encoder = SequentialPointRecordCompressor::new(Vec::new());
        encoder.set_fields_from(&self.items)?;
        encoder.compress_many(records)?;
        encoder.done()?;
        Ok(encoder.into_inner())
    }

    fn decode_by_laz(&self, chunk: &[u8], records: &mut [u8]) -> Outcome<()> {
        if self.layered {
            let mut decoder = LayeredPointRecordDecompressor::new(Cursor::new(chunk));
            decoder.set_fields_from(&self.items)?;
            return Ok(decoder.decompress_many(records)?);
        }
        let mut decoder = SequentialPointRecordDecompressor::new(Cursor::new(chunk));
        decoder.set_fields_from(&self.items)?;
        Ok(decoder.decompress_many(records)?)
    }
}

/// Processor time of this thread, in seconds.
fn cpu() -> Outcome<f64> {
    let times = fs::read_to_string("/proc/thread-self/schedstat")?;
    let on_cpu = times.split_whitespace().next().ok_or("/proc/thread-self/schedstat is empty")?;
    Ok(on_cpu.parse::<f64>()? / 1e9)
}

fn timed(work: impl FnOnce() -> Outcome<()>) -> Outcome<f64> {
    let start = cpu()?;
    work()?;
    Ok(cpu()? - start)
}

/// CPU-seconds a million points by `laz` and by us, and the ratio of each pair.
fn row(pairs: &[(f64, f64)], millions: f64) -> String {
    let [laz, own, ratio] = [
        spread(pairs.iter().map(|(laz, _)| laz / millions)),
        spread(pairs.iter().map(|(_, own)| own / millions)),
        spread(pairs.iter().map(|(laz, own)| own / laz)),
    ];
    let Spread { median, min, max } = ratio;
    format!("{:.3} | {:.3} | {median:.2} ({min:.2}–{max:.2})", laz.median, own.median)
}

/// Measures every format, and prints the table.
pub fn bench(rounds: usize, folder: &Path) -> Outcome<()> {
    println!(
        "\nLAZ chunks of {CHUNK_POINTS} points, terrain, {POINTS} points, one thread; median of {rounds}\n"
    );
    println!(
        "| CPU-s/M points | laz decodes | we decode | ours / laz | laz encodes | we encode | ours / laz |"
    );
    println!("|---|---:|---:|---:|---:|---:|---:|");
    for (point_format, version) in FORMATS {
        let made = Chunks::make(point_format, version, folder)?;
        let millions = made.points() as f64 / 1e6;
        let mut decoder = Decoder::new(made.shape);
        let mut encoder = Encoder::new(made.shape);
        let mut out = vec![0; CHUNK_POINTS * made.length];
        let (mut decoding, mut encoding) = (Vec::new(), Vec::new());
        for round in 0..rounds {
            eprint!("\r\x1b[Kformat {point_format}: round {} of {rounds}", round + 1);
            let laz = timed(|| {
                made.chunks.iter().try_for_each(|(r, chunk)| made.decode_by_laz(chunk, &mut out[..r.len()]))
            })?;
            let own = timed(|| {
                let mut chunks = made.chunks.iter();
                Ok(chunks.try_for_each(|(r, chunk)| decoder.decode(chunk, &mut out[..r.len()]))?)
            })?;
            decoding.push((laz, own));
            let Some(encoder) = &mut encoder else { continue };
            let laz = timed(|| made.chunks.iter().try_for_each(|(r, _)| made.encode_by_laz(r).map(drop)))?;
            let own = timed(|| {
                for (records, _) in &made.chunks {
                    encoder.encode(records, &mut Vec::new());
                }
                Ok(())
            })?;
            encoding.push((laz, own));
        }
        eprint!("\r\x1b[K");
        let encoded = if encoding.is_empty() { "| | ".to_string() } else { row(&encoding, millions) };
        println!("| format {point_format} | {} | {encoded} |", row(&decoding, millions));
    }
    Ok(())
}
