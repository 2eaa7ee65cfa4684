//! Points and lines over two axes.

use super::axis::Axis;
use super::style::{GRID, INK, LIMIT, Shape, Style};
use super::{Area, Drawn, Frame, Margins, frame, picture, text, x_grid};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, VPos};

/// One series.
#[derive(Clone, Debug)]
pub struct Series {
    /// How it looks.
    pub style: Style,
    /// x and y, in the order in which a line connects them.
    pub points: Vec<(f64, f64)>,
    /// Whether a line does.
    pub line: bool,
    /// Whether the points are marked.
    pub marks: bool,
}

/// A picture of series.
#[derive(Clone, Debug)]
pub struct Plot {
    /// Left to right.
    pub x: Axis,
    /// Bottom to top.
    pub y: Axis,
    /// What is drawn.
    pub series: Vec<Series>,
    /// Upright lines with a name each.
    pub limits: Vec<(f64, String)>,
}

const MARGINS: Margins = Margins { left: 64, right: 18, top: 24, bottom: 52 };

impl Plot {
    /// The picture as SVG.
    pub fn svg(&self) -> String {
        picture(560, 340, |area| self.draw(area))
    }

    fn draw(&self, area: &Area<'_>) -> Drawn {
        let (low, high) = self.y.range();
        let frame = frame(area, MARGINS, &self.x, low..high);
        x_grid(area, &frame, &self.x, (low, high))?;
        self.y_grid(area, &frame)?;
        for (at, name) in &self.limits {
            let Some(x) = self.x.place(*at).filter(|x| (self.x.range().0..self.x.range().1).contains(x))
            else {
                continue;
            };
            frame.draw(&PathElement::new(vec![(x, low), (x, high)], LIMIT))?;
            let (px, py) = frame.map_coordinate(&(x, high));
            text(area, name, (px, py - 4), (HPos::Center, VPos::Bottom))?;
        }
        self.series.iter().try_for_each(|series| self.draw_series(&frame, series))
    }

    fn y_grid(&self, area: &Area<'_>, frame: &Frame<'_>) -> Drawn {
        let ((left, right), (low, high)) = (self.x.range(), self.y.range());
        for tick in self.y.ticks() {
            frame.draw(&PathElement::new(vec![(left, tick.at), (right, tick.at)], GRID))?;
            let (px, py) = frame.map_coordinate(&(left, tick.at));
            text(area, &tick.label, (px - 7, py), (HPos::Right, VPos::Center))?;
        }
        frame.draw(&PathElement::new(vec![(left, high), (left, low), (right, low)], INK))?;
        text(area, &self.y.label, (6, 4), (HPos::Left, VPos::Top))
    }

    fn draw_series(&self, frame: &Frame<'_>, series: &Series) -> Drawn {
        let place = |&(x, y): &(f64, f64)| Some((self.x.place(x)?, self.y.place(y)?));
        let points: Vec<(f64, f64)> = series.points.iter().filter_map(place).collect();
        if series.line && points.len() > 1 {
            frame.draw(&PathElement::new(points.clone(), series.style.stroke()))?;
        }
        if series.marks {
            points.into_iter().try_for_each(|point| mark(frame, point, series.style))?;
        }
        Ok(())
    }
}

/// One mark.
pub(super) fn mark(frame: &Frame<'_>, at: (f64, f64), style: Style) -> Drawn {
    let (filled, stroke) = (style.filled(), style.stroke());
    match style.shape() {
        Shape::Disc => frame.draw(&Circle::new(at, 5, filled)),
        Shape::Ring => frame.draw(&Circle::new(at, 5, stroke)),
        Shape::Triangle => frame.draw(&TriangleMarker::new(at, 6, filled)),
        Shape::Cross => frame.draw(&Cross::new(at, 5, stroke)),
        Shape::Square => frame.draw(&(EmptyElement::at(at) + Rectangle::new([(-4, -4), (4, 4)], filled))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_point_that_has_a_place_is_drawn_and_words_are_escaped() {
        let points = vec![(1.0, 1.0), (10.0, 2.0), (0.0, 3.0), (5.0, f64::NAN)];
        let plot = Plot {
            x: Axis::logarithmic("a < b", [1.0, 10.0]),
            y: Axis::linear("<script>", [1.0, 3.0]),
            series: vec![Series { style: Style(0), points, line: true, marks: true }],
            limits: vec![(3.0, "&".into()), (1e9, "outside".into())],
        };
        let svg = plot.svg();
        assert_eq!(svg.matches("<circle").count(), 2, "{svg}");
        assert!(
            svg.contains("&lt;script&gt;") && !svg.contains("<script") && !svg.contains("outside"),
            "{svg}"
        );
    }

    #[test]
    fn up_is_more() {
        let series = |y: f64| Series { style: Style(0), points: vec![(1.0, y)], line: false, marks: true };
        let height = |y: f64| -> f64 {
            let axes = (Axis::linear("", [2.0]), Axis::linear("", [2.0]));
            let svg = Plot { x: axes.0, y: axes.1, series: vec![series(y)], limits: vec![] }.svg();
            let from = svg.find("cy=\"").expect("a disc") + 4;
            svg[from..].split('"').next().and_then(|cy| cy.parse().ok()).expect("a number")
        };
        assert!(height(2.0) < height(1.0) && height(1.0) < height(0.0));
    }
}
