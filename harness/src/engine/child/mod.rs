//! The child's side: serves one backend over the peer protocol until stdin ends.

mod clock;
mod inject;
mod iterate;
pub mod open_loop;
mod prepared;

use super::allocation;
use super::array_file::ArrayFile;
use super::protocol::{
    Answer, Described, Done, Envelope, MAX_LINE, Memory, Outcome, Prepared as PreparedReply, Refusal,
    RefusalKind, Request, VERSION,
};
use crate::process;
use clock::PhaseClock;
use lapsolve::backend::Backend;
use lapsolve::error::{EditError, PrepareError, SolveError, Unavailable};
use lapsolve::registry::{Entry, OpenOptions};
use prepared::Prepared;
use serde::Serialize;
use std::io::{self, BufRead, Read, Write};

/// Answers requests on `input` with lines on `output` until `quit` or the end of `input`.
///
/// # Errors
/// Where a line cannot be read or written; what a request fails with is an answer, not an error.
pub fn serve(entry: &Entry, mut input: impl BufRead, mut output: impl Write) -> io::Result<()> {
    let mut server = Server { entry, backend: None, prepared: None, counts: allocation::is_counting() };
    let mut line = Vec::new();
    loop {
        line.clear();
        if (&mut input).take(MAX_LINE as u64).read_until(b'\n', &mut line)? == 0 {
            return Ok(());
        }
        let answer = match serde_json::from_slice::<Envelope>(&line) {
            Ok(Envelope { request: Request::Quit, id }) => {
                writeln!(output, "{}", render(id, Ok(Done {})))?;
                return output.flush();
            }
            Ok(envelope) => server.answer(envelope),
            Err(error) => render::<Done>(0, Err(failed(format!("not a request: {error}")))),
        };
        writeln!(output, "{answer}")?;
        output.flush()?;
    }
}

/// More columns than any workload has; a number beyond it is a mistake that would cost memory before it is noticed.
const MOST_COLUMNS: usize = 4096;

struct Server<'a> {
    entry: &'a Entry,
    backend: Option<Box<dyn Backend>>,
    prepared: Option<Prepared>,
    counts: bool,
}

impl Server<'_> {
    fn answer(&mut self, Envelope { id, request }: Envelope) -> String {
        match request {
            Request::Describe { protocol: _, threads, tolerance, device } => {
                render(id, self.describe(threads, tolerance, device.as_deref()))
            }
            Request::Prepare { problem, max_columns } => render(id, self.prepare(&problem, max_columns)),
            Request::Solve { rhs, warmup, times, solution } => {
                let counts = self.counts;
                render(id, self.prepared().and_then(|p| p.solve(&rhs, warmup, times, &solution, counts)))
            }
            Request::Iterate { rhs } => render(id, self.prepared().and_then(|p| p.iterate(&rhs))),
            Request::Update { values, times } => {
                render(id, self.prepared().and_then(|p| p.update(&values, times)))
            }
            Request::Edit { add, remove } => render(id, self.prepared().and_then(|p| p.edit(&add, &remove))),
            Request::Frame { template, warmup, solution, trace } => {
                let counts = self.counts;
                render(
                    id,
                    self.prepared()
                        .and_then(|p| p.frame(&template, warmup, &solution, trace.as_ref(), counts)),
                )
            }
            Request::OpenLoop { hz, frames, limit_ns, input } => {
                render(id, self.prepared().and_then(|p| p.open_loop(hz, frames, limit_ns, &input)))
            }
            Request::Memory => render(id, Ok(self.memory())),
            Request::Quit => render(id, Ok(Done {})),
        }
    }

    fn describe(
        &mut self,
        threads: usize,
        tolerance: f64,
        device: Option<&str>,
    ) -> Result<Described, Refusal> {
        let backend = (self.entry.open)(&OpenOptions { threads: threads.max(1), tolerance, device })?;
        let found = backend.describe();
        self.backend = Some(backend);
        Ok(Described {
            protocol: VERSION,
            precision: self.entry.precision.into(),
            accuracy: self.entry.accuracy.into(),
            device: found.device,
            device_type: found.device_type.into(),
            threads: found.threads,
            max_unknowns: self.entry.max_unknowns,
            details: found.details.into_iter().map(|(name, value)| (name.to_owned(), value)).collect(),
        })
    }

    fn prepare(
        &mut self,
        problem: &super::protocol::Problem,
        max_columns: usize,
    ) -> Result<PreparedReply, Refusal> {
        let backend = self.backend.as_deref().ok_or_else(|| failed("prepare before describe"))?;
        if !(1..=MOST_COLUMNS).contains(&max_columns) {
            return Err(failed(format!("max_columns is {max_columns}, not between 1 and {MOST_COLUMNS}")));
        }
        self.prepared = None; // the old handle's memory is free before the new one takes its own
        let mut clock = PhaseClock::default();
        self.prepared = Some(Prepared::new(backend, problem, max_columns, &mut clock)?);
        Ok(clock.phases())
    }

    fn prepared(&mut self) -> Result<&mut Prepared, Refusal> {
        self.prepared.as_mut().ok_or_else(|| failed("nothing is prepared"))
    }

    fn memory(&self) -> Memory {
        let peak_rss_bytes = process::peak_resident_bytes();
        let Some(prepared) = &self.prepared else { return Memory { peak_rss_bytes, ..Memory::default() } };
        let footprint = prepared.footprint();
        Memory {
            peak_rss_bytes,
            factor_nonzeros: footprint.factor_nonzeros,
            factor_bytes: footprint.factor_bytes,
            device_bytes: footprint.device_bytes,
            bytes_per_solve: footprint.bytes_per_solve,
            factor_flops: footprint.factor_flops,
            dispatches: footprint.dispatches,
            ordering: footprint.ordering.map(str::to_owned),
        }
    }
}

fn render<T: Serialize>(id: u64, result: Result<T, Refusal>) -> String {
    let outcome = match result {
        Ok(done) => Outcome::Ok(done),
        Err(refusal) => Outcome::Error(refusal),
    };
    serde_json::to_string(&Answer { id, outcome }).expect("answers are plain data")
}

fn failed(message: impl Into<String>) -> Refusal {
    Refusal { kind: RefusalKind::Failed, message: message.into() }
}

impl From<Unavailable> for Refusal {
    fn from(why: Unavailable) -> Self {
        Self { kind: RefusalKind::Unavailable, message: why.to_string() }
    }
}

impl From<PrepareError> for Refusal {
    fn from(error: PrepareError) -> Self {
        let kind = match &error {
            PrepareError::OutOfMemory { .. } => RefusalKind::OutOfMemory,
            PrepareError::Unsupported { .. } => RefusalKind::Unsupported,
            PrepareError::NotPositiveDefinite { .. } => RefusalKind::NotPositiveDefinite,
            _ => RefusalKind::Failed,
        };
        Self { kind, message: error.to_string() }
    }
}

impl From<EditError> for Refusal {
    fn from(error: EditError) -> Self {
        match error {
            EditError::Prepare(error) => error.into(),
            EditError::Unsupported => Self { kind: RefusalKind::Unsupported, message: error.to_string() },
            _ => failed(error.to_string()),
        }
    }
}

impl From<SolveError> for Refusal {
    fn from(error: SolveError) -> Self {
        let kind = match &error {
            SolveError::NotConverged { .. } => RefusalKind::NotConverged,
            _ => RefusalKind::Failed,
        };
        Self { kind, message: error.to_string() }
    }
}

impl From<io::Error> for Refusal {
    fn from(error: io::Error) -> Self {
        failed(format!("cannot exchange arrays: {error}"))
    }
}

/// Reads a block of f64 that must have `rows` rows.
fn read_rows(file: &ArrayFile, rows: usize, what: &str) -> Result<Vec<f64>, Refusal> {
    if file.rows != rows || file.columns == 0 {
        return Err(failed(format!(
            "{what}: {} x {} numbers, {rows} rows expected",
            file.rows, file.columns
        )));
    }
    Ok(file.read()?)
}
