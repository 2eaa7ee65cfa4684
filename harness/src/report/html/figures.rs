//! The pictures of the page, each with a legend and a way to read it.

use super::escape::escape;
use super::section;
use crate::record::result::Cell;
use crate::report::chart::axis::Axis;
use crate::report::chart::bars::{Bar, Bars};
use crate::report::chart::dots::{Dot, Dots, Panel};
use crate::report::chart::plot::{Plot, Series};
use crate::report::chart::style::{COLOURS, Shape, Style};
use crate::report::numbers::{grouped, milliseconds, significant};
use crate::report::view::{Group, View, achieved_error, interval_ms, is_valid, median_ms, steady};
use crate::report::wording::listed;
use crate::statistics::ranking::power_law;
use std::fmt::Write;

/// Pictures that are shown at once; further ones are folded away.
const SHOWN: usize = 4;

/// Rules that lighten the colours of series on a dark ground.
pub fn colours() -> String {
    let dark = ["#4DA6E0", "#FF8A3D", "#2CC79A", "#E3A1C6", "#E8B023", "#7CCBF5", "#A8A8A8"];
    let mut css = String::from("@media (prefers-color-scheme: dark) {\n");
    for (i, light) in dark.iter().enumerate() {
        let from = Style(i % COLOURS.len()).hexadecimal();
        let _ =
            writeln!(css, "svg [fill=\"{from}\"]{{fill:{light}}} svg [stroke=\"{from}\"]{{stroke:{light}}}");
    }
    css + "}\n"
}

fn figure(caption: &str, svg: &str, legend: &str, note: &str) -> String {
    format!(
        "<figure><figcaption>{}</figcaption><div class=\"scroll\">{svg}</div>{legend}<p class=\"note\">{}</p></figure>",
        escape(caption),
        escape(note)
    )
}

/// The figures of a section, the first of them shown, the others folded.
fn gallery(figures: Vec<String>) -> String {
    if figures.is_empty() {
        return String::new();
    }
    let (first, rest) = figures.split_at(figures.len().min(SHOWN));
    let mut html = format!("<div class=\"gallery\">{}</div>", first.concat());
    if !rest.is_empty() {
        let _ = write!(
            html,
            "<details><summary>{} more</summary><div class=\"gallery\">{}</div></details>",
            rest.len(),
            rest.concat()
        );
    }
    html
}

/// A legend of series by name.
fn legend<'a>(entries: impl Iterator<Item = (&'a str, Style)>) -> String {
    let items: String =
        entries.map(|(name, style)| format!("<li>{}{}</li>", swatch(style), escape(name))).collect();
    format!("<ul class=\"legend\">{items}</ul>")
}

fn swatch(style: Style) -> String {
    let colour = style.hexadecimal();
    let mark = match style.shape() {
        Shape::Disc => format!("<circle cx=\"7\" cy=\"7\" r=\"5\" fill=\"{colour}\"/>"),
        Shape::Ring => format!(
            "<circle cx=\"7\" cy=\"7\" r=\"4.5\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"2\"/>"
        ),
        Shape::Square => format!("<rect x=\"3\" y=\"3\" width=\"8\" height=\"8\" fill=\"{colour}\"/>"),
        Shape::Triangle => format!("<path d=\"M7 2 L12 12 L2 12 Z\" fill=\"{colour}\"/>"),
        Shape::Cross => format!(
            "<path d=\"M3 3 L11 11 M3 11 L11 3\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"2\"/>"
        ),
    };
    format!(
        "<svg class=\"swatch\" width=\"14\" height=\"14\" viewBox=\"0 0 14 14\" aria-hidden=\"true\">{mark}</svg>"
    )
}

fn names<'a>(view: &'a View<'_>, cells: &[&Cell]) -> Vec<(&'a str, Style)> {
    let drawn = |name: &&String| cells.iter().any(|cell| view.label(cell) == **name);
    view.solvers.iter().filter(drawn).map(|name| (name.as_str(), view.style(name))).collect()
}

/// Set-up in its phases.
pub fn phases(view: &View<'_>) -> String {
    const NAMES: [&str; 5] = ["order", "symbolic", "numeric", "upload", "first solve"];
    let figures = view.groups.iter().filter_map(|group| {
        let mut cells: Vec<&Cell> = group.valid().filter(|cell| cell.phases_ns.set_up().is_some()).collect();
        cells.sort_by_key(|cell| cell.first_frame_ns);
        let bars = cells.iter().map(|cell| {
            let p = &cell.phases_ns;
            let lengths = [p.order, p.symbolic, p.numeric, p.upload, p.first_solve];
            Bar {
                label: view.label(cell),
                parts: lengths
                    .iter()
                    .enumerate()
                    .map(|(i, ns)| (Style(i), ns.unwrap_or(0) as f64 * 1e-6))
                    .collect(),
                mark: None,
                note: cell.first_frame_ns.map_or_else(String::new, |ns| format!("{} ms", milliseconds(ns))),
            }
        });
        let bars =
            Bars { label: "ms from the matrix in memory to the first solution".into(), bars: bars.collect() };
        let squares: String = NAMES
            .iter()
            .enumerate()
            .map(|(i, name)| {
                format!(
                    "<li><span class=\"square\" style=\"background:{}\"></span>{name}</li>",
                    Style(i).hexadecimal()
                )
            })
            .collect();
        let once =
            |ns: Option<u64>| ns.map_or_else(|| "unknown".into(), |ns| format!("{} ms", milliseconds(ns)));
        let first = cells.first()?;
        let note = format!(
            "Once for all solvers: load {}, assemble {}.",
            once(first.phases_ns.load),
            once(first.phases_ns.assemble)
        );
        Some(figure(&group.title(), &bars.svg(), &format!("<ul class=\"legend\">{squares}</ul>"), &note))
    });
    let lead = "What has to happen before the first frame, in the fresh process with the median set-up time. A library that does all in one call shows \
                one part; &ldquo;order&rdquo; of CHOLMOD, Eigen and PARDISO includes their symbolic part.";
    section("Set-up", lead, &gallery(figures.collect()))
}

/// Time of a frame against the error of its answer.
pub fn accuracy(view: &View<'_>) -> String {
    let figures = view.groups.iter().filter_map(|group| {
        let point = |cell: &Cell| Some((achieved_error(cell)?.max(1e-17), median_ms(cell)?));
        let cells: Vec<&Cell> = group.valid().filter(|cell| point(cell).is_some()).collect();
        let points: Vec<(f64, f64)> = cells.iter().filter_map(|cell| point(cell)).collect();
        let series = cells.iter().zip(&points).map(|(cell, &point)| Series {
            style: view.style(&view.label(cell)),
            points: vec![point],
            line: false,
            marks: true,
        });
        let plot = Plot {
            x: Axis::logarithmic("achieved error (further left is better)", points.iter().map(|p| p.0)),
            y: Axis::logarithmic(group.unit(), points.iter().map(|p| p.1)),
            series: series.collect(),
            limits: Vec::new(),
        };
        (!points.is_empty())
            .then(|| figure(&group.title(), &plot.svg(), &legend(names(view, &cells).into_iter()), ""))
    });
    let lead = "Down and left is better: less time, less error. The error is the distance from a refined solution where that \
                can be certified, else the backward error.";
    section("Time against accuracy", lead, &gallery(figures.collect()))
}

/// Set-up plus n frames.
pub fn cost(view: &View<'_>) -> String {
    let figures = view.groups.iter().filter_map(|group| {
        let cells: Vec<&Cell> = group.valid().filter(|cell| line(cell).is_some()).collect();
        let counts: Vec<f64> = (0..=20).map(|i| 10f64.powf(f64::from(i) * 0.25)).collect();
        let points = |cell: &Cell| -> Vec<(f64, f64)> {
            let Some((set_up, each)) = line(cell) else { return Vec::new() };
            counts.iter().map(|&n| (n, (set_up + n * each) * 1e-3)).collect()
        };
        let series: Vec<Series> = cells
            .iter()
            .map(|cell| Series {
                style: view.style(&view.label(cell)),
                points: points(cell),
                line: true,
                marks: false,
            })
            .collect();
        let plot = Plot {
            x: Axis::logarithmic("frames", counts.iter().copied()),
            y: Axis::logarithmic(
                "seconds in all, set-up included",
                series.iter().flat_map(|s| &s.points).map(|p| p.1),
            ),
            series,
            limits: Vec::new(),
        };
        let entries = names(view, &cells);
        (!cells.is_empty()).then(|| {
            figure(&group.title(), &plot.svg(), &legend(entries.into_iter()), &crossover(view, &cells))
        })
    });
    let lead = "How long it takes to set up and do n frames. Where two lines cross, the cheaper set-up stops paying off.";
    section("Cost of n frames", lead, &gallery(figures.collect()))
}

/// Set-up and one frame, milliseconds.
fn line(cell: &Cell) -> Option<(f64, f64)> {
    Some((cell.phases_ns.set_up()? as f64 * 1e-6, median_ms(cell)?))
}

/// From how many frames on the best direct solver is ahead of the best iterative one.
fn crossover(view: &View<'_>, cells: &[&Cell]) -> String {
    let best = |iterative: bool| {
        let of_kind = cells.iter().filter(|cell| cell.tolerance.is_some() == iterative);
        of_kind.min_by(|a, b| median_ms(a).unwrap_or(f64::MAX).total_cmp(&median_ms(b).unwrap_or(f64::MAX)))
    };
    let (Some(direct), Some(iterative)) = (best(false), best(true)) else { return String::new() };
    let (Some((setup_d, each_d)), Some((setup_i, each_i))) = (line(direct), line(iterative)) else {
        return String::new();
    };
    let (d, i) = (view.label(direct), view.label(iterative));
    let n = (setup_d - setup_i) / (each_i - each_d);
    if each_d >= each_i && setup_d >= setup_i {
        format!("The iterative {i} is cheaper than the direct {d} at every number of frames.")
    } else if each_d <= each_i && n <= 1.0 {
        format!("The direct {d} is cheaper than the iterative {i} from the first frame on.")
    } else if each_d < each_i {
        format!(
            "The direct {d} is cheaper than the iterative {i} from {} frames on.",
            grouped(n.ceil() as u64)
        )
    } else {
        format!(
            "The iterative {i} is cheaper than the direct {d} from {} frames on.",
            grouped(n.ceil() as u64)
        )
    }
}

/// Time against the number of triangles.
pub fn scaling(view: &View<'_>) -> String {
    let figures = view.workloads().into_iter().filter_map(|workload| {
        let groups: Vec<&Group<'_>> = view.groups.iter().filter(|g| g.workload == workload).collect();
        let mut series = Vec::new();
        let mut slopes = Vec::new();
        let mut cells: Vec<&Cell> = Vec::new();
        for name in &view.solvers {
            let of_solver: Vec<&Cell> =
                groups.iter().flat_map(|g| g.valid()).filter(|c| view.label(c) == *name).collect();
            let mut points: Vec<(f64, f64)> =
                of_solver.iter().filter_map(|c| Some((c.mesh.triangles? as f64, median_ms(c)?))).collect();
            points.sort_by(|a, b| a.0.total_cmp(&b.0));
            let Some((slope, _)) = power_law(&points) else { continue };
            slopes.push(format!("{name} {slope:.2}"));
            series.push(Series { style: view.style(name), points, line: true, marks: true });
            cells.extend(of_solver);
        }
        let all = || series.iter().flat_map(|s: &Series| &s.points);
        let plot = Plot {
            x: Axis::logarithmic("triangles", all().map(|p| p.0)),
            y: Axis::logarithmic(groups.first()?.unit(), all().map(|p| p.1)),
            series: series.clone(),
            limits: Vec::new(),
        };
        let note = format!("Slopes (time grows as triangles to this power): {}.", listed(&slopes));
        (!series.is_empty())
            .then(|| figure(workload, &plot.svg(), &legend(names(view, &cells).into_iter()), &note))
    });
    let lead = "Straight lines on logarithmic axes are powers of the size; their slopes come from least squares. Meshes differ in more than size.";
    section("Scaling", lead, &gallery(figures.collect()))
}

/// Time per column against the number of columns.
pub fn columns(view: &View<'_>) -> String {
    let figures = view.groups.iter().filter_map(|group| {
        let cells: Vec<&Cell> = group.valid().filter(|cell| cell.column_sweep.len() > 1).collect();
        let points = |cell: &Cell| -> Vec<(f64, f64)> {
            let point = |run: &crate::record::result::ColumnsRun| {
                let columns = run.columns as f64;
                Some((columns, run.solve_ns.p50? as f64 * 1e-6 / columns))
            };
            cell.column_sweep.iter().filter_map(point).collect()
        };
        let series: Vec<Series> = cells
            .iter()
            .map(|cell| Series {
                style: view.style(&view.label(cell)),
                points: points(cell),
                line: true,
                marks: true,
            })
            .collect();
        let all = || series.iter().flat_map(|s| &s.points);
        let plot = Plot {
            x: Axis::logarithmic("columns of the right-hand side", all().map(|p| p.0)),
            y: Axis::logarithmic("ms per column", all().map(|p| p.1)),
            series: series.clone(),
            limits: Vec::new(),
        };
        (!cells.is_empty())
            .then(|| figure(&group.title(), &plot.svg(), &legend(names(view, &cells).into_iter()), ""))
    });
    let lead = "Several right-hand sides at once share one pass over the factor: the time per column falls until arithmetic decides.";
    section("Columns", lead, &gallery(figures.collect()))
}

/// Peak memory of the cell's process.
pub fn memory(view: &View<'_>) -> String {
    let figures = view.groups.iter().filter_map(|group| {
        let mut cells: Vec<&Cell> = group.valid().filter(|cell| cell.peak_rss_bytes.is_some()).collect();
        cells.sort_by_key(|cell| cell.peak_rss_bytes);
        let mebibytes = |bytes: u64| bytes as f64 / f64::from(1 << 20);
        let bars = cells.iter().map(|cell| {
            let peak = mebibytes(cell.peak_rss_bytes.unwrap_or(0));
            let factor = cell.factor.bytes.map_or(0.0, mebibytes).min(peak);
            Bar {
                label: view.label(cell),
                parts: vec![(Style(0), factor), (Style(6), peak - factor)],
                mark: None,
                note: format!("{} MiB", significant(peak)),
            }
        });
        let bars = Bars { label: "MiB, peak of the process".into(), bars: bars.collect() };
        let legend = format!(
            "<ul class=\"legend\"><li><span class=\"square\" style=\"background:{}\"></span>factor</li><li><span class=\"square\" \
             style=\"background:{}\"></span>everything else (Python and its libraries included)</li></ul>",
            Style(0).hexadecimal(),
            Style(6).hexadecimal()
        );
        (!cells.is_empty()).then(|| figure(&group.title(), &bars.svg(), &legend, ""))
    });
    section("Memory", "The largest resident memory of the cell's own process.", &gallery(figures.collect()))
}

/// Bytes per second of a solve against what the memory gives.
pub fn bandwidth(view: &View<'_>) -> String {
    let figures = view.groups.iter().filter_map(|group| {
        let mut cells: Vec<&Cell> = group.valid().filter(|cell| cell.bandwidth.gb_per_s.is_some()).collect();
        cells.sort_by(|a, b| {
            b.bandwidth
                .fraction_of_read
                .unwrap_or(0.0)
                .total_cmp(&a.bandwidth.fraction_of_read.unwrap_or(0.0))
        });
        let bars = cells.iter().map(|cell| Bar {
            label: view.label(cell),
            parts: vec![(view.style(&view.label(cell)), cell.bandwidth.gb_per_s.unwrap_or(0.0))],
            mark: cell.bandwidth.read_gb_per_s,
            note: cell.bandwidth.fraction_of_read.map_or_else(String::new, |f| format!("{:.0}%", 100.0 * f)),
        });
        let bars = Bars { label: "GB/s of matrix and factor".into(), bars: bars.collect() };
        (!cells.is_empty()).then(|| figure(&group.title(), &bars.svg(), "", ""))
    });
    let lead = "A steady solve reads its factor and does little with each number, so reading is its limit. The line across each bar is what reading alone \
                reaches here: measured between the rounds, with as many threads, on an array of the factor's size. Solvers that do not tell \
                what they read are absent.";
    section("Bandwidth", lead, &gallery(figures.collect()))
}

/// Medians with intervals, and how often a frame takes longer than x.
pub fn latency(view: &View<'_>) -> String {
    let figures = view.groups.iter().flat_map(|group| [medians(view, group), tails(view, group)]).flatten();
    let lead = "Left: the median of every solver with its 95% interval; the lines are one frame at 60, 90 and 120 Hz. Right: the share of frames that take \
                longer than a time, back to back; a curve that falls late has stutters.";
    section("Times of single frames", lead, &gallery(figures.collect()))
}

/// One frame at the rates of displays, milliseconds.
pub fn display_rates() -> Vec<(f64, String)> {
    [60.0, 120.0].map(|hz| (1e3 / hz, format!("{hz} Hz"))).to_vec()
}

/// The medians of a group as dots, fastest first.
pub fn panel(view: &View<'_>, group: &Group<'_>) -> Panel {
    let mut cells: Vec<&Cell> = group.valid().collect();
    cells.sort_by_key(|cell| steady(cell).p50);
    let dots = cells.iter().filter_map(|cell| {
        let label = view.label(cell);
        Some(Dot {
            style: view.style(&label),
            label,
            value: median_ms(cell)?,
            interval: interval_ms(cell),
            note: format!("{} ms", milliseconds(steady(cell).p50?)),
        })
    });
    Panel { title: group.title(), dots: dots.collect() }
}

fn medians(view: &View<'_>, group: &Group<'_>) -> Option<String> {
    let panel = Panel { title: String::new(), ..panel(view, group) };
    if panel.dots.is_empty() {
        return None;
    }
    let dots =
        Dots { label: group.unit().into(), panels: vec![panel], limits: display_rates(), ground: false };
    Some(figure(&group.title(), &dots.svg(), "", ""))
}

fn tails(view: &View<'_>, group: &Group<'_>) -> Option<String> {
    let cells: Vec<&Cell> =
        group.cells.iter().copied().filter(|c| is_valid(c) && c.samples_ns.len() >= 20).collect();
    let series: Vec<Series> = cells
        .iter()
        .map(|cell| Series {
            style: view.style(&view.label(cell)),
            points: exceedance(&cell.samples_ns),
            line: true,
            marks: false,
        })
        .collect();
    let all = || series.iter().flat_map(|s| &s.points);
    let plot = Plot {
        x: Axis::logarithmic("ms", all().map(|p| p.0)),
        y: Axis::logarithmic("share of frames that take longer", all().map(|p| p.1)),
        series: series.clone(),
        limits: display_rates(),
    };
    (!cells.is_empty())
        .then(|| figure(&group.title(), &plot.svg(), &legend(names(view, &cells).into_iter()), ""))
}

/// Times and the share of samples above them, thinned to what a picture can show.
fn exceedance(samples: &[u64]) -> Vec<(f64, f64)> {
    const POINTS: usize = 120;
    let mut sorted = samples.to_vec();
    sorted.sort_unstable();
    let n = sorted.len();
    // Even steps in the logarithm of the share: the tail is what matters.
    let share = |i: usize| (n as f64).powf(-(i as f64) / (POINTS - 1) as f64);
    let mut ranks: Vec<usize> =
        (0..POINTS).map(|i| (share(i) * n as f64).round().max(1.0) as usize).collect();
    ranks.dedup();
    ranks.iter().map(|&above| (sorted[n - above] as f64 * 1e-6, above as f64 / n as f64)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_tail_keeps_its_last_samples() {
        let samples: Vec<u64> = (1..=10_000u64).map(|i| i * 1_000_000).collect();
        let points = exceedance(&samples);
        assert!(points.len() <= 120);
        assert_eq!(points[0], (1.0, 1.0));
        assert_eq!(points[points.len() - 1], (10_000.0, 1e-4));
        assert!(points.windows(2).all(|pair| pair[0].0 < pair[1].0 && pair[0].1 > pair[1].1));
    }
}
