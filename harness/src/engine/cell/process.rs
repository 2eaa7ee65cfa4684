//! Talking to the cell's process.

use super::Running;
use crate::engine::array_file::ArrayFile;
use crate::engine::protocol::{Described, Memory, Prepared, Request, Timed, VERSION};
use crate::engine::session::{Failure, Session, one_line};
use crate::record::names::{Accuracy, Status};
use crate::record::result::Factor;
use lapsolve::limits::Limits;
use serde::de::DeserializeOwned;
use std::path::Path;
use std::time::{Duration, Instant};

impl Running<'_> {
    /// Starts the process and lets it say who it is.
    pub(super) fn open(&mut self) -> Result<(), Failure> {
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
        self.iterative = described.accuracy == Accuracy::Iterative;
        let class =
            Limits::of(described.precision.into(), described.accuracy.into(), self.settings.tolerance);
        self.limits = self.task.limits(class);
        self.cell.precision = Some(described.precision);
        self.cell.tolerance = self.iterative.then_some(self.settings.tolerance);
        self.cell.device = Some(one_line(&described.device));
        self.cell.device_type = Some(described.device_type);
        self.cell.details = described.details;
        self.cell.threads_used = Some(described.threads);
        if let Some(what) = self.task.beyond(described.precision, self.iterative) {
            return Err(Failure::new(Status::Unsupported, what));
        }
        let unknowns = self.task.unknowns();
        match described.max_unknowns {
            Some(most) if unknowns > most => {
                let problem = format!("takes at most {most} unknowns, these are {unknowns}");
                Err(Failure::new(Status::Unsupported, problem))
            }
            _ => Ok(()),
        }
    }

    pub(super) fn prepare(&mut self) -> Result<(), Failure> {
        let max_columns = self.task.columns();
        let problem = self.task.problem.clone();
        let phases: Prepared =
            self.ask(Request::Prepare { problem, max_columns }).map_err(|why| self.task.expected(why))?;
        // A library that assembles by itself says how long that took; all others are given our matrix.
        if phases.assemble_ns.is_some() {
            self.cell.phases_ns.assemble = phases.assemble_ns;
        }
        self.cell.phases_ns.order = phases.order_ns;
        self.cell.phases_ns.symbolic = phases.symbolic_ns;
        self.cell.phases_ns.numeric = phases.numeric_ns;
        self.cell.phases_ns.upload = phases.upload_ns;
        Ok(())
    }

    /// Prepares the same problem again; the times count as changes.
    pub(super) fn preparations(&mut self, time: Duration) -> Result<(), Failure> {
        let begin = Instant::now();
        while self.changes.is_empty() || begin.elapsed() < time {
            let request =
                Request::Prepare { problem: self.task.problem.clone(), max_columns: self.task.columns() };
            let Prepared { order_ns, symbolic_ns, numeric_ns, upload_ns, .. } = self.ask(request)?;
            self.changes.push([order_ns, symbolic_ns, numeric_ns, upload_ns].into_iter().flatten().sum());
        }
        Ok(())
    }

    pub(super) fn memory(&mut self) -> Result<(), Failure> {
        let held: Memory = self.ask(Request::Memory)?;
        self.cell.peak_rss_bytes = self.cell.peak_rss_bytes.max(held.peak_rss_bytes);
        self.cell.factor = Factor {
            nonzeros: held.factor_nonzeros,
            bytes: held.factor_bytes,
            device_bytes: held.device_bytes,
            flops: held.factor_flops,
            dispatches: held.dispatches,
            ordering: held.ordering,
        };
        self.bytes = held.bytes_per_solve;
        Ok(())
    }

    pub(super) fn ask<T: DeserializeOwned>(&mut self, request: Request) -> Result<T, Failure> {
        self.ask_within(request, self.settings.cell_timeout)
    }

    pub(super) fn ask_within<T: DeserializeOwned>(
        &mut self,
        request: Request,
        deadline: Duration,
    ) -> Result<T, Failure> {
        match &mut self.session {
            Some(session) => session.ask(request, deadline),
            None => Err(Failure::new(Status::Error, "its process has ended")),
        }
    }

    /// A request for `times` samples, which must be as many and fit into the time that passed here.
    pub(super) fn timed(&mut self, request: Request, times: u32) -> Result<Timed, Failure> {
        let doing = request.name();
        let untimed = match request {
            Request::Solve { warmup, .. } | Request::Frame { warmup, .. } => Some(warmup),
            _ => None, // what an update converts first is not its own time
        };
        let begin = Instant::now();
        let timed: Timed = self.ask(request)?;
        let passed = begin.elapsed();
        let claimed = timed.samples_ns.iter().fold(0u64, |sum, &t| sum.saturating_add(t));
        if let Some(warmup) = untimed {
            let repetitions = f64::from(times.saturating_add(warmup)) / f64::from(times.max(1));
            self.ledger.enter(passed, Duration::from_nanos(claimed).mul_f64(repetitions));
        }
        let lie = if timed.samples_ns.len() != times as usize {
            format!("returned {} samples for {times} repetitions", timed.samples_ns.len())
        } else if u128::from(claimed) > passed.as_nanos() {
            format!("claims {:.1?} where {passed:.1?} passed", Duration::from_nanos(claimed))
        } else {
            return Ok(timed);
        };
        Err(Failure::new(Status::Error, format!("`{doing}` {lie}")))
    }

    /// Steady repetitions: their iterations and allocations count.
    pub(super) fn count(&mut self, timed: &Timed) {
        self.cell.iterations = timed.iterations;
        self.repetitions += timed.samples_ns.len() as u64;
        self.allocations = timed.allocations.map(|new| new + self.allocations.unwrap_or(0));
    }
}

/// Reads a block that a child wrote.
pub(super) fn read_block(path: &Path, rows: usize, columns: usize) -> Result<Vec<f64>, Failure> {
    let file = ArrayFile { path: path.to_owned(), rows, columns };
    file.read().map_err(|error| Failure::new(Status::Error, format!("its solution cannot be read: {error}")))
}
