//! One dot per row on a logarithmic axis, with its interval: for times that differ by factors.

use super::axis::Axis;
use super::bars::{NAMES, shortened};
use super::plot::mark;
use super::style::{GRID, LIMIT, Style};
use super::{Area, Drawn, Frame, Margins, TEXT, frame, picture, text, x_grid};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, VPos};

/// One row.
#[derive(Clone, Debug)]
pub struct Dot {
    /// Its name.
    pub label: String,
    /// How the dot looks.
    pub style: Style,
    /// Where it is.
    pub value: f64,
    /// Its interval, if it has one.
    pub interval: Option<(f64, f64)>,
    /// What stands at the right.
    pub note: String,
}

/// Rows under a heading.
#[derive(Clone, Debug)]
pub struct Panel {
    /// The heading.
    pub title: String,
    /// From top to bottom.
    pub dots: Vec<Dot>,
}

/// A picture of panels over one axis.
#[derive(Clone, Debug)]
pub struct Dots {
    /// What the values are, with the unit.
    pub label: String,
    /// From top to bottom.
    pub panels: Vec<Panel>,
    /// Upright lines with a name each.
    pub limits: Vec<(f64, String)>,
    /// A white ground of its own, for pictures outside of a page.
    pub ground: bool,
}

const PITCH: u32 = 24;
const MARGINS: Margins = Margins { left: NAMES, right: 110, top: 26, bottom: 48 };

impl Dots {
    /// The picture as SVG.
    pub fn svg(&self) -> String {
        picture(720, PITCH * self.rows() + MARGINS.top + MARGINS.bottom, |area| self.draw(area))
    }

    fn rows(&self) -> u32 {
        self.panels.iter().map(|panel| panel.dots.len() as u32 + 1).sum::<u32>().max(1)
    }

    fn draw(&self, area: &Area<'_>) -> Drawn {
        if self.ground {
            area.fill(&WHITE)?;
        }
        let ends = |dot: &Dot| [Some(dot.value), dot.interval.map(|i| i.0), dot.interval.map(|i| i.1)];
        let dots = self.panels.iter().flat_map(|panel| &panel.dots);
        let limits = self.limits.iter().map(|(at, _)| *at);
        let axis = Axis::logarithmic(&self.label, dots.flat_map(ends).flatten().chain(limits));
        let rows = f64::from(self.rows());
        let frame = frame(area, MARGINS, &axis, 0.0..rows);
        x_grid(area, &frame, &axis, (0.0, rows))?;
        self.draw_limits(area, &frame, &axis, rows)?;
        let mut y = rows - 0.5;
        for panel in &self.panels {
            let (_, row) = frame.map_coordinate(&(axis.range().0, y));
            heading(area, &panel.title, row)?;
            y -= 1.0;
            for dot in &panel.dots {
                dot.draw(area, &frame, &axis, y)?;
                y -= 1.0;
            }
        }
        Ok(())
    }

    fn draw_limits(&self, area: &Area<'_>, frame: &Frame<'_>, axis: &Axis, rows: f64) -> Drawn {
        for (at, name) in &self.limits {
            let Some(x) = axis.place(*at) else { continue };
            frame.draw(&PathElement::new(vec![(x, 0.0), (x, rows)], LIMIT))?;
            let (px, py) = frame.map_coordinate(&(x, rows));
            text(area, name, (px, py - 4), (self.lean(*at), VPos::Bottom))?;
        }
        Ok(())
    }

    /// Names of the outermost limits lean outwards, so that those of 60 and 120 Hz do not overlap.
    fn lean(&self, at: f64) -> HPos {
        let lower = self.limits.iter().any(|(other, _)| *other < at);
        let higher = self.limits.iter().any(|(other, _)| *other > at);
        match (lower, higher) {
            (true, false) => HPos::Left,
            (false, true) => HPos::Right,
            _ => HPos::Center,
        }
    }
}

fn heading(area: &Area<'_>, words: &str, row: i32) -> Drawn {
    let font = FontDesc::new(FontFamily::SansSerif, TEXT, FontStyle::Bold);
    let style = TextStyle::from(font).color(&super::style::INK);
    let style = style.pos(plotters::style::text_anchor::Pos::new(HPos::Left, VPos::Center));
    area.draw(&Text::new(words.to_owned(), (8, row), style))
}

impl Dot {
    fn draw(&self, area: &Area<'_>, frame: &Frame<'_>, axis: &Axis, y: f64) -> Drawn {
        let (low, high) = axis.range();
        let (left, row) = frame.map_coordinate(&(low, y));
        text(area, &shortened(&self.label), (left - 8, row), (HPos::Right, VPos::Center))?;
        frame.draw(&PathElement::new(vec![(low, y), (high, y)], GRID))?;
        let interval = self.interval.and_then(|(a, b)| Some((axis.place(a)?, axis.place(b)?)));
        if let Some((a, b)) = interval {
            frame.draw(&PathElement::new(vec![(a, y), (b, y)], self.style.stroke()))?;
        }
        if let Some(x) = axis.place(self.value) {
            mark(frame, (x, y), self.style)?;
        }
        let (right, _) = frame.map_coordinate(&(high, y));
        text(area, &self.note, (right + 8, row), (HPos::Left, VPos::Center))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dots_have_names_notes_and_headings() {
        let dot = Dot {
            label: "x<y".into(),
            style: Style(0),
            value: 2.0,
            interval: Some((1.0, 3.0)),
            note: "2 ms".into(),
        };
        let panel = Panel { title: "body".into(), dots: vec![dot] };
        let dots = Dots {
            label: "ms".into(),
            panels: vec![panel],
            limits: vec![(16.7, "60 Hz".into()), (8.3, "120 Hz".into())],
            ground: true,
        };
        let svg = dots.svg();
        for words in ["x&lt;y", "2 ms", "body", "60 Hz"] {
            assert!(svg.contains(words), "{words}: {svg}");
        }
        assert_eq!(svg.matches("<circle").count(), 1);
        // Left of the left line, right of the right one.
        assert!(matches!((dots.lean(8.3), dots.lean(16.7)), (HPos::Right, HPos::Left)));
    }
}
