//! Cells that solve one right-hand side again and again.

use super::Running;
use super::process::read_block;
use crate::engine::array_file::ArrayFile;
use crate::engine::protocol::{Request, Timed};
use crate::engine::session::Failure;
use crate::engine::task::Solve;
use crate::record::names::Status;
use crate::record::result::Summary;
use std::time::{Duration, Instant};

impl Running<'_> {
    /// The first solve, checked; its time.
    pub(super) fn first_solve(&mut self, solve: &Solve) -> Result<u64, Failure> {
        let timed = self.solve(solve, 0, 1)?;
        self.count(&timed);
        self.check_solution(solve)?;
        Ok(timed.samples_ns[0])
    }

    pub(super) fn steady_solves(&mut self, solve: &Solve, warmup: u32, times: u32) -> Result<(), Failure> {
        let timed = self.solve(solve, warmup, times)?;
        self.count(&timed);
        self.samples.extend(&timed.samples_ns);
        self.check_solution(solve)
    }

    fn solve(&mut self, solve: &Solve, warmup: u32, times: u32) -> Result<Timed, Failure> {
        let _ = std::fs::remove_file(&self.solution); // an old answer must not pass for a new one
        let request =
            Request::Solve { rhs: solve.input.clone(), warmup, times, solution: self.solution.clone() };
        self.timed(request, times)
    }

    pub(super) fn read_solution(&self, solve: &Solve) -> Result<Vec<f64>, Failure> {
        let equations = &solve.check.equations;
        read_block(&self.solution, equations.rows(), equations.columns())
    }

    pub(super) fn check_solution(&mut self, solve: &Solve) -> Result<(), Failure> {
        let x = self.read_solution(solve)?;
        if same_bits(&x, &self.verified) {
            return Ok(());
        }
        let checked = solve.check.solution(&x, &self.limits);
        self.judge(checked)?;
        self.verified = x;
        Ok(())
    }

    /// New values and back again, at least once and for up to a quarter of the cell's time. The first answer with new values
    /// is checked, and the one after the last return.
    pub(super) fn updates(&mut self, solve: &Solve) -> Result<(), Failure> {
        let Some(update) = &solve.update else { return Ok(()) };
        let mut samples = Vec::new();
        let begin = Instant::now();
        while samples.is_empty() || begin.elapsed() < self.settings.cell_time / 4 {
            for values in [&update.new, &update.original] {
                let request = Request::Update { values: values.clone(), times: 1 };
                match self.timed(request, 1) {
                    Ok(timed) => samples.extend(timed.samples_ns),
                    Err(failure) if failure.status == Status::Unsupported => {
                        self.cell.details.insert("update".into(), failure.reason);
                        return Ok(());
                    }
                    Err(failure) => return Err(failure),
                }
                if samples.len() == 1 {
                    self.solve(solve, 0, 1)?;
                    let x = self.read_solution(solve)?;
                    let checked = solve.check.updated(&update.equations, &x, &self.limits);
                    if let [fault, ..] = checked.faults.as_slice() {
                        return Err(Failure::new(Status::Invalid, format!("after new values: {fault}")));
                    }
                }
            }
        }
        self.solve(solve, 0, 1)?;
        self.check_solution(solve)?;
        self.cell.update_ns = Summary::of(&samples);
        Ok(())
    }

    /// Frames on a schedule, at every rate of the settings.
    pub(super) fn open_loops(&mut self, input: &ArrayFile) -> Result<(), Failure> {
        let settings = self.settings;
        if settings.open_loop_time.is_zero() && settings.least_frames == 0 {
            return Ok(());
        }
        for &hz in &settings.rates {
            let wanted = (hz * settings.open_loop_time.as_secs_f64()) as u32;
            let frames = wanted.max(settings.least_frames).max(1);
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

fn same_bits(a: &[f64], b: &[f64]) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a.to_bits() == b.to_bits())
}
