//! One picture as PNG.

use crate::render::error::{RenderError, Result};
use crate::render::frame::Picture;

/// The bytes of a PNG; without an alpha channel where no pixel needs one.
pub fn png(picture: &Picture) -> Result<Vec<u8>> {
    let opaque = picture.pixels.iter().all(|pixel| pixel[3] == 255);
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, picture.width, picture.height);
    encoder.set_color(if opaque { png::ColorType::Rgb } else { png::ColorType::Rgba });
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
    encoder.set_compression(png::Compression::Balanced);
    let pixels: Vec<u8> = match opaque {
        true => picture.pixels.iter().flat_map(|pixel| [pixel[0], pixel[1], pixel[2]]).collect(),
        false => picture.pixels.as_flattened().to_vec(),
    };
    let failed = |error: png::EncodingError| RenderError::Encode { what: "a PNG", reason: error.to_string() };
    let mut writer = encoder.write_header().map_err(failed)?;
    writer.write_image_data(&pixels).map_err(failed)?;
    writer.finish().map_err(failed)?;
    Ok(bytes)
}
