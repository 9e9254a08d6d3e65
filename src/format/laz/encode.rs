//! Chunks of the point formats 6 to 8 from records: the same bytes as LASzip writes.

use super::arithmetic::ArithmeticEncoder;
use super::layered::Attached;
use super::point14::{Channels, LAYERS, Point14, XY, Z};
use super::{RecordShape, field};

#[derive(Debug)]
pub struct LayeredEncoder {
    shape: RecordShape,
    channels: Channels,
    attached: Attached,
    point: [ArithmeticEncoder; LAYERS],
    color: ArithmeticEncoder,
    infrared: ArithmeticEncoder,
    extra: Vec<ArithmeticEncoder>,
    /// Which layers are needed, since a value changed.
    has: [bool; LAYERS],
    has_color: bool,
    has_infrared: bool,
    has_extra: Vec<bool>,
}

impl LayeredEncoder {
    pub fn new(shape: RecordShape) -> LayeredEncoder {
        LayeredEncoder {
            shape,
            channels: Channels::default(),
            attached: Attached::new(shape),
            point: Default::default(),
            color: ArithmeticEncoder::default(),
            infrared: ArithmeticEncoder::default(),
            extra: vec![ArithmeticEncoder::default(); shape.extra],
            has: [false; LAYERS],
            has_color: false,
            has_infrared: false,
            has_extra: vec![false; shape.extra],
        }
    }

    pub fn encode(&mut self, records: &[u8], chunk: &mut Vec<u8>) {
        let length = self.shape.record_length();
        let points = records.len() / length;
        if points == 0 {
            return;
        }
        let (first, rest) = records.split_at(length);
        self.begin(first);
        for record in rest.chunks_exact(length) {
            self.put(record);
        }
        chunk.reserve(records.len() / 4);
        chunk.extend_from_slice(first);
        chunk.extend_from_slice(&(points as u32).to_le_bytes());
        self.finish(chunk);
    }

    fn begin(&mut self, first: &[u8]) {
        let point = Point14::of(&field(first, 0));
        self.channels.begin(point);
        self.attached.begin(self.shape, point.channel(), &first[Point14::SIZE..]);
        let behind = [&mut self.color, &mut self.infrared].into_iter().chain(&mut self.extra);
        self.point.iter_mut().chain(behind).for_each(ArithmeticEncoder::clear);
        self.has = [false; LAYERS];
        (self.has[XY], self.has[Z]) = (true, true);
        (self.has_color, self.has_infrared) = (false, false);
        self.has_extra.fill(false);
    }

    fn put(&mut self, record: &[u8]) {
        let (point, mut rest) = record.split_at(Point14::SIZE);
        let point = Point14::of(&field(point, 0));
        let switches = self.channels.encode(&mut self.point, &mut self.has, point);
        if rest.is_empty() {
            return;
        }
        let attached = &mut self.attached;
        let (models, last) = attached.choose(self.channels.current(), switches);
        if self.shape.color {
            let color = [0, 2, 4].map(|channel| u16::from_le_bytes(field(rest, channel)));
            let last = &mut attached.last_color[last];
            self.has_color |= color != *last;
            attached.color[models].encode(&mut self.color, *last, color);
            *last = color;
            rest = &rest[6..];
        }
        if self.shape.infrared {
            let infrared = u16::from_le_bytes(field(rest, 0));
            let last = &mut attached.last_infrared[last];
            self.has_infrared |= infrared != *last;
            attached.infrared[models].encode(&mut self.infrared, *last, infrared);
            *last = infrared;
            rest = &rest[2..];
        }
        let bytes = rest.iter().zip(&mut attached.last_extra[last]);
        let layers = self.extra.iter_mut().zip(&mut self.has_extra);
        for (((byte, last), model), (layer, has)) in bytes.zip(&mut attached.extra[models]).zip(layers) {
            *has |= byte != last;
            layer.symbol(model.get(256), usize::from(byte.wrapping_sub(*last)));
            *last = *byte;
        }
    }

    /// Writes the layers' sizes and the layers.
    fn finish(&mut self, chunk: &mut Vec<u8>) {
        let color = self.shape.color.then_some((&mut self.color, self.has_color));
        let infrared = self.shape.infrared.then_some((&mut self.infrared, self.has_infrared));
        let extra = self.extra.iter_mut().zip(self.has_extra.iter().copied());
        let layers = self.point.iter_mut().zip(self.has).chain(color).chain(infrared).chain(extra);
        let layers: Vec<&[u8]> = layers
            .map(|(layer, has)| {
                if !has {
                    return [].as_slice();
                }
                layer.finish();
                layer.bytes()
            })
            .collect();
        for layer in &layers {
            chunk.extend_from_slice(&(layer.len() as u32).to_le_bytes());
        }
        for layer in layers {
            chunk.extend_from_slice(layer);
        }
    }
}
