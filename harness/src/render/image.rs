//! Pixels, and PNG files that appear only when they are complete.

use super::colour::Colour;
use crate::file::{self, FileError};
use std::io::Write;
use std::path::Path;

/// An image of 8-bit sRGB pixels, row by row from the top left.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Image {
    width: usize,
    height: usize,
    pixels: Vec<Colour>,
}

impl Image {
    /// Largest width and height in pixels: 16,384, which is what common viewers open.
    pub const LARGEST_SIDE: usize = 1 << 14;

    /// An image of one colour.
    ///
    /// # Panics
    /// If a side is zero or above [`Self::LARGEST_SIDE`].
    pub fn new(width: usize, height: usize, colour: Colour) -> Self {
        let sides = 1..=Self::LARGEST_SIDE;
        assert!(
            sides.contains(&width) && sides.contains(&height),
            "an image cannot be {width} x {height} pixels"
        );
        Self { width, height, pixels: vec![colour; width * height] }
    }

    /// Pixels per row.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Number of rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// All pixels, row by row from the top left.
    pub fn pixels(&self) -> &[Colour] {
        &self.pixels
    }

    /// Mutable access to all pixels.
    pub fn pixels_mut(&mut self) -> &mut [Colour] {
        &mut self.pixels
    }

    /// The bytes of all pixels: red, green, blue.
    pub fn bytes(&self) -> &[u8] {
        self.pixels.as_flattened()
    }

    /// Copies another image so that its top left corner falls on (x, y); what sticks out is cut off.
    pub fn paste(&mut self, other: &Self, x: usize, y: usize) {
        let width = other.width.min(self.width.saturating_sub(x));
        for row in 0..other.height.min(self.height.saturating_sub(y)) {
            let to = (y + row) * self.width + x;
            let from = row * other.width;
            self.pixels[to..to + width].copy_from_slice(&other.pixels[from..from + width]);
        }
    }

    /// Writes a PNG file. The file appears under its name only when it is complete.
    ///
    /// # Errors
    /// [`FileError`] when the file cannot be written.
    pub fn write_png(&self, path: &Path) -> Result<(), FileError> {
        file::write_atomically(path, |out| {
            let mut writer = encoder(out, self).write_header()?;
            writer.write_image_data(self.bytes())?;
            Ok(writer.finish()?)
        })
    }
}

/// A PNG encoder for 8-bit sRGB images of this size.
pub(super) fn encoder<W: Write>(to: W, image: &Image) -> png::Encoder<'static, W> {
    let mut encoder = png::Encoder::new(to, image.width as u32, image.height as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
    encoder
}
