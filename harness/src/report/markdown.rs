//! A result as a short text with one table: solvers down, problems across.

use super::html::panel;
use super::numbers::{milliseconds, scientific};
use super::rows::Rows;
use super::view::{View, achieved_error, is_valid, steady};
use super::wording;
use crate::cmd::output::Format;
use crate::record::names::{Division, Status};
use crate::record::result::{Cell, ResultFile};
use crate::report::chart::dots::Dots;

/// What it was measured on, the table, and what is not in it.
pub fn markdown(name: &str, result: &ResultFile) -> String {
    let view = View::new(result);
    let f = &result.environment.fingerprint;
    let cpu = f.cpu.as_deref().unwrap_or("an unknown processor");
    let cores = f.logical_cores.map_or_else(String::new, |n| format!(", {n} hardware threads"));
    let date = result.environment.info.time.get(..10).unwrap_or("an unknown date");
    let mut text =
        format!("Measured on {cpu}{cores}, {date}, by `{}` ({name}).\n", result.command.replace('`', "'"));
    if !result.quotable {
        text += "Shortened run: not quotable.\n";
    }
    text += "\nTime of a solve (`transfer`, `arap`: of a whole frame) / set-up, in ms; medians; \u{2013}: not done by this solver, or no right answer. Settings: *tuned* for this work, or the library's *default*. \u{26a0}: other work ran at times; all solvers took turns, so ratios are fair, but the time may be too long.\n\n";
    text += &table(&view).render(Format::Markdown);
    let missing = missing(&view);
    if !missing.is_empty() {
        text += &format!("\nWithout a time: {}.\n", missing.join("; "));
    }
    text
}

/// Cells that should have had a right answer; what a solver does not do is no news.
fn missing(view: &View<'_>) -> Vec<String> {
    let absent =
        |cell: &&Cell| !matches!(cell.status, Status::Ok | Status::Unsupported | Status::Unavailable);
    let words = |cell: &Cell| {
        format!(
            "{} on {}, {} ({})",
            view.label(cell),
            cell.mesh.name,
            cell.workload,
            cell.status.name().replace('_', " ")
        )
    };
    view.result.cells.iter().filter(absent).map(words).collect()
}

fn table(view: &View<'_>) -> Rows {
    let header: Vec<String> = ["solver", "settings", "worst error"]
        .map(str::to_owned)
        .into_iter()
        .chain(view.groups.iter().map(|group| format!("{} {}", group.mesh.name, group.workload)))
        .collect();
    let mut rows: Vec<(f64, Vec<String>)> = Vec::new();
    for solver in &view.solvers {
        let cells: Vec<Option<&Cell>> = view
            .groups
            .iter()
            .map(|group| {
                group.cells.iter().copied().find(|cell| view.label(cell) == *solver && is_valid(cell))
            })
            .collect();
        let valid: Vec<&Cell> = cells.iter().flatten().copied().collect();
        let Some(first) = valid.first() else { continue };
        let settings = match first.division {
            Some(Division::Open) => "tuned",
            Some(Division::Closed) => "default",
            None => "",
        };
        let worst = valid.iter().filter_map(|cell| achieved_error(cell)).reduce(f64::max);
        let mut row = vec![solver.clone(), settings.to_owned(), worst.map_or_else(String::new, scientific)];
        row.extend(cells.iter().map(|cell| cell.map_or_else(|| "\u{2013}".into(), figures)));
        // Solvers with the most answers first, the faster ones before the slower ones.
        let mean = valid.iter().filter_map(|cell| steady(cell).p50).map(|ns| (ns as f64).ln()).sum::<f64>()
            / valid.len() as f64;
        rows.push((mean - 1e3 * valid.len() as f64, row));
    }
    rows.sort_by(|a, b| a.0.total_cmp(&b.0));
    Rows { header, rows: rows.into_iter().map(|(_, row)| row).collect() }
}

fn figures(cell: &Cell) -> String {
    let time = |ns: Option<u64>| ns.map_or_else(|| "\u{2013}".into(), milliseconds);
    let mark = if wording::is_contended(cell) { " \u{26a0}" } else { "" };
    format!("{} / {}{mark}", time(steady(cell).p50), time(cell.phases_ns.set_up()))
}

/// Every group's medians in one picture with a ground of its own.
pub fn picture(result: &ResultFile) -> String {
    let view = View::new(result);
    let panels =
        view.groups.iter().map(|group| panel(&view, group)).filter(|panel| !panel.dots.is_empty()).collect();
    let limits = super::html::display_rates();
    Dots { label: "ms per solve or frame".into(), panels, limits, ground: true }.svg()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::result::{Mesh, Summary};

    #[test]
    fn solvers_without_right_answers_are_named_below() {
        let cell = |backend: &str, status| Cell {
            mesh: Mesh { name: "m|n".into(), ..Mesh::default() },
            workload: "harmonic".into(),
            backend: backend.into(),
            status,
            complete: true,
            solve_ns: Summary::of(&[2_000_000; 7]),
            ..Cell::default()
        };
        let result = ResultFile {
            schema_version: "1.1".into(),
            command: "lapbench run".into(),
            quotable: true,
            environment: Default::default(),
            cells: vec![cell("a", Status::Ok), cell("b", Status::Invalid)],
        };
        let text = markdown("r.json", &result);
        assert!(text.contains("| a |  |  | 2.00 / \u{2013} |"), "{text}");
        assert!(text.contains("Without a time: b on m|n, harmonic (invalid)."), "{text}");
        assert!(picture(&result).contains("2.00 ms"));
    }
}
