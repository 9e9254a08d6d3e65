//! Chunks of the point formats 6 to 8: the first record as it is, the number of points,
//! the sizes of the layers, and the layers, one stream each.

use super::arithmetic::ArithmeticDecoder;
use super::color::{Color, ColorModels, InfraredModels};
use super::model::{ByteModel, LazyModel};
use super::point14::{Channels, LAYERS, Point14};
use super::{LazError, RecordShape, field};

/// Points between two looks at whether a layer has ended.
const POINTS_BETWEEN_LOOKS: usize = 64;

/// The fields behind the point, which have models and last values for each scanner
/// channel too. In version 3 they mix them up, in a way that files depend on.
#[derive(Debug)]
pub struct Attached {
    always_told: bool,
    /// The channel of the last point, as these fields were told it.
    last: usize,
    used: [bool; 4],
    pub color: [ColorModels; 4],
    pub last_color: [Color; 4],
    pub infrared: [InfraredModels; 4],
    pub last_infrared: [u16; 4],
    /// Made when their channel is first used: they are many.
    pub extra: [Vec<LazyModel<ByteModel>>; 4],
    pub last_extra: [Vec<u8>; 4],
}

impl Attached {
    pub fn new(shape: RecordShape) -> Attached {
        Attached {
            always_told: shape.version == 4,
            last: 0,
            used: [false; 4],
            color: Default::default(),
            last_color: [[0; 3]; 4],
            infrared: Default::default(),
            last_infrared: [0; 4],
            extra: Default::default(),
            last_extra: Default::default(),
        }
    }

    /// Begins with the fields of a chunk's first record.
    pub fn begin(&mut self, shape: RecordShape, channel: usize, first: &[u8]) {
        let channel = channel & 3;
        self.last = channel;
        self.used = [false; 4];
        let mut at = 0;
        if shape.color {
            self.last_color[channel] = [0, 2, 4].map(|c| u16::from_le_bytes(field(first, c)));
            at = 6;
        }
        if shape.infrared {
            self.last_infrared[channel] = u16::from_le_bytes(field(first, at));
            at += 2;
        }
        self.last_extra[channel].clear();
        self.last_extra[channel].extend_from_slice(&first[at..]);
        self.enter(channel);
    }

    fn enter(&mut self, channel: usize) {
        self.used[channel] = true;
        self.color[channel].clear();
        self.infrared[channel].clear();
        self.extra[channel].iter_mut().for_each(LazyModel::clear);
        self.extra[channel].resize(self.last_extra[self.last].len(), LazyModel::default());
    }

    /// Which models and which last values serve a point of this channel.
    #[inline(always)]
    pub fn choose(&mut self, channel: usize, switches: bool) -> (usize, usize) {
        let told = if self.always_told || switches { channel & 3 } else { 0 };
        let last = self.last & 3;
        if told == last {
            return (last, last);
        }
        let is_new = !self.used[told];
        if is_new {
            self.begin_channel(told);
        }
        self.last = told;
        (told, if is_new || self.always_told { told } else { last })
    }

    #[cold]
    #[inline(never)]
    fn begin_channel(&mut self, channel: usize) {
        let last = self.last & 3;
        self.last_color[channel] = self.last_color[last];
        self.last_infrared[channel] = self.last_infrared[last];
        self.last_extra[channel] = self.last_extra[last].clone();
        self.enter(channel);
    }
}

#[derive(Debug)]
pub struct LayeredDecoder {
    shape: RecordShape,
    channels: Channels,
    attached: Attached,
}

/// The layers of a chunk; a field without one never changes.
struct Layers<'a> {
    point: [ArithmeticDecoder<'a>; LAYERS],
    has: [bool; LAYERS],
    color: Option<ArithmeticDecoder<'a>>,
    infrared: Option<ArithmeticDecoder<'a>>,
    extra: Vec<Option<ArithmeticDecoder<'a>>>,
}

impl<'a> Layers<'a> {
    /// Cuts the layers, which have to fill the chunk.
    fn cut(shape: RecordShape, sizes: &[u8], bytes: &'a [u8], before: usize) -> Result<Layers<'a>, LazError> {
        let sizes = sizes.chunks_exact(4).map(|size| u32::from_le_bytes(field(size, 0)));
        let said = sizes.clone().map(u64::from).sum::<u64>();
        if said != bytes.len() as u64 {
            let before = before as u64;
            return Err(LazError::Layers(before + said, before + bytes.len() as u64));
        }
        let mut rest = bytes;
        let mut layers = sizes.map(|size| {
            let (layer, behind) = rest.split_at_checked(size as usize).ok_or(LazError::Ended)?;
            rest = behind;
            ArithmeticDecoder::of_layer(layer)
        });
        let mut next = || layers.next().unwrap_or(Ok(None));
        let mut point = [ArithmeticDecoder::empty(); LAYERS];
        let mut has = [false; LAYERS];
        for (point, has) in point.iter_mut().zip(&mut has) {
            if let Some(layer) = next()? {
                (*point, *has) = (layer, true);
            }
        }
        let color = if shape.color { next()? } else { None };
        let infrared = if shape.infrared { next()? } else { None };
        let extra = (0..shape.extra).map(|_| next()).collect::<Result<_, _>>()?;
        Ok(Layers { point, has, color, infrared, extra })
    }

    fn have_ended(&self) -> bool {
        let behind = self.color.iter().chain(&self.infrared).chain(self.extra.iter().flatten());
        self.point.iter().chain(behind).any(ArithmeticDecoder::has_ended)
    }
}

impl LayeredDecoder {
    pub fn new(shape: RecordShape) -> LayeredDecoder {
        LayeredDecoder { shape, channels: Channels::default(), attached: Attached::new(shape) }
    }

    pub fn decode(&mut self, chunk: &[u8], records: &mut [u8]) -> Result<(), LazError> {
        let length = self.shape.record_length();
        let points = records.len() / length;
        let Some((front, bytes)) = chunk.split_at_checked(self.shape.front()) else {
            return Err(LazError::TooShort(chunk.len()));
        };
        let (first, sizes) = front.split_at(length);
        let mut layers = Layers::cut(self.shape, &sizes[4..], bytes, front.len())?;
        let said = u32::from_le_bytes(field(sizes, 0));
        if u64::from(said) != points as u64 || points == 0 {
            return Err(LazError::Points(u64::from(said), points as u64));
        }
        let (record, records) = records.split_at_mut(length);
        record.copy_from_slice(first);
        let first = Point14::of(&field(record, 0));
        self.channels.begin(first);
        self.attached.begin(self.shape, first.channel(), &record[Point14::SIZE..]);
        for records in records.chunks_mut(POINTS_BETWEEN_LOOKS * length) {
            self.run(&mut layers, records)?;
            if layers.have_ended() {
                return Err(LazError::Ended);
            }
        }
        Ok(())
    }

    fn run(&mut self, layers: &mut Layers, records: &mut [u8]) -> Result<(), LazError> {
        let shape = self.shape;
        let is_bare = shape.record_length() == Point14::SIZE;
        for record in records.chunks_exact_mut(shape.record_length()) {
            let Some((bytes, mut rest)) = record.split_first_chunk_mut() else { break };
            let switches = self.channels.decode(&mut layers.point, &layers.has, bytes)?;
            if is_bare {
                continue;
            }
            let attached = &mut self.attached;
            let (models, last) = attached.choose(self.channels.current(), switches);
            if shape.color {
                let last = &mut attached.last_color[last];
                if let Some(layer) = &mut layers.color {
                    *last = attached.color[models].decode(layer, *last);
                }
                let Some((bytes, behind)) = rest.split_first_chunk_mut::<6>() else { break };
                for (bytes, channel) in bytes.chunks_exact_mut(2).zip(last) {
                    bytes.copy_from_slice(&channel.to_le_bytes());
                }
                rest = behind;
            }
            if shape.infrared {
                let last = &mut attached.last_infrared[last];
                if let Some(layer) = &mut layers.infrared {
                    *last = attached.infrared[models].decode(layer, *last);
                }
                let Some((bytes, behind)) = rest.split_first_chunk_mut() else { break };
                *bytes = last.to_le_bytes();
                rest = behind;
            }
            if shape.extra > 0 {
                let last = &mut attached.last_extra[last];
                let models = &mut attached.extra[models];
                for ((last, model), layer) in last.iter_mut().zip(models).zip(&mut layers.extra) {
                    if let Some(layer) = layer {
                        *last = last.wrapping_add(layer.symbol(model.get(256)) as u8);
                    }
                }
                rest.copy_from_slice(last);
            }
        }
        Ok(())
    }
}
