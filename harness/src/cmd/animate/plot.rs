//! Figures of every frame as an SVG plot: latency, volume, edge lengths.

use super::statistics::Frame;
use crate::file::{self, FileError};
use plotters::prelude::*;
use std::path::Path;

/// One curve of a panel.
type Curve<'a> = (&'a str, RGBColor, Vec<f64>);

/// Draws three panels above each other.
///
/// # Errors
/// [`FileError`] when the file cannot be written.
pub fn write(path: &Path, frames: &[Frame]) -> Result<(), FileError> {
    const BLUE: RGBColor = RGBColor(0, 114, 178); // colour-blind-safe palette of Okabe and Ito
    const ORANGE: RGBColor = RGBColor(213, 94, 0);
    const GREEN: RGBColor = RGBColor(0, 158, 115);
    let of = |value: fn(&Frame) -> f64| frames.iter().map(value).collect::<Vec<f64>>();
    let panels: [(&str, Vec<Curve<'_>>); 3] = [
        ("milliseconds per frame", vec![("latency", BLUE, of(|f| f.made.latency_ns as f64 * 1e-6))]),
        (
            "volume change, per cent",
            vec![("volume", ORANGE, of(|f| 100.0 * f.figures.volume_change.unwrap_or(f64::NAN)))],
        ),
        (
            "edge length over that at rest",
            vec![
                ("largest", ORANGE, of(|f| f.figures.stretch[2])),
                ("mean", BLUE, of(|f| f.figures.stretch[1])),
                ("smallest", GREEN, of(|f| f.figures.stretch[0])),
            ],
        ),
    ];
    let mut text = String::new();
    draw(&mut text, &panels).map_err(|error| {
        file::Fault::new(format!("cannot be drawn ({error})"), "leave --plot out").in_file(path)
    })?;
    file::write_atomically(path, |out| out.write_all(text.as_bytes()))
}

fn draw(text: &mut String, panels: &[(&str, Vec<Curve<'_>>)]) -> Result<(), Box<dyn std::error::Error>> {
    let area = SVGBackend::with_string(text, (900, 720)).into_drawing_area();
    area.fill(&WHITE)?;
    for (area, (title, curves)) in area.split_evenly((panels.len(), 1)).iter().zip(panels) {
        let values = || curves.iter().flat_map(|curve| &curve.2).copied().filter(|x| x.is_finite());
        let (low, high) = values().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(x), h.max(x)));
        let (low, high) = if low <= high { (low, high) } else { (0.0, 1.0) };
        let margin = (0.08 * (high - low)).max(1e-3 * high.abs()).max(1e-9);
        let last = curves.iter().map(|curve| curve.2.len()).max().unwrap_or(1).max(2) - 1;
        let mut chart = ChartBuilder::on(area)
            .caption(*title, ("sans-serif", 16))
            .margin(8)
            .x_label_area_size(28)
            .y_label_area_size(64)
            .build_cartesian_2d(0.0..last as f64, low - margin..high + margin)?;
        chart.configure_mesh().x_desc("frame").light_line_style(WHITE).draw()?;
        for (name, colour, values) in curves {
            let points = values.iter().enumerate().filter(|(_, x)| x.is_finite());
            let line = LineSeries::new(points.map(|(k, &x)| (k as f64, x)), colour.stroke_width(2));
            let colour = *colour;
            chart
                .draw_series(line)?
                .label(*name)
                .legend(move |(x, y)| PathElement::new([(x, y), (x + 16, y)], colour.stroke_width(2)));
        }
        if curves.len() > 1 {
            chart.configure_series_labels().background_style(WHITE.mix(0.8)).draw()?;
        }
    }
    area.present()?;
    Ok(())
}
