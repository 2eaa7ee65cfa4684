//! Cells whose constraints move in every repetition.

use super::Running;
use crate::engine::protocol::Request;
use crate::engine::session::Failure;
use crate::engine::task::Solve;
use crate::engine::task::edits::{Edit, Edits};
use crate::record::names::Status;
use std::time::Instant;

impl Running<'_> {
    /// The next edits, each with a solve, for `slice` nanoseconds; the last field is checked by its residual. Edits come in
    /// whole cycles of cheap and expensive ones only over many steps, so all of them count, the first too.
    pub(super) fn steady_edits(&mut self, solve: &Solve, edits: &Edits, slice: u64) -> Result<(), Failure> {
        let begin = Instant::now();
        while {
            self.edit(edits)?;
            (begin.elapsed().as_nanos() as u64) < slice
        } {}
        let wrong = |error: &dyn std::fmt::Display| Failure::new(Status::Error, format!("{error}"));
        let equations = edits.equations(self.next_frame).map_err(|error| wrong(&error))?;
        let x = self.read_solution(solve)?;
        let checked = solve.check.updated(&equations, &x, &self.limits);
        self.judge(checked)
    }

    /// Goes on to the default constraints and holds that field against the reference solution too.
    pub(super) fn last_edits(&mut self, solve: &Solve, edits: &Edits) -> Result<(), Failure> {
        while !self.next_frame.is_multiple_of(edits.period()) {
            self.edit(edits)?;
        }
        self.check_solution(solve)
    }

    /// The next edit and its solve; one sample for both together.
    fn edit(&mut self, edits: &Edits) -> Result<(), Failure> {
        let Edit { add, remove, input } = edits
            .write(self.next_frame, &self.solution)
            .map_err(|error| Failure::new(Status::Error, format!("cannot write an edit: {error}")))?;
        let edited = self.timed(Request::Edit { add, remove }, 1)?;
        let solved = self.solve(&input, 0, 1)?;
        self.next_frame += 1;
        self.cell.iterations = solved.iterations;
        self.samples
            .extend(edited.samples_ns.iter().zip(&solved.samples_ns).map(|(edit, solve)| edit + solve));
        Ok(())
    }
}
