//! Series as one SVG: a panel for each, changes marked.

use super::series::{Figure, Series};
use anyhow::anyhow;
use plotters::prelude::*;
use std::fmt::Display;

/// Size of a panel, pixels.
const PANEL: (u32, u32) = (480, 220);

/// Panels side by side.
const ACROSS: usize = 2;

/// Most panels: a picture beyond a hundred is not looked at.
const MOST: usize = 100;

/// Blue and vermilion of Okabe and Ito's palette, told apart by every kind of colour vision.
const LINE: RGBColor = RGBColor(0, 114, 178);
const MARK: RGBColor = RGBColor(213, 94, 0);

/// The picture as SVG text.
///
/// # Errors
/// Where there is nothing to draw.
pub fn svg(series: &[Series], figure: Figure) -> anyhow::Result<String> {
    let shown = &series[..series.len().min(MOST)];
    if shown.is_empty() {
        return Err(anyhow!("there is no series to draw"));
    }
    let rows = shown.len().div_ceil(ACROSS);
    let across = shown.len().min(ACROSS);
    let size = (PANEL.0 * across as u32, PANEL.1 * rows as u32);
    let mut text = String::new();
    {
        let area = SVGBackend::with_string(&mut text, size).into_drawing_area();
        area.fill(&WHITE).map_err(failed)?;
        for (panel, series) in area.split_evenly((rows, across)).iter().zip(shown) {
            draw(panel, series, figure)?;
        }
        area.present().map_err(failed)?;
    }
    Ok(text)
}

fn failed(error: impl Display) -> anyhow::Error {
    anyhow!("the picture cannot be drawn: {error}")
}

fn draw(
    panel: &DrawingArea<SVGBackend<'_>, plotters::coord::Shift>,
    series: &Series,
    figure: Figure,
) -> anyhow::Result<()> {
    let values: Vec<f64> = series.points.iter().map(|p| p.value).collect();
    let highest = values.iter().copied().fold(0.0, f64::max) * 1.1; // from 0, so that heights are proportions
    let last = values.len().max(2) - 1;
    let title = format!("{} {} {} ({} thr.)", series.mesh, series.workload, series.backend, series.threads);
    let mut chart = ChartBuilder::on(panel)
        .caption(title, ("sans-serif", 14))
        .margin(8)
        .x_label_area_size(24)
        .y_label_area_size(52)
        .build_cartesian_2d(0f64..last as f64, 0f64..highest)
        .map_err(failed)?;
    let day = |x: &f64| {
        let point = series.points.get(x.round() as usize);
        point.map_or_else(String::new, |p| p.time.chars().take(10).collect())
    };
    chart
        .configure_mesh()
        .disable_x_mesh()
        .x_labels(4)
        .y_labels(5)
        .x_label_formatter(&day)
        .y_desc(figure.unit())
        .light_line_style(WHITE)
        .draw()
        .map_err(failed)?;
    let points = values.iter().enumerate().map(|(i, &v)| (i as f64, v));
    chart.draw_series(LineSeries::new(points.clone(), &LINE)).map_err(failed)?;
    chart.draw_series(points.map(|at| Circle::new(at, 2, LINE.filled()))).map_err(failed)?;
    for change in &series.changes {
        let x = change.at as f64 - 0.5;
        let line = PathElement::new(vec![(x, 0.0), (x, highest)], MARK.stroke_width(2));
        chart.draw_series([line]).map_err(failed)?;
        let label = Text::new(
            format!("x{:.2}", change.ratio),
            (x, highest),
            ("sans-serif", 12).into_font().color(&MARK),
        );
        chart.draw_series([label]).map_err(failed)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trend::series::{series, tests::result};

    #[test]
    fn hostile_names_are_text_and_changes_are_drawn() {
        let results: Vec<_> = (1..=20)
            .map(|day| {
                let mut result = result(day, if day < 11 { 1_000_000 } else { 2_000_000 }, "x");
                result.1.cells[0].mesh.name = "<script>\"&".into();
                result
            })
            .collect();
        let found = series(&results, Figure::Solve, 0.01);
        let picture = svg(&found, Figure::Solve).unwrap();
        assert!(picture.starts_with("<svg") && picture.trim_end().ends_with("</svg>"));
        assert!(!picture.contains("<script>") && picture.contains("&lt;script&gt;"), "names are escaped");
        assert!(picture.contains("x2.00") && picture.matches("<circle").count() == 20, "{picture}");
    }

    #[test]
    fn a_single_point_is_a_picture_and_nothing_is_none() {
        let found = series(&[result(1, 5, "x")], Figure::Solve, 0.01);
        assert!(svg(&found, Figure::Solve).is_ok());
        assert!(svg(&[], Figure::Solve).is_err());
    }
}
