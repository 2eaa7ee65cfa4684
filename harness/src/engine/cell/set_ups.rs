//! Set-up and memory in several fresh processes: what a process did before must not be in their figures.

use super::Running;
use crate::engine::task::Goal;
use crate::record::result::{Cell, Phases, SetUp, Summary};
use std::time::Instant;

impl Running<'_> {
    /// Whether another fresh process is wanted: there are fewer than the settings ask for, and twice the cell's time is not
    /// used up, so that set-ups of minutes happen once.
    pub fn wants_another_set_up(&self) -> bool {
        let used = self.set_up_time;
        let fewer = self.cell.set_ups.len() < self.settings.set_ups as usize;
        self.is_live() && fewer && used < 2 * self.settings.cell_time
    }

    /// Opens, prepares and solves once in a second process, beside the first one, which is idle.
    pub fn set_up_again(&mut self) {
        let begin = Instant::now();
        let mut twin = self.twin();
        twin.begin();
        twin.end();
        self.set_up_time += begin.elapsed();
        if twin.cell.status != self.cell.status {
            self.cell.status = twin.cell.status;
            self.cell.reason = twin.cell.reason.map(|reason| format!("in another process: {reason}"));
            self.session = None;
            return;
        }
        self.cell.set_ups.append(&mut twin.cell.set_ups);
        self.cell.peak_rss_bytes = self.cell.peak_rss_bytes.max(twin.cell.peak_rss_bytes);
        self.summarise_set_ups();
    }

    /// The same cell, not begun, with files of its own.
    fn twin(&self) -> Self {
        let stem = self.solution.file_stem().unwrap_or_default().to_string_lossy();
        let Cell { mesh, workload, backend, division, threads, columns, .. } = self.cell.clone();
        let cell = Cell { mesh, workload, backend, division, threads, columns, ..Cell::default() };
        let mut twin = Self::fresh(
            self.task,
            self.settings,
            self.solver,
            cell,
            self.solution.with_file_name(format!("{stem}-again.f64")),
        );
        if let Goal::Solve(_) = self.task.goal {
            twin.verified.clone_from(&self.verified); // the same bits need no second check
        }
        twin
    }

    /// The phases of the process with the median set-up, and the spread over all.
    pub(super) fn summarise_set_ups(&mut self) {
        let mut sorted: Vec<SetUp> = self.cell.set_ups.clone();
        sorted.sort_by_key(SetUp::total_ns);
        let Phases { load, assemble, .. } = self.cell.phases_ns;
        let median = sorted[(sorted.len() - 1) / 2].phases_ns;
        self.cell.phases_ns = Phases { load, assemble, ..median };
        let totals: Vec<u64> = sorted.iter().filter_map(SetUp::total_ns).collect();
        self.cell.set_up_ns = Summary::of(&totals);
        self.cell.first_frame_ns = median.first_solve.map(|first| first + median.set_up().unwrap_or(0));
    }
}
