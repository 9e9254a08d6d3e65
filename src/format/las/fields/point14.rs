//! The standard fields of the point formats 6 to 10 beside items that the `laz` crate
//! decodes: [`Point14Decoder`] in that crate's terms.

use std::io::{self, Read, Seek};

use laz::las::selective::DecompressionSelection;
use laz::record::LayeredFieldDecompressor;

use crate::format::laz::{LazError, Point14Decoder};

pub struct Point14 {
    decoder: Point14Decoder,
    sizes: [usize; Point14Decoder::LAYERS],
    /// Version 3 tells the fields behind this one of a channel only where it
    /// changes, by a mistake that its files depend on; version 4 always.
    tells_always: bool,
}

impl Point14 {
    pub fn of_version_3() -> Point14 {
        Point14::new(false)
    }

    pub fn of_version_4() -> Point14 {
        Point14::new(true)
    }

    fn new(tells_always: bool) -> Point14 {
        let decoder = Point14Decoder::default();
        Point14 { decoder, sizes: [0; Point14Decoder::LAYERS], tells_always }
    }
}

fn io_error(error: LazError) -> io::Error {
    match error {
        LazError::Ended => io::ErrorKind::UnexpectedEof.into(),
        error => io::Error::new(io::ErrorKind::InvalidData, error),
    }
}

impl<R: Read + Seek> LayeredFieldDecompressor<R> for Point14 {
    fn size_of_field(&self) -> usize {
        Point14Decoder::SIZE
    }

    fn set_selection(&mut self, _: DecompressionSelection) {}

    fn init_first_point(&mut self, from: &mut R, record: &mut [u8], channel: &mut usize) -> io::Result<()> {
        let mut bytes = [0; Point14Decoder::SIZE];
        from.read_exact(&mut bytes)?;
        record.copy_from_slice(&bytes);
        *channel = self.decoder.begin(&bytes);
        Ok(())
    }

    fn decompress_field_with(&mut self, record: &mut [u8], channel: &mut usize) -> io::Result<()> {
        let Some(bytes) = record.first_chunk_mut() else { return Err(io::ErrorKind::InvalidData.into()) };
        let (of_point, switches) = self.decoder.decode(bytes).map_err(io_error)?;
        if switches || self.tells_always {
            *channel = of_point;
        }
        Ok(())
    }

    fn read_layers_sizes(&mut self, from: &mut R) -> io::Result<()> {
        for size in &mut self.sizes {
            let mut bytes = [0; 4];
            from.read_exact(&mut bytes)?;
            *size = u32::from_le_bytes(bytes) as usize;
        }
        Ok(())
    }

    /// The sizes were held against the chunk's before.
    fn read_layers(&mut self, from: &mut R) -> io::Result<()> {
        let mut layers: [Vec<u8>; Point14Decoder::LAYERS] = Default::default();
        for (layer, size) in layers.iter_mut().zip(self.sizes) {
            layer.resize(size, 0);
            from.read_exact(layer)?;
        }
        self.decoder.take(layers).map_err(io_error)
    }
}
