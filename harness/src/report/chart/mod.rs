//! Pictures of results as SVG: the only place that knows plotters.
//!
//! Marks carry the colours of [`style`]; text, axes and grid the neutral ones, which the page's style sheet replaces in
//! dark mode. Text stays text, so it can be selected and searched.

pub mod axis;
pub mod bars;
pub mod dots;
pub mod plot;
pub mod style;

use axis::Axis;
use plotters::coord::Shift;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

/// The drawing area of a picture in the making.
pub(crate) type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

/// A rectangle with coordinates inside of a picture.
pub(crate) type Frame<'a> = DrawingArea<SVGBackend<'a>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;

/// What goes wrong in a drawing; on a string, nothing does.
pub(crate) type Drawn = Result<(), DrawingAreaErrorKind<std::io::Error>>;

/// Points per em of ordinary text; plotters divides sizes by 1.24 on their way into the file.
pub(crate) const TEXT: f64 = 15.0;

/// A picture of `width` x `height` units, drawn by `draw`.
pub(crate) fn picture(width: u32, height: u32, draw: impl FnOnce(&Area<'_>) -> Drawn) -> String {
    let mut svg = String::new();
    {
        let area = SVGBackend::with_string(&mut svg, (width, height)).into_drawing_area();
        let drawn = draw(&area).and_then(|()| area.present());
        debug_assert!(drawn.is_ok(), "{drawn:?}");
    }
    svg.replacen("<svg ", "<svg role=\"img\" ", 1)
}

/// Text at a pixel.
pub(crate) fn text(area: &Area<'_>, words: &str, at: (i32, i32), anchor: (HPos, VPos)) -> Drawn {
    let style = TextStyle::from(("sans-serif", TEXT).into_font())
        .color(&style::INK)
        .pos(Pos::new(anchor.0, anchor.1));
    area.draw(&Text::new(words.to_owned(), at, style))
}

/// The part of `area` inside of margins, with the coordinates of two axes.
pub(crate) fn frame<'a>(area: &Area<'a>, margins: Margins, x: &Axis, y: std::ops::Range<f64>) -> Frame<'a> {
    let (width, height) = area.dim_in_pixel();
    let inside = (margins.left as i32, (width - margins.right) as i32);
    let up = ((height - margins.bottom) as i32, margins.top as i32); // pixels count downwards
    let (low, high) = x.range();
    area.apply_coord_spec(Cartesian2d::new(low..high, y, (inside.0..inside.1, up.0..up.1)))
}

/// Space around a frame, pixels.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Margins {
    pub left: u32,
    pub right: u32,
    pub top: u32,
    pub bottom: u32,
}

/// Grid lines and labels of the x axis, below a frame that spans `y`.
pub(crate) fn x_grid(area: &Area<'_>, frame: &Frame<'_>, axis: &Axis, y: (f64, f64)) -> Drawn {
    for tick in axis.ticks() {
        frame.draw(&PathElement::new(vec![(tick.at, y.0), (tick.at, y.1)], style::GRID))?;
        let (px, py) = frame.map_coordinate(&(tick.at, y.0));
        text(area, &tick.label, (px, py + 6), (HPos::Center, VPos::Top))?;
    }
    let (low, high) = axis.range();
    let (px, py) = frame.map_coordinate(&(0.5 * (low + high), y.0));
    text(area, &axis.label, (px, py + 24), (HPos::Center, VPos::Top))
}
