//! Animated PNG previews, which browsers and common viewers play.

use super::image::{Image, encoder};
use crate::file::{self, FileError};
use std::path::Path;

/// Writes `count` frames of one size as an animated PNG that repeats for ever at `rate` frames per second (1 to 1000).
/// Each frame is made when its turn comes, so that one is in memory at a time. Programs that know only plain PNG show the
/// first frame. The file appears under its name only when it is complete.
///
/// # Errors
/// [`FileError`] when the file cannot be written.
///
/// # Panics
/// If `count` is zero or frames differ in size.
pub fn write_apng(
    count: u32,
    rate: u16,
    path: &Path,
    mut frame: impl FnMut(u32) -> Image,
) -> Result<(), FileError> {
    assert!(count > 0, "an animation has a frame");
    let first = frame(0);
    file::write_atomically(path, |out| {
        let mut encoder = encoder(out, &first);
        encoder.set_animated(count, 0)?;
        encoder.set_frame_delay(1, rate.clamp(1, 1000))?;
        let mut writer = encoder.write_header()?;
        writer.write_image_data(first.bytes())?;
        for k in 1..count {
            let image = frame(k);
            let same = (image.width(), image.height()) == (first.width(), first.height());
            assert!(same, "the frames of an animation have one size");
            writer.write_image_data(image.bytes())?;
        }
        Ok(writer.finish()?)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs::File;
    use std::io::BufReader;

    #[test]
    fn pictures_and_animations_read_back() {
        let folder = tempfile::tempdir().unwrap();
        let mut image = Image::new(3, 2, [10, 20, 30]);
        image.pixels_mut()[4] = [200, 100, 0];
        let frames = [image.clone(), Image::new(3, 2, [1, 2, 3])];
        let paths = ["still.png", "moving.png"].map(|name| folder.path().join(name));
        image.write_png(&paths[0]).unwrap();
        write_apng(2, 30, &paths[1], |k| frames[k as usize].clone()).unwrap();
        for (path, count) in paths.iter().zip([1, 2]) {
            let mut reader =
                png::Decoder::new(BufReader::new(File::open(path).unwrap())).read_info().unwrap();
            assert_eq!(reader.info().animation_control().map_or(1, |control| control.num_frames), count);
            for frame in &frames[..count as usize] {
                let mut bytes = vec![0; 18];
                reader.next_frame(&mut bytes).unwrap();
                assert_eq!(bytes, frame.bytes());
            }
        }
    }
}
