//! All cells in one table that sorts and filters.

use super::escape::escape;
use super::section;
use super::sections::division_name;
use crate::record::rate::{Rate, Share};
use crate::record::result::Cell;
use crate::report::numbers::{grouped, milliseconds, scientific, significant};
use crate::report::view::{View, interval_ms, steady};
use crate::report::wording::is_contended;
use std::fmt::Write;

/// Titles; those with a number sort by it.
const COLUMNS: [&str; 19] = [
    "mesh",
    "triangles",
    "workload",
    "solver",
    "thr",
    "settings",
    "precision",
    "status",
    "set-up ms",
    "median ms",
    "95% interval",
    "p99 ms",
    "per s",
    "1% low",
    "stutters",
    "60 Hz",
    "error",
    "MiB",
    "% read",
];

/// The table with its filter.
pub fn all_cells(view: &View<'_>) -> String {
    let head: String = COLUMNS
        .iter()
        .map(|name| format!("<th aria-sort=\"none\"><button type=\"button\">{}</button></th>", escape(name)))
        .collect();
    let rows: String = view.result.cells.iter().map(row).collect();
    let table = format!(
        "<div class=\"cells\"><p class=\"controls\"><label>Filter <input type=\"search\" placeholder=\"words: transfer framechol\"></label> \
         <label><input type=\"checkbox\" class=\"only-ok\"> only right answers</label> <output></output></p>\
         <div class=\"scroll\"><table class=\"sortable\"><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table></div></div>"
    );
    let lead = "Click a title to sort. The filter keeps rows that hold every word. 60 Hz: with the whole frame for the solver / with half of it. \
                \u{26a0}: disturbed by other work.";
    if view.result.cells.is_empty() { String::new() } else { section("All cells", lead, &table) }
}

fn row(cell: &Cell) -> String {
    let mut html = format!("<tr data-status=\"{}\">", cell.status.name());
    let steady = steady(cell);
    text(&mut html, &cell.mesh.name);
    number(&mut html, cell.mesh.triangles.map(|n| (n as f64, grouped(n as u64))));
    text(&mut html, &cell.workload);
    text(&mut html, &cell.backend);
    let threads = match cell.threads_used {
        Some(used) if used != cell.threads => format!("{used} of {}", cell.threads),
        _ => cell.threads.to_string(),
    };
    number(&mut html, Some((cell.threads as f64, threads)));
    text(&mut html, division_name(cell.division));
    text(&mut html, cell.precision.map_or("", |p| p.name()));
    let _ = write!(
        html,
        "<td class=\"status {}\" title=\"{}\">{}{}</td>",
        cell.status.name(),
        escape(cell.reason.as_deref().unwrap_or_default()),
        cell.status.name().replace('_', " "),
        if is_contended(cell) { " \u{26a0}" } else { "" }
    );
    let time = |ns: Option<u64>| ns.map(|ns| (ns as f64, milliseconds(ns)));
    number(&mut html, time(cell.phases_ns.set_up()));
    number(&mut html, time(steady.p50));
    let interval = interval_ms(cell)
        .map(|(low, high)| (high - low, format!("{}\u{2013}{}", significant(low), significant(high))));
    number(&mut html, interval);
    number(&mut html, time(steady.p99));
    number(&mut html, cell.frames_per_second.map(|fps| (fps, significant(fps))));
    number(&mut html, cell.low1_fps.map(|fps| (fps, significant(fps))));
    number(&mut html, cell.stutters.map(|n| (n as f64, n.to_string())));
    let tried = cell.open_loop.iter().any(|run| run.hz == 60.0);
    let rates = [Share::Whole, Share::Half].map(|share| Rate::of_cell(cell, 60.0, share).name());
    text(&mut html, &if tried { rates.join(" / ") } else { String::new() });
    let error = cell.accuracy.forward_error.or(cell.accuracy.backward_error);
    number(&mut html, error.map(|e| (e, scientific(e))));
    number(&mut html, cell.peak_rss_bytes.map(|b| (b as f64, (b >> 20).to_string())));
    number(&mut html, cell.bandwidth.fraction_of_read.map(|f| (f, format!("{:.0}", 100.0 * f))));
    html + "</tr>\n"
}

fn text(html: &mut String, words: &str) {
    let _ = write!(html, "<td>{}</td>", escape(words));
}

fn number(html: &mut String, value: Option<(f64, String)>) {
    let _ = match value {
        Some((key, words)) => write!(html, "<td class=\"n\" data-key=\"{key:e}\">{}</td>", escape(&words)),
        None => write!(html, "<td class=\"n\"></td>"),
    };
}
