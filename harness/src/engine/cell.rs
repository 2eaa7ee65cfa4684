//! One cell while it is measured: its process, its samples, its row.

use super::bandwidth;
use super::protocol::{Described, Memory, Prepared, Request, Timed, VERSION};
use super::session::{Failure, Session};
use super::settings::Settings;
use super::solver::Solver;
use super::source::Source;
use super::task::Task;
use crate::record::names::{Accuracy as Class, Status};
use crate::record::result::{Bandwidth, Cell, Factor, OpenLoop, Phases, Summary};
use crate::statistics::{binomial, frames, percentiles};
use crate::verify::solution::Checked;
use lapsolve::limits::Limits;
use serde::de::DeserializeOwned;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// A cell in the making. Whatever happens to its process becomes its status; no method fails.
pub struct Running<'a> {
    task: &'a Task,
    settings: &'a Settings,
    solver: &'a Solver,
    cell: Cell,
    session: Option<Session>,
    limits: Limits,
    iterative: bool,
    solution: PathBuf,
    /// The last solution that passed every check: the same bits need no second one.
    verified: Vec<f64>,
    samples: Vec<u64>,
    allocations: Option<u64>,
    repetitions: u64,
    /// Bytes a solve (direct) or an iteration reads, as the solver says.
    bytes: Option<u64>,
    read_rates: Vec<f64>,
}

/// Most solves in one request: with more, a stalled child would be noticed late.
const MOST_SOLVES: u64 = 10_000;

impl<'a> Running<'a> {
    /// A cell that has not begun; `index` tells its files from those of other cells of the task.
    pub fn new(
        task: &'a Task,
        source: &Source,
        solver: &'a Solver,
        threads: usize,
        settings: &'a Settings,
        index: usize,
    ) -> Self {
        let cell = Cell {
            mesh: source.record.clone(),
            workload: task.workload.name().to_owned(),
            backend: solver.name().to_owned(),
            threads,
            columns: Some(task.check.equations.columns()),
            phases_ns: Phases {
                load: Some(source.load_ns),
                assemble: Some(task.assemble_ns),
                ..Phases::default()
            },
            ..Cell::default()
        };
        // Replaced by those of the class that the solver declares, before anything is checked.
        let limits = Limits::of(
            lapsolve::registry::Precision::F64,
            lapsolve::registry::Accuracy::Direct,
            settings.tolerance,
        );
        Self {
            task,
            settings,
            solver,
            cell,
            session: None,
            limits,
            iterative: false,
            solution: task.solution_path(index),
            verified: Vec::new(),
            samples: Vec::new(),
            allocations: None,
            repetitions: 0,
            bytes: None,
            read_rates: Vec::new(),
        }
    }

    /// Starts the process, prepares, solves once and checks the answer.
    pub fn begin(&mut self) {
        self.cell.status = Status::Ok;
        let outcome = self.open().and_then(|()| self.prepare()).and_then(|()| self.first_solve());
        self.settle(outcome);
    }

    /// A slice of steady solves, the last answer checked.
    pub fn round(&mut self) {
        let slice = self.settings.slice().as_nanos() as u64;
        let expected = self.expected().max(1);
        let times = (slice / expected).clamp(1, MOST_SOLVES) as u32;
        // Other processes had the caches in the meantime; where there is time, a solve warms them up again.
        let warmup = u32::from(2 * expected <= slice);
        let outcome = self.solve(warmup, times).and_then(|timed| {
            self.samples.extend(&timed.samples_ns);
            self.check_solution()
        });
        self.settle(outcome);
    }

    /// Measures the read bandwidth at the factor's size, in this process, for comparison.
    pub fn measure_bandwidth(&mut self) {
        let Some(bytes) = self.cell.factor.bytes else { return };
        self.read_rates.extend(bandwidth::read_bandwidth(bytes, self.cell.threads));
    }

    /// What comes after the rounds: updates, open-loop frames, peak memory. Ends the process.
    pub fn finish(&mut self) {
        if self.is_live() {
            let outcome = self.updates().and_then(|()| self.open_loops()).and_then(|()| self.memory());
            self.settle(outcome);
        }
        if let Some(session) = self.session.take() {
            session.quit();
        }
        self.cell.complete = true;
    }

    /// Whether the process still runs and has only given right answers.
    pub fn is_live(&self) -> bool {
        self.session.is_some()
    }

    /// Ends the process; the last solution that passed every check.
    pub fn into_solution(mut self) -> Option<Vec<f64>> {
        if let Some(session) = self.session.take() {
            session.quit();
        }
        (self.cell.status == Status::Ok).then_some(self.verified)
    }

    /// Peak resident memory so far, bytes.
    pub fn peak_bytes(&self) -> Option<u64> {
        self.cell.peak_rss_bytes
    }

    /// The row with what is known so far.
    pub fn row(&self) -> Cell {
        let mut cell = self.cell.clone();
        let summary = Summary::of(&self.samples);
        cell.solve_ns = summary;
        cell.frames_per_second = summary.p50.and_then(frames::frames_per_second);
        cell.low1_fps = frames::low1_fps(&self.samples);
        cell.stutters = (!self.samples.is_empty()).then(|| frames::stutters(&self.samples));
        cell.samples_ns = self.samples.clone();
        cell.allocations_per_frame =
            self.allocations.filter(|_| self.repetitions > 0).map(|a| a as f64 / self.repetitions as f64);
        cell.bandwidth = self.traffic(summary.p50);
        if cell.status == Status::Invalid {
            cell.without_times();
        }
        cell
    }

    fn ask<T: DeserializeOwned>(&mut self, request: Request) -> Result<T, Failure> {
        let deadline = self.settings.cell_timeout;
        match &mut self.session {
            Some(session) => session.ask(request, deadline),
            None => Err(Failure::new(Status::Error, "its process has ended")),
        }
    }

    /// Takes over a failure and ends the process.
    fn settle(&mut self, outcome: Result<(), Failure>) {
        if let Err(failure) = outcome {
            self.cell.status = failure.status;
            self.cell.reason = Some(failure.reason);
            self.session = None;
        }
    }

    fn open(&mut self) -> Result<(), Failure> {
        let command = self.solver.command(self.cell.threads, self.settings.memory_limit)?;
        self.session = Some(Session::start(command)?);
        let described: Described = self.ask(Request::Describe {
            protocol: VERSION,
            threads: self.cell.threads,
            tolerance: self.settings.tolerance,
            device: self.settings.device.clone(),
        })?;
        if described.protocol != VERSION {
            let problem = format!("speaks protocol {}, not {VERSION}", described.protocol);
            return Err(Failure::new(Status::Unsupported, problem));
        }
        self.iterative = described.accuracy == Class::Iterative;
        let class =
            Limits::of(described.precision.into(), described.accuracy.into(), self.settings.tolerance);
        self.limits = self.task.limits(class);
        self.cell.precision = Some(described.precision);
        self.cell.tolerance = self.iterative.then_some(self.settings.tolerance);
        self.cell.device = Some(super::session::one_line(&described.device));
        self.cell.device_type = Some(described.device_type);
        self.cell.details = described.details;
        let unknowns = self.task.check.equations.unknowns();
        match described.max_unknowns {
            Some(most) if unknowns > most => {
                let problem = format!("takes at most {most} unknowns, these are {unknowns}");
                Err(Failure::new(Status::Unsupported, problem))
            }
            _ => Ok(()),
        }
    }

    fn prepare(&mut self) -> Result<(), Failure> {
        let max_columns = self.task.input.columns;
        let phases: Prepared =
            self.ask(Request::Prepare { problem: self.task.problem.clone(), max_columns })?;
        self.cell.phases_ns.order = phases.order_ns;
        self.cell.phases_ns.symbolic = phases.symbolic_ns;
        self.cell.phases_ns.numeric = phases.numeric_ns;
        self.cell.phases_ns.upload = phases.upload_ns;
        Ok(())
    }

    fn first_solve(&mut self) -> Result<(), Failure> {
        let timed = self.solve(0, 1)?;
        let first = timed.samples_ns[0];
        // Not a steady solve: pages are touched for the first time. It counts by itself only.
        (self.allocations, self.repetitions) = (None, 0);
        self.cell.phases_ns.first_solve = Some(first);
        let Phases { order, symbolic, numeric, upload, .. } = self.cell.phases_ns;
        let set_up: u64 = [order, symbolic, numeric, upload].into_iter().flatten().sum();
        self.cell.first_frame_ns = Some(set_up + first);
        self.check_solution()?;
        self.memory()
    }

    /// Time of one solve as far as known, nanoseconds.
    fn expected(&self) -> u64 {
        let mut sorted = self.samples.clone();
        sorted.sort_unstable();
        percentiles::median(&sorted).or(self.cell.phases_ns.first_solve).unwrap_or(1)
    }

    /// Solves, and checks that the samples are possible.
    fn solve(&mut self, warmup: u32, times: u32) -> Result<Timed, Failure> {
        let _ = std::fs::remove_file(&self.solution); // an old answer must not pass for a new one
        let request =
            Request::Solve { rhs: self.task.input.clone(), warmup, times, solution: self.solution.clone() };
        let timed = self.timed(request, times)?;
        self.cell.iterations = timed.iterations;
        self.repetitions += u64::from(times);
        self.allocations = timed.allocations.map(|new| new + self.allocations.unwrap_or(0));
        Ok(timed)
    }

    /// A request for `times` samples, which must be as many and fit into the time that passed here.
    fn timed(&mut self, request: Request, times: u32) -> Result<Timed, Failure> {
        let doing = request.name();
        let begin = Instant::now();
        let timed: Timed = self.ask(request)?;
        let passed = begin.elapsed();
        let claimed = timed.samples_ns.iter().fold(0u64, |sum, &t| sum.saturating_add(t));
        let lie = if timed.samples_ns.len() != times as usize {
            Some(format!("returned {} samples for {times} repetitions", timed.samples_ns.len()))
        } else if u128::from(claimed) > passed.as_nanos() {
            Some(format!("claims {:.1?} where {passed:.1?} passed", Duration::from_nanos(claimed)))
        } else {
            None
        };
        match lie {
            Some(lie) => Err(Failure::new(Status::Error, format!("`{doing}` {lie}"))),
            None => Ok(timed),
        }
    }

    fn read_solution(&self) -> Result<Vec<f64>, Failure> {
        let equations = &self.task.check.equations;
        let (rows, columns) = (equations.rows(), equations.columns());
        let file = super::array_file::ArrayFile { path: self.solution.clone(), rows, columns };
        file.read()
            .map_err(|error| Failure::new(Status::Error, format!("its solution cannot be read: {error}")))
    }

    fn check_solution(&mut self) -> Result<(), Failure> {
        let x = self.read_solution()?;
        if !self.verified.is_empty() && same_bits(&x, &self.verified) {
            return Ok(());
        }
        let checked = self.task.check.solution(&x, &self.limits);
        self.judge(checked)?;
        self.verified = x;
        Ok(())
    }

    fn judge(&mut self, checked: Checked) -> Result<(), Failure> {
        self.cell.accuracy.worsen(&checked.accuracy);
        match checked.faults.as_slice() {
            [] => Ok(()),
            faults => Err(Failure::new(Status::Invalid, faults.join("; "))),
        }
    }

    /// New values and back again, at least once and for up to a quarter of the cell's time. The first answer with new values
    /// is checked, and the one after the last return.
    fn updates(&mut self) -> Result<(), Failure> {
        let Some(update) = &self.task.update else { return Ok(()) };
        let mut samples = Vec::new();
        let begin = Instant::now();
        while samples.is_empty() || begin.elapsed() < self.settings.cell_time / 4 {
            for values in [&update.new, &update.original] {
                let request = Request::Update { values: values.clone(), times: 1 };
                match self.timed(request, 1) {
                    Ok(timed) => samples.extend(timed.samples_ns),
                    Err(failure) if self.is_refusal(&failure) => {
                        self.cell.details.insert("update".into(), failure.to_string());
                        return Ok(());
                    }
                    Err(failure) => return Err(failure),
                }
                if samples.len() == 1 {
                    self.solve(0, 1)?;
                    let x = self.read_solution()?;
                    let checked = self.task.check.updated(&update.equations, &x, &self.limits);
                    if let [fault, ..] = checked.faults.as_slice() {
                        return Err(Failure::new(Status::Invalid, format!("after new values: {fault}")));
                    }
                }
            }
        }
        self.solve(0, 1)?;
        self.check_solution()?;
        self.cell.update_ns = Summary::of(&samples);
        Ok(())
    }

    /// Whether the child only said no, and lives.
    fn is_refusal(&self, failure: &Failure) -> bool {
        matches!(failure.status, Status::Unsupported)
    }

    fn open_loops(&mut self) -> Result<(), Failure> {
        let time = self.settings.open_loop_time;
        if time.is_zero() && self.settings.least_frames == 0 {
            return Ok(());
        }
        for hz in self.settings.rates.clone() {
            let frames = ((hz * time.as_secs_f64()) as u32).max(self.settings.least_frames).max(1);
            // A solver slower than the rate falls ever further behind; twice the time shows it well enough.
            let limit = Duration::from_secs_f64(2.0 * f64::from(frames) / hz);
            let request = Request::OpenLoop {
                hz,
                frames,
                limit_ns: limit.as_nanos() as u64,
                input: self.task.input.clone(),
            };
            let deadline = self.settings.cell_timeout + limit;
            let session = self.session.as_mut().ok_or_else(|| Failure::new(Status::Error, "has ended"))?;
            let timed: Timed = match session.ask(request, deadline) {
                Ok(timed) => timed,
                Err(failure) if failure.status == Status::Unsupported => return Ok(()),
                Err(failure) => return Err(failure),
            };
            self.cell.open_loop.push(open_loop(hz, &timed.samples_ns));
        }
        Ok(())
    }

    fn memory(&mut self) -> Result<(), Failure> {
        let held: Memory = self.ask(Request::Memory)?;
        self.cell.peak_rss_bytes = held.peak_rss_bytes;
        self.cell.factor = Factor {
            nonzeros: held.factor_nonzeros,
            bytes: held.factor_bytes,
            device_bytes: held.device_bytes,
            flops: held.factor_flops,
            ordering: held.ordering,
        };
        self.bytes = held.bytes_per_solve;
        Ok(())
    }

    fn traffic(&self, median: Option<u64>) -> Bandwidth {
        let iterations = if self.iterative { self.cell.iterations.map(u64::from) } else { Some(1) };
        let bytes = self.bytes.zip(iterations).map(|(bytes, times)| bytes.saturating_mul(times));
        let rate = bytes.zip(median).filter(|&(_, ns)| ns > 0).map(|(bytes, ns)| bytes as f64 / ns as f64);
        let mut read: Vec<f64> = self.read_rates.clone();
        read.sort_by(f64::total_cmp);
        let read = read.get(read.len() / 2).map(|bytes_per_s| bytes_per_s * 1e-9);
        Bandwidth {
            bytes_per_solve: bytes,
            gb_per_s: rate, // bytes per nanosecond
            fraction_of_read: rate.zip(read).map(|(rate, read)| rate / read),
            read_gb_per_s: read,
        }
    }
}

/// One open-loop run; a miss is a latency above 1 / hz.
fn open_loop(hz: f64, latencies: &[u64]) -> OpenLoop {
    let period = 1e9 / hz;
    let (frames, misses) =
        (latencies.len() as u64, latencies.iter().filter(|&&t| t as f64 > period).count() as u64);
    OpenLoop {
        hz,
        frames,
        misses,
        miss_upper95: binomial::upper_bound(misses, frames, 0.95),
        miss_lower95: binomial::lower_bound(misses, frames, 0.95),
        latency_ns: Summary::of(latencies),
    }
}

fn same_bits(a: &[f64], b: &[f64]) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a.to_bits() == b.to_bits())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn misses_are_latencies_over_the_period() {
        let run = open_loop(100.0, &[9_000_000, 10_000_000, 10_000_001, 30_000_000]);
        assert_eq!((run.frames, run.misses), (4, 2));
        assert!(run.miss_lower95 < 0.5 && run.miss_upper95 > 0.5);
    }
}
