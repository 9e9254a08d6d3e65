//! Which decoder each field of a LAZ record gets: those of `laz`, but for GPS
//! times. There `laz` 0.13 follows a switch between sequences of times by calling
//! itself, and damaged bytes switch without end: the stack overflows, which no
//! guard catches and which takes the whole process down. Both decoders that do so
//! are written anew here, with a bound; the field of points of the formats 6 to 10
//! has its time among its layers, so all of it is.

mod point14;
mod time;

use std::io::{self, Read, Seek};

use laz::las::{v1, v2, v3, v4};
use laz::record::{LayeredPointRecordDecompressor, SequentialPointRecordDecompressor};
use laz::{LazItem, LazItemType};

use point14::Point14;
use time::GpsTime;

/// A decoder of the point formats 0 to 5.
pub fn sequential<R: Read + Send>(
    items: &[LazItem],
    input: R,
) -> io::Result<SequentialPointRecordDecompressor<'static, R>> {
    let mut decoder = SequentialPointRecordDecompressor::new(input);
    for item in items {
        match (item.item_type(), item.version()) {
            (LazItemType::Point10, 1) => {
                decoder.add_field_decompressor(v1::LasPoint0Decompressor::default());
            }
            (LazItemType::Point10, 2) => {
                decoder.add_field_decompressor(v2::LasPoint0Decompressor::default());
            }
            (LazItemType::GpsTime, 1) => {
                decoder.add_field_decompressor(v1::LasGpsTimeDecompressor::default());
            }
            (LazItemType::GpsTime, 2) => decoder.add_field_decompressor(GpsTime::default()),
            (LazItemType::RGB12, 1) => {
                decoder.add_field_decompressor(v1::LasRGBDecompressor::default());
            }
            (LazItemType::RGB12, 2) => {
                decoder.add_field_decompressor(v2::LasRGBDecompressor::default());
            }
            (LazItemType::Byte(_), 1) => {
                decoder.add_field_decompressor(v1::LasExtraByteDecompressor::new(usize::from(item.size())))
            }
            (LazItemType::Byte(_), 2) => {
                decoder.add_field_decompressor(v2::LasExtraByteDecompressor::new(usize::from(item.size())))
            }
            (LazItemType::WavePacket13, 1 | 2) => {
                decoder.add_field_decompressor(v1::LasWavepacketDecompressor::default());
            }
            _ => return Err(unknown(item)),
        }
    }
    Ok(decoder)
}

/// A decoder of the point formats 6 to 10.
pub fn layered<R: Read + Seek + Send>(
    items: &[LazItem],
    input: R,
) -> io::Result<LayeredPointRecordDecompressor<'static, R>> {
    let mut decoder = LayeredPointRecordDecompressor::new(input);
    for item in items {
        match (item.item_type(), item.version()) {
            (LazItemType::Point14, 3) => decoder.add_field_decompressor(Point14::of_version_3()),
            (LazItemType::Point14, 4) => decoder.add_field_decompressor(Point14::of_version_4()),
            (LazItemType::RGB14, 3) => {
                decoder.add_field_decompressor(v3::LasRGBDecompressor::default());
            }
            (LazItemType::RGB14, 4) => {
                decoder.add_field_decompressor(v4::LasRGBDecompressor::default());
            }
            (LazItemType::RGBNIR14, 3) => {
                decoder.add_field_decompressor(v3::LasRGBDecompressor::default());
                decoder.add_field_decompressor(v3::LasNIRDecompressor::default());
            }
            (LazItemType::RGBNIR14, 4) => {
                decoder.add_field_decompressor(v4::LasRGBDecompressor::default());
                decoder.add_field_decompressor(v4::LasNIRDecompressor::default());
            }
            (LazItemType::Byte14(count), 3) => {
                decoder.add_field_decompressor(v3::LasExtraByteDecompressor::new(usize::from(count)));
            }
            (LazItemType::Byte14(count), 4) => {
                decoder.add_field_decompressor(v4::LasExtraByteDecompressor::new(usize::from(count)));
            }
            (LazItemType::WavePacket14, 3) => {
                decoder.add_field_decompressor(v3::LasWavepacketDecompressor::default());
            }
            (LazItemType::WavePacket14, 4) => {
                decoder.add_field_decompressor(v4::LasWavepacketDecompressor::default());
            }
            _ => return Err(unknown(item)),
        }
    }
    Ok(decoder)
}

fn unknown(item: &LazItem) -> io::Error {
    let (kind, version) = (item.item_type(), item.version());
    io::Error::other(format!("there is no decoder of {kind:?} in version {version}"))
}

#[cfg(test)]
mod tests;
