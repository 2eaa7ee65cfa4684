//! What the cells mean for the exit code.

use crate::exit::Exit;
use crate::record::names::Status;
use crate::record::result::{Cell, OpenLoop};
use crate::report::rows::Rows;

/// Frames of an open-loop run that is to decide a rate: 299 without a miss bound the miss rate by 1%; twice as many leave
/// room for a miss.
pub const FRAMES: u32 = 600;

/// Largest share of late frames of a cell that is said to keep a rate.
const LATE: f64 = 0.01;

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

/// Whether a cell keeps a rate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rate {
    /// With 95% confidence at most 1% of its frames are late.
    Met,
    /// With 95% confidence more are.
    Missed,
    /// The frames do not decide it, or there are none.
    Undecided,
}

impl Rate {
    /// The verdict on one open-loop run.
    fn of(run: Option<&OpenLoop>) -> Self {
        match run {
            Some(run) if run.frames > 0 && run.miss_upper95 <= LATE => Rate::Met,
            Some(run) if run.miss_lower95 > LATE => Rate::Missed,
            _ => Rate::Undecided,
        }
    }

    fn name(self) -> &'static str {
        match self {
            Rate::Met => "met",
            Rate::Missed => "missed",
            Rate::Undecided => "undecided",
        }
    }
}

fn rate(cell: &Cell, hz: f64) -> Rate {
    Rate::of(cell.open_loop.iter().find(|run| run.hz == hz))
}

/// 3 where a cell misses the rate; 5 where one is undecided and `strict` asks for a statement. Cells that are not ok have no
/// frames and are judged by their status.
pub fn of_rate(cells: &[Cell], hz: f64, strict: bool) -> Exit {
    let of = |cell: &Cell| match rate(cell, hz) {
        Rate::Met => Exit::Ok,
        Rate::Missed => Exit::Regression,
        Rate::Undecided if strict => Exit::Inconclusive,
        Rate::Undecided => Exit::Ok,
    };
    cells.iter().filter(|cell| cell.status == Status::Ok).map(of).fold(Exit::Ok, Exit::or)
}

/// The verdicts as a table. The whole period belongs to the solver here; an application needs its own share of it.
pub fn rows(cells: &[Cell], hz: f64) -> Rows {
    let title = format!("{hz} Hz, solver alone");
    let mut rows = Rows::new(["mesh", "workload", "backend", &title, "frames", "late"]);
    for cell in cells {
        let run = cell.open_loop.iter().find(|run| run.hz == hz);
        let count = |n: Option<u64>| n.map_or_else(String::new, |n| n.to_string());
        rows.push([
            &cell.mesh.name,
            &cell.workload,
            &cell.backend,
            rate(cell, hz).name(),
            &count(run.map(|run| run.frames)),
            &count(run.map(|run| run.misses)),
        ]);
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::statistics::binomial;

    fn run(misses: u64, frames: u64) -> OpenLoop {
        OpenLoop {
            hz: 60.0,
            frames,
            misses,
            miss_upper95: binomial::upper_bound(misses, frames, 0.95),
            miss_lower95: binomial::lower_bound(misses, frames, 0.95),
            ..OpenLoop::default()
        }
    }

    #[test]
    fn rates_are_met_missed_or_undecided() {
        assert_eq!(Rate::of(Some(&run(0, 299))), Rate::Met);
        assert_eq!(Rate::of(Some(&run(0, 298))), Rate::Undecided);
        assert_eq!(Rate::of(Some(&run(1, 600))), Rate::Met);
        assert_eq!(Rate::of(Some(&run(30, 600))), Rate::Missed);
        assert_eq!((Rate::of(None), Rate::of(Some(&run(0, 0)))), (Rate::Undecided, Rate::Undecided));
    }

    #[test]
    fn statuses_and_requirements() {
        let cell = |backend: &str, status| Cell { backend: backend.into(), status, ..Cell::default() };
        let cells = [cell("vulkan-a", Status::Unavailable), cell("dense", Status::Ok)];
        assert_eq!(of_statuses(&cells), Exit::Ok);
        assert_eq!(unmet(&["vulkan".into(), "den".into()], &cells), ["vulkan"]);
        assert_eq!(of_statuses(&[cell("a", Status::Oom), cell("b", Status::Invalid)]), Exit::Invalid);
    }
}
