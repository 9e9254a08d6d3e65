//! A turntable as animated WebP, which browsers show like any picture, at a
//! third of the size of a GIF and without its 256 colours.

use webp_animation::{Encoder, EncoderOptions, EncodingConfig, EncodingType, LossyEncodingConfig};

use crate::render::error::{RenderError, Result};
use crate::render::frame::Picture;

/// Quality of the lossy encoding, of 100.
const QUALITY: f32 = 75.0;
/// Effort of the encoder, of 6.
const EFFORT: usize = 2;

/// Frames of an animation that goes round for ever.
pub struct Animation {
    encoder: Encoder,
    at: i32,
    millis: i32,
}

impl Animation {
    /// `millis` is how long each frame stands.
    pub fn new([width, height]: [u32; 2], millis: u32) -> Result<Animation> {
        let options = EncoderOptions {
            encoding_config: Some(EncodingConfig {
                encoding_type: EncodingType::Lossy(LossyEncodingConfig::default()),
                quality: QUALITY,
                method: EFFORT,
            }),
            ..EncoderOptions::default()
        };
        let encoder = Encoder::new_with_options((width, height), options).map_err(failed)?;
        Ok(Animation { encoder, at: 0, millis: millis as i32 })
    }

    pub fn add(&mut self, picture: &Picture) -> Result<()> {
        self.encoder.add_frame(picture.pixels.as_flattened(), self.at).map_err(failed)?;
        self.at += self.millis;
        Ok(())
    }

    /// The bytes of the file.
    pub fn finish(self) -> Result<Vec<u8>> {
        Ok(self.encoder.finalize(self.at).map_err(failed)?.to_vec())
    }
}

fn failed(error: webp_animation::Error) -> RenderError {
    RenderError::Encode { what: "an animated WebP", reason: error.to_string() }
}
