//! What the cells mean for the exit code.

use crate::exit::Exit;
use crate::record::names::Status;
use crate::record::rate::{Rate, Share};
use crate::record::result::Cell;
use crate::report::rows::Rows;

/// Frames of an open-loop run that is to decide a rate: 299 without a miss bound the miss rate by 1%; twice as many leave
/// room for a miss.
pub const FRAMES: u32 = 600;

/// Wrong answers are 4, failures 1; what a backend declines to do is no failure.
pub fn of_statuses(cells: &[Cell]) -> Exit {
    let of = |cell: &Cell| match cell.status {
        Status::Invalid => Exit::Invalid,
        Status::Error | Status::Oom => Exit::Error,
        Status::Ok | Status::NotConverged | Status::Unavailable | Status::Unsupported | Status::Timeout => {
            Exit::Ok
        }
    };
    cells.iter().map(of).fold(Exit::Ok, Exit::or)
}

/// The prefixes of which no backend has a cell that is ok.
pub fn unmet<'a>(prefixes: &'a [String], cells: &[Cell]) -> Vec<&'a str> {
    let met = |prefix: &str| cells.iter().any(|c| c.status == Status::Ok && c.backend.starts_with(prefix));
    prefixes.iter().map(String::as_str).filter(|prefix| !met(prefix)).collect()
}

/// 3 where a cell misses the rate; 5 where one is undecided and `strict` asks for a statement. Cells that are not ok have no
/// frames and are judged by their status.
pub fn of_rate(cells: &[Cell], hz: f64, strict: bool) -> Exit {
    let of = |cell: &Cell| match Rate::of_cell(cell, hz, Share::Whole) {
        Rate::Met => Exit::Ok,
        Rate::Missed => Exit::Regression,
        Rate::Undecided if strict => Exit::Inconclusive,
        Rate::Undecided => Exit::Ok,
    };
    cells.iter().filter(|cell| cell.status == Status::Ok).map(of).fold(Exit::Ok, Exit::or)
}

/// The verdicts as a table: for the solver alone, and with half of every frame left to the application.
pub fn rows(cells: &[Cell], hz: f64) -> Rows {
    let titles = [format!("{hz} Hz, solver alone"), format!("{hz} Hz, half a frame")];
    let mut rows = Rows::new([
        "mesh",
        "workload",
        "backend",
        "thr",
        &titles[0],
        &titles[1],
        "frames",
        "late",
        "late by half",
    ]);
    for cell in cells {
        let run = cell.open_loop.iter().find(|run| run.hz == hz);
        let count = |n: Option<u64>| n.map_or_else(String::new, |n| n.to_string());
        rows.push([
            &cell.mesh.name,
            &cell.workload,
            &cell.backend,
            &cell.threads.to_string(),
            Rate::of_cell(cell, hz, Share::Whole).name(),
            Rate::of_cell(cell, hz, Share::Half).name(),
            &count(run.map(|run| run.frames)),
            &count(run.map(|run| run.misses)),
            &count(run.and_then(|run| run.half_misses)),
        ]);
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn statuses_and_requirements() {
        let cell = |backend: &str, status| Cell { backend: backend.into(), status, ..Cell::default() };
        let cells = [cell("vulkan-a", Status::Unavailable), cell("dense", Status::Ok)];
        assert_eq!(of_statuses(&cells), Exit::Ok);
        assert_eq!(unmet(&["vulkan".into(), "den".into()], &cells), ["vulkan"]);
        assert_eq!(of_statuses(&[cell("a", Status::Oom), cell("b", Status::Invalid)]), Exit::Invalid);
    }
}
