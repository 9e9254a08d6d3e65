//! A turntable as H.264 in MP4, by the `ffmpeg` of the machine where it has one:
//! what presentations and chats take, at the quality of the WebP.

use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use crate::render::error::{RenderError, Result};
use crate::render::frame::Picture;

/// H.264's constant rate factor; 20 is hard to tell from the pictures.
const RATE_FACTOR: &str = "20";

/// An encoder that is being fed.
pub struct Film {
    ffmpeg: Child,
    path: PathBuf,
}

impl Film {
    /// Starts the encoder; both sides must be even. The file stands at `path`
    /// once [`Film::finish`] said so.
    pub fn new([width, height]: [u32; 2], millis: u32, path: &Path) -> Result<Film> {
        let (size, rate) = (format!("{width}x{height}"), format!("1000/{millis}"));
        let ffmpeg = Command::new("ffmpeg")
            .args(["-loglevel", "error", "-nostdin", "-y", "-f", "rawvideo", "-pixel_format", "rgba"])
            .args(["-video_size", &size, "-framerate", &rate, "-i", "pipe:0", "-c:v", "libx264"])
            .args(["-crf", RATE_FACTOR, "-pix_fmt", "yuv420p", "-movflags", "+faststart", "-f", "mp4"])
            .arg(path)
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn();
        let ffmpeg =
            ffmpeg.map_err(|error| failed(format!("ffmpeg did not start ({error}); is it installed?")))?;
        Ok(Film { ffmpeg, path: path.to_path_buf() })
    }

    pub fn add(&mut self, picture: &Picture) -> Result<()> {
        let Some(pipe) = &mut self.ffmpeg.stdin else { return Ok(()) };
        match pipe.write_all(picture.pixels.as_flattened()) {
            Ok(()) => Ok(()),
            // It has said why, and gone.
            Err(_) => Err(self.complaint()),
        }
    }

    /// Waits until the file is whole.
    pub fn finish(mut self) -> Result<()> {
        drop(self.ffmpeg.stdin.take());
        match self.ffmpeg.wait() {
            Ok(status) if status.success() => Ok(()),
            _ => Err(self.complaint()),
        }
    }

    fn complaint(&mut self) -> RenderError {
        let mut said = String::new();
        if let Some(mut stderr) = self.ffmpeg.stderr.take() {
            // What cannot be read is not told; the error stands without it.
            let _ = stderr.read_to_string(&mut said);
        }
        failed(format!("{}: ffmpeg said: {}", self.path.display(), said.trim()))
    }
}

impl Drop for Film {
    fn drop(&mut self) {
        // One that has ended cannot be killed, which is as well.
        let _ = self.ffmpeg.kill();
        let _ = self.ffmpeg.wait();
    }
}

fn failed(reason: String) -> RenderError {
    RenderError::Encode { what: "an MP4", reason }
}
