//! The item POINT14 alone, where the items behind it are decoded elsewhere.

use super::*;

/// Decodes the standard fields of the point formats 6 to 10, chunk after chunk.
#[derive(Debug, Default)]
pub struct Point14Decoder {
    channels: Channels,
    layers: [Layer; LAYERS],
}

/// A layer's bytes, and the decoder between two points: it has `left` of them to take.
#[derive(Debug, Default)]
struct Layer {
    bytes: Vec<u8>,
    decoder: Option<ArithmeticDecoder<'static>>,
    left: usize,
}

impl Layer {
    fn decoder(&self) -> ArithmeticDecoder<'_> {
        let rest = &self.bytes[self.bytes.len() - self.left..];
        self.decoder.map_or(ArithmeticDecoder::empty(), |decoder| decoder.over(rest))
    }
}

impl Point14Decoder {
    /// Bytes of the item in a record.
    pub const SIZE: usize = Point14::SIZE;
    /// Layers of the item in a chunk.
    pub const LAYERS: usize = LAYERS;

    /// Begins a chunk with its first record, and says the channel of that.
    pub fn begin(&mut self, first: &[u8; Point14::SIZE]) -> usize {
        self.channels.begin(Point14::of(first));
        self.channels.current()
    }

    /// Takes over the chunk's layers; one without bytes is of a field that never changes.
    /// An error if one has too few, or begins as no encoder begins.
    pub fn take(&mut self, layers: [Vec<u8>; LAYERS]) -> Result<(), LazError> {
        for (layer, bytes) in self.layers.iter_mut().zip(layers) {
            let decoder = ArithmeticDecoder::of_layer(&bytes)?;
            let left = decoder.as_ref().map_or(0, ArithmeticDecoder::left);
            let decoder = decoder.map(|decoder| decoder.over(&[]));
            *layer = Layer { bytes, decoder, left };
        }
        Ok(())
    }

    /// Decodes the next record. Says its channel, and whether that is another than the
    /// last one's. An error where a layer has ended, or times switch without end.
    pub fn decode(&mut self, record: &mut [u8; Point14::SIZE]) -> Result<(usize, bool), LazError> {
        let has = self.layers.each_ref().map(|layer| layer.decoder.is_some());
        let mut decoders = self.layers.each_ref().map(Layer::decoder);
        let switches = self.channels.decode(&mut decoders, &has, record)?;
        if decoders.iter().any(ArithmeticDecoder::has_ended) {
            return Err(LazError::Ended);
        }
        let states = decoders.map(|decoder| (decoder.left(), decoder.over(&[])));
        for (layer, (left, decoder)) in self.layers.iter_mut().zip(states) {
            if let Some(before) = &mut layer.decoder {
                (*before, layer.left) = (decoder, left);
            }
        }
        Ok((self.channels.current(), switches))
    }
}
