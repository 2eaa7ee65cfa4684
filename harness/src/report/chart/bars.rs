//! Horizontal bars, in parts, with a name beside each.

use super::axis::Axis;
use super::style::{INK, LIMIT, Style};
use super::{Area, Drawn, Frame, Margins, frame, picture, text, x_grid};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, VPos};

/// One bar.
#[derive(Clone, Debug)]
pub struct Bar {
    /// Its name.
    pub label: String,
    /// Lengths of its parts, from the left, each with its look.
    pub parts: Vec<(Style, f64)>,
    /// A mark across the bar: what it could be at most.
    pub mark: Option<f64>,
    /// What stands behind its end.
    pub note: String,
}

/// A picture of bars from 0.
#[derive(Clone, Debug)]
pub struct Bars {
    /// What the lengths are, with the unit.
    pub label: String,
    /// From top to bottom.
    pub bars: Vec<Bar>,
}

/// Height of a bar with its gap.
const PITCH: u32 = 24;
/// Width of the names.
pub(super) const NAMES: u32 = 220;

const MARGINS: Margins = Margins { left: NAMES, right: 90, top: 8, bottom: 48 };

impl Bars {
    /// The picture as SVG.
    pub fn svg(&self) -> String {
        let height = PITCH * self.bars.len().max(1) as u32 + MARGINS.top + MARGINS.bottom;
        picture(640, height, |area| self.draw(area))
    }

    fn draw(&self, area: &Area<'_>) -> Drawn {
        let lengths = self.bars.iter().map(|bar| bar.length().max(bar.mark.unwrap_or(0.0)));
        let axis = Axis::linear(&self.label, lengths);
        let rows = self.bars.len().max(1) as f64;
        let frame = frame(area, MARGINS, &axis, 0.0..rows);
        x_grid(area, &frame, &axis, (0.0, rows))?;
        for (i, bar) in self.bars.iter().enumerate() {
            bar.draw(area, &frame, rows - i as f64 - 0.5)?;
        }
        frame.draw(&PathElement::new(vec![(0.0, 0.0), (0.0, rows)], INK))
    }
}

impl Bar {
    fn length(&self) -> f64 {
        self.parts.iter().map(|(_, length)| length).sum()
    }

    fn draw(&self, area: &Area<'_>, frame: &Frame<'_>, y: f64) -> Drawn {
        let (origin, row) = frame.map_coordinate(&(0.0, y));
        text(area, &shortened(&self.label), (origin - 8, row), (HPos::Right, VPos::Center))?;
        let mut from = 0.0;
        for (style, length) in self.parts.iter().filter(|(_, length)| *length > 0.0) {
            frame.draw(&Rectangle::new([(from, y - 0.36), (from + length, y + 0.36)], style.filled()))?;
            from += length;
        }
        if let Some(mark) = self.mark {
            frame.draw(&PathElement::new(vec![(mark, y - 0.45), (mark, y + 0.45)], LIMIT.stroke_width(2)))?;
        }
        let end = from.max(self.mark.unwrap_or(0.0));
        let (px, py) = frame.map_coordinate(&(end, y));
        text(area, &self.note, (px + 6, py), (HPos::Left, VPos::Center))
    }
}

/// A name that fits beside its row.
pub(super) fn shortened(label: &str) -> String {
    const MOST: usize = 33;
    if label.chars().count() <= MOST {
        return label.to_owned();
    }
    let kept: String = label.chars().take(MOST - 1).collect();
    kept + "\u{2026}"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bars_have_their_parts_and_names() {
        let bar = Bar {
            label: "a&b".into(),
            parts: vec![(Style(0), 1.0), (Style(1), 0.0), (Style(2), 2.0)],
            mark: Some(4.0),
            note: "3".into(),
        };
        let svg = Bars { label: "ms".into(), bars: vec![bar] }.svg();
        assert_eq!(svg.matches("<rect").count(), 2, "{svg}");
        assert!(svg.contains("a&amp;b"));
        assert!(Bars { label: String::new(), bars: vec![] }.svg().contains("</svg>"));
        assert_eq!(shortened(&"x".repeat(99)).chars().count(), 33);
    }
}
