//! Animated PNG previews, which browsers and common viewers play.

use super::image::{Image, encoder};
use crate::file::{self, FileError};
use std::path::Path;

/// Writes frames of one size as an animated PNG that repeats for ever at `rate` frames per second (1 to 1000). Programs
/// that know only plain PNG show the first frame. The file appears under its name only when it is complete.
///
/// # Errors
/// [`FileError`] when the file cannot be written.
///
/// # Panics
/// If there is no frame, or frames differ in size.
pub fn write_apng(frames: &[Image], rate: u16, path: &Path) -> Result<(), FileError> {
    let first = frames.first().expect("an animation has a frame");
    let same = |frame: &Image| (frame.width(), frame.height()) == (first.width(), first.height());
    assert!(frames.iter().all(same), "the frames of an animation have one size");
    file::write_atomically(path, |out| {
        let mut encoder = encoder(out, first);
        encoder.set_animated(frames.len() as u32, 0)?;
        encoder.set_frame_delay(1, rate.clamp(1, 1000))?;
        let mut writer = encoder.write_header()?;
        for frame in frames {
            writer.write_image_data(frame.bytes())?;
        }
        Ok(writer.finish()?)
    })
}
