//! Colours and marks: after Okabe and Ito, told apart by people with any colour vision, and by shape besides.

use plotters::style::{RGBColor, ShapeStyle};

/// Text and axes.
pub const INK: RGBColor = RGBColor(0x33, 0x33, 0x33);

/// Grid lines.
pub const GRID: RGBColor = RGBColor(0xdd, 0xdd, 0xdd);

/// A line that marks a limit.
pub const LIMIT: RGBColor = RGBColor(0xaa, 0x33, 0x33);

/// Colours of series, in order.
pub const COLOURS: [RGBColor; 7] = [
    RGBColor(0x00, 0x72, 0xb2),
    RGBColor(0xd5, 0x5e, 0x00),
    RGBColor(0x00, 0x9e, 0x73),
    RGBColor(0xcc, 0x79, 0xa7),
    RGBColor(0xc2, 0x88, 0x00),
    RGBColor(0x56, 0xb4, 0xe9),
    RGBColor(0x7a, 0x7a, 0x7a),
];

/// Shapes of marks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shape {
    /// A disc.
    Disc,
    /// A square.
    Square,
    /// A triangle.
    Triangle,
    /// A cross.
    Cross,
    /// A ring.
    Ring,
}

/// Shapes in the order in which they are used up.
const SHAPES: [Shape; 5] = [Shape::Disc, Shape::Square, Shape::Triangle, Shape::Cross, Shape::Ring];

/// How a series looks: 35 combinations before one comes back.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Style(pub usize);

impl Style {
    /// Its colour.
    pub fn colour(self) -> RGBColor {
        COLOURS[self.0 % COLOURS.len()]
    }

    /// Its mark: neighbours in the list differ in both.
    pub fn shape(self) -> Shape {
        SHAPES[(self.0 + self.0 / (COLOURS.len() * SHAPES.len())) % SHAPES.len()]
    }

    pub(super) fn filled(self) -> ShapeStyle {
        ShapeStyle::from(self.colour()).filled()
    }

    pub(super) fn stroke(self) -> ShapeStyle {
        ShapeStyle::from(self.colour()).stroke_width(2)
    }

    /// `#0072b2`, for style sheets.
    pub fn hexadecimal(self) -> String {
        let RGBColor(r, g, b) = self.colour();
        format!("#{r:02X}{g:02X}{b:02X}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn many_series_look_different() {
        let looks: Vec<_> = (0..35).map(|i| (Style(i).colour(), format!("{:?}", Style(i).shape()))).collect();
        for (i, look) in looks.iter().enumerate() {
            assert!(!looks[..i].contains(look), "{i}");
        }
    }
}
