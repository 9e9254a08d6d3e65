//! Red, green and blue, and near infrared, byte by byte: first which bytes differ from
//! the last color's, then those. Green and blue are predicted from how red changed, and
//! not told at all where the color is a grey.

use super::arithmetic::{ArithmeticDecoder, ArithmeticEncoder};
use super::model::{ByteModel, LazyModel, slots};

pub type Color = [u16; 3];

/// The bit that says that green or blue differs from red; below it a bit for the lower
/// and the upper byte of each channel.
const COLORED: usize = 1 << 6;

#[derive(Debug, Clone)]
pub struct ColorModels {
    which: LazyModel<ByteModel>,
    bytes: [LazyModel<ByteModel>; 6],
}

impl Default for ColorModels {
    fn default() -> ColorModels {
        ColorModels { which: LazyModel::default(), bytes: slots() }
    }
}

fn halves(color: Color) -> [[i32; 2]; 3] {
    color.map(|channel| channel.to_le_bytes().map(i32::from))
}

/// Predictions of the lower or upper byte of green and blue; that of blue takes green.
fn green(red: i32, last: [i32; 3]) -> i32 {
    (red - last[0] + last[1]).clamp(0, 255)
}

fn blue(red: i32, green: i32, last: [i32; 3]) -> i32 {
    ((red - last[0] + green - last[1]) / 2 + last[2]).clamp(0, 255)
}

impl ColorModels {
    pub fn clear(&mut self) {
        self.which.clear();
        self.bytes.iter_mut().for_each(LazyModel::clear);
    }

    #[inline(never)]
    pub fn decode(&mut self, from: &mut ArithmeticDecoder, last: Color) -> Color {
        from.apart(|from| self.decode_inline(from, last))
    }

    #[inline(always)]
    pub fn decode_inline(&mut self, from: &mut ArithmeticDecoder, last: Color) -> Color {
        let which = from.symbol(self.which.get(128));
        let last = halves(last);
        let mut color = last;
        for half in 0..2 {
            if which >> half & 1 == 1 {
                color[0][half] = self.byte(from, half, last[0][half]);
            }
        }
        if which & COLORED == 0 {
            color = [color[0]; 3];
        } else {
            for half in 0..2 {
                let of = last.map(|channel| channel[half]);
                let red = color[0][half];
                if which >> (2 + half) & 1 == 1 {
                    color[1][half] = self.byte(from, 2 + half, green(red, of));
                }
                if which >> (4 + half) & 1 == 1 {
                    color[2][half] = self.byte(from, 4 + half, blue(red, color[1][half], of));
                }
            }
        }
        color.map(|[low, high]| (high << 8 | low) as u16)
    }

    #[inline(always)]
    fn byte(&mut self, from: &mut ArithmeticDecoder, bit: usize, predicted: i32) -> i32 {
        (from.symbol(self.bytes[bit].get(256)) as i32 + predicted) & 255
    }

    pub fn encode(&mut self, to: &mut ArithmeticEncoder, last: Color, color: Color) {
        let (last, now) = (halves(last), halves(color));
        let mut which = if color[1] == color[0] && color[2] == color[0] { 0 } else { COLORED };
        for channel in 0..3 {
            for half in 0..2 {
                which |= usize::from(last[channel][half] != now[channel][half]) << (2 * channel + half);
            }
        }
        to.symbol(self.which.get(128), which);
        let mut byte = |bit: usize, predicted: i32, byte: i32| {
            if which >> bit & 1 == 1 {
                to.symbol(self.bytes[bit].get(256), ((byte - predicted) & 255) as usize);
            }
        };
        byte(0, last[0][0], now[0][0]);
        byte(1, last[0][1], now[0][1]);
        if which & COLORED != 0 {
            for half in 0..2 {
                let of = last.map(|channel| channel[half]);
                let [red, g, b] = now.map(|channel| channel[half]);
                byte(2 + half, green(red, of), g);
                byte(4 + half, blue(red, g, of), b);
            }
        }
    }
}

#[derive(Debug, Clone)]
pub struct InfraredModels {
    which: LazyModel<ByteModel>,
    bytes: [LazyModel<ByteModel>; 2],
}

impl Default for InfraredModels {
    fn default() -> InfraredModels {
        InfraredModels { which: LazyModel::default(), bytes: slots() }
    }
}

impl InfraredModels {
    pub fn clear(&mut self) {
        self.which.clear();
        self.bytes.iter_mut().for_each(LazyModel::clear);
    }

    #[inline(never)]
    pub fn decode(&mut self, from: &mut ArithmeticDecoder, last: u16) -> u16 {
        let which = from.symbol(self.which.get(4));
        let mut bytes = last.to_le_bytes();
        for (half, byte) in bytes.iter_mut().enumerate() {
            if which >> half & 1 == 1 {
                *byte = byte.wrapping_add(from.symbol(self.bytes[half].get(256)) as u8);
            }
        }
        u16::from_le_bytes(bytes)
    }

    pub fn encode(&mut self, to: &mut ArithmeticEncoder, last: u16, now: u16) {
        let (last, now) = (last.to_le_bytes(), now.to_le_bytes());
        let which = usize::from(last[0] != now[0]) | usize::from(last[1] != now[1]) << 1;
        to.symbol(self.which.get(4), which);
        for half in 0..2 {
            if last[half] != now[half] {
                to.symbol(self.bytes[half].get(256), usize::from(now[half].wrapping_sub(last[half])));
            }
        }
    }
}
