//! Cells that solve one right-hand side again and again.

use super::Running;
use super::process::read_block;
use crate::engine::array_file::ArrayFile;
use crate::engine::equations::Equations;
use crate::engine::protocol::{Iterated, Request, Timed};
use crate::engine::session::Failure;
use crate::engine::task::Solve;
use crate::engine::task::edits::FirstEdit;
use crate::record::names::Status;
use crate::record::result::{Convergence, Summary};
use std::time::{Duration, Instant};

impl Running<'_> {
    /// The first solve, checked; its time.
    pub(super) fn first_solve(&mut self, solve: &Solve) -> Result<u64, Failure> {
        let timed = self.solve(&solve.input, 0, 1)?;
        self.count(&timed);
        self.check_solution(solve)?;
        Ok(timed.samples_ns[0])
    }

    pub(super) fn steady_solves(&mut self, solve: &Solve, warmup: u32, times: u32) -> Result<(), Failure> {
        let timed = self.solve(&solve.input, warmup, times)?;
        self.count(&timed);
        self.keep(timed);
        self.check_solution(solve)
    }

    pub(super) fn solve(&mut self, input: &ArrayFile, warmup: u32, times: u32) -> Result<Timed, Failure> {
        let _ = std::fs::remove_file(&self.solution); // an old answer must not pass for a new one
        let (rhs, solution) = (input.clone(), self.solution.clone());
        let request = Request::Solve { rhs, warmup, times, solution };
        self.timed(request, times)
    }

    pub(super) fn read_solution(&self, solve: &Solve) -> Result<Vec<f64>, Failure> {
        read_block(&self.solution, solve.check.rows(), solve.check.columns())
    }

    pub(super) fn check_solution(&mut self, solve: &Solve) -> Result<(), Failure> {
        let x = self.read_solution(solve)?;
        if same_bits(&x, &self.verified) {
            return Ok(());
        }
        let convention = self.cell.details.get("convention").map(String::as_str);
        let checked = solve.check.solution(&x, &self.limits, convention);
        self.judge(checked)?;
        self.verified = x;
        Ok(())
    }

    /// New values for up to a quarter of the cell's time, unless that was done before.
    pub(super) fn updates(&mut self, solve: &Solve) -> Result<(), Failure> {
        if self.changes.is_empty() { self.updates_for(solve, self.settings.cell_time / 4) } else { Ok(()) }
    }

    /// New values and back again, at least once and for about `time`. The first answer with new values is checked, and the
    /// one after the last return.
    pub(super) fn updates_for(&mut self, solve: &Solve, time: Duration) -> Result<(), Failure> {
        let Some(update) = &solve.update else { return Ok(()) };
        let begin = Instant::now();
        while self.changes.is_empty() || begin.elapsed() < time {
            for values in [&update.new, &update.original] {
                let request = Request::Update { values: values.clone(), times: 1 };
                if !self.change("update", request)? {
                    return Ok(());
                }
                if self.changes.len() == 1 {
                    self.check_changed(solve, &update.equations, &solve.input)?;
                }
            }
        }
        self.cell.update_ns = Summary::of(&self.changes);
        self.solve(&solve.input, 0, 1)?;
        self.check_solution(solve)
    }

    /// Other constraints and back again, at least once and for about `time`; checked as [`updates_for`](Self::updates_for).
    pub(super) fn edits(&mut self, solve: &Solve, first: &FirstEdit, time: Duration) -> Result<(), Failure> {
        let begin = Instant::now();
        while self.changes.is_empty() || begin.elapsed() < time {
            for (add, remove) in
                [(&first.edit.add, &first.edit.remove), (&first.edit.remove, &first.edit.add)]
            {
                let request = Request::Edit { add: add.clone(), remove: remove.clone() };
                if !self.change("edit", request)? {
                    return Ok(());
                }
                if self.changes.len() == 1 {
                    self.check_changed(solve, &first.equations, &first.edit.input)?;
                }
            }
        }
        self.solve(&solve.input, 0, 1)?;
        self.check_solution(solve)
    }

    /// One change, its time kept; false where the solver does not do that.
    fn change(&mut self, what: &str, request: Request) -> Result<bool, Failure> {
        match self.timed(request, 1) {
            Ok(timed) => {
                self.changes.extend(timed.samples_ns);
                Ok(true)
            }
            Err(failure) if failure.status == Status::Unsupported => {
                self.cell.details.insert(what.into(), failure.reason);
                Ok(false)
            }
            Err(failure) => Err(failure),
        }
    }

    /// Solves after a change and checks the answer; a wrong one ends the cell.
    fn check_changed(
        &mut self,
        solve: &Solve,
        changed: &Equations,
        input: &ArrayFile,
    ) -> Result<(), Failure> {
        self.solve(input, 0, 1)?;
        let x = read_block(&self.solution, changed.rows(), changed.columns())?;
        let checked = solve.check.updated(changed, &x, &self.limits);
        match checked.faults.as_slice() {
            [] => Ok(()),
            [fault, ..] => Err(Failure::new(Status::Invalid, format!("after a change: {fault}"))),
        }
    }

    /// The course of the iterations of one more solve, where the solver tells.
    pub(super) fn convergence(&mut self, solve: &Solve) -> Result<(), Failure> {
        if !self.iterative {
            return Ok(());
        }
        match self.ask::<Iterated>(Request::Iterate { rhs: solve.input.clone() }) {
            Ok(Iterated { iterations, elapsed_ns, residuals }) => {
                self.cell.convergence = Convergence { iterations, elapsed_ns, residuals };
                Ok(())
            }
            // A peer may not know the request.
            Err(failure) if matches!(failure.status, Status::Unsupported | Status::Error) => Ok(()),
            Err(failure) => Err(failure),
        }
    }

    /// Frames on a schedule, at every rate of the settings.
    pub(super) fn open_loops(&mut self, input: &ArrayFile) -> Result<(), Failure> {
        let settings = self.settings;
        if settings.open_loop_time.is_zero() && settings.least_frames == 0 {
            return Ok(());
        }
        for &hz in &settings.rates {
            let wanted = (hz * settings.open_loop_time.as_secs_f64()) as u32;
            // One that is late at the median is late; that needs no long run.
            let hopeless = self.expected() as f64 > 1e9 / hz;
            let least =
                if hopeless { settings.least_frames.min(FRAMES_TO_MISS) } else { settings.least_frames };
            let frames = wanted.max(least).max(1);
            // A solver slower than the rate falls ever further behind; twice the time shows it well enough.
            let limit = Duration::from_secs_f64(2.0 * f64::from(frames) / hz);
            let input = input.clone();
            let request = Request::OpenLoop { hz, frames, limit_ns: limit.as_nanos() as u64, input };
            match self.ask_within::<Timed>(request, settings.cell_timeout + limit) {
                Ok(timed) => self.cell.open_loop.push(super::figures::open_loop(hz, &timed.samples_ns)),
                Err(failure) if failure.status == Status::Unsupported => return Ok(()),
                Err(failure) => return Err(failure),
            }
        }
        Ok(())
    }
}

/// Frames of a run at a rate that the median does not keep.
const FRAMES_TO_MISS: u32 = 30;

fn same_bits(a: &[f64], b: &[f64]) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a.to_bits() == b.to_bits())
}
