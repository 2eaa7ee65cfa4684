//! Contact sheets: many images in one.

use super::colour::Colour;
use super::image::Image;

/// Puts images of any size into a grid of `columns` columns, row by row, with a gap of `gap` pixels, on `background`.
///
/// Returns none if there is no image, or if the sheet would be larger than an image may be.
pub fn contact_sheet(images: &[Image], columns: usize, gap: usize, background: Colour) -> Option<Image> {
    let columns = columns.clamp(1, images.len().max(1));
    let cell_width = images.iter().map(Image::width).max()? + gap;
    let cell_height = images.iter().map(Image::height).max()? + gap;
    let (width, height) = (columns * cell_width + gap, images.len().div_ceil(columns) * cell_height + gap);
    if width.max(height) > Image::LARGEST_SIDE {
        return None;
    }
    let mut sheet = Image::new(width, height, background);
    for (index, image) in images.iter().enumerate() {
        sheet.paste(image, gap + index % columns * cell_width, gap + index / columns * cell_height);
    }
    Some(sheet)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn images_fill_the_sheet_row_by_row() {
        let images: Vec<Image> = (1..=3).map(|i| Image::new(2, 1, [i; 3])).collect();
        let sheet = contact_sheet(&images, 2, 1, [0; 3]).unwrap();
        assert_eq!((sheet.width(), sheet.height()), (7, 5));
        let row = |y: usize| sheet.pixels()[7 * y..][..7].iter().map(|p| p[0]).collect::<Vec<u8>>();
        assert_eq!(row(1), [0, 1, 1, 0, 2, 2, 0]);
        assert_eq!(row(3), [0, 3, 3, 0, 0, 0, 0]);
        assert!(contact_sheet(&[], 2, 1, [0; 3]).is_none());
    }
}
