//! A program with backends of its own beside the built-in ones, each with one fault: what the harness must survive and
//! report. It is also the proof that `main_with` is all a third party needs.

use lapbench::engine::allocation::CountingAllocator;
use lapsolve::backend::{Backend, Description, Factor, Footprint, Phase, PrepareOptions, Solved};
use lapsolve::columns::Columns;
use lapsolve::error::{PrepareError, SolveError, Unavailable};
use lapsolve::registry::{Entry, OpenOptions, find};
use lapsolve::system::System;
use std::process::ExitCode;
use std::time::Duration;

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

/// What a backend does besides solving.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Fault {
    /// Takes the matrix for a multiple of the identity: no work, so what is measured is the harness.
    Overhead,
    /// Adds 1e-6 to the first unknown.
    Wrong,
    /// Right three times, then as `Wrong`.
    WrongLater,
    /// Ignores new values.
    Stale,
    /// Gives NaN without saying so.
    NotANumber,
    /// Panics in `prepare`.
    Panics,
    /// Ends the process in `prepare`.
    Exits,
    /// Never ends its first solve.
    Hangs,
    /// Takes 20 ms for a solve.
    Slow,
    /// Asks for 64 GiB in `prepare`.
    Greedy,
    /// Allocates once in every solve.
    Allocates,
    /// Prints to stdout in a solve.
    Prints,
}

struct Faulty {
    inner: Box<dyn Backend>,
    fault: Fault,
}

struct FaultyFactor {
    inner: Box<dyn Factor>,
    fault: Fault,
    solves: u32,
    multiple: f64,
}

impl Backend for Faulty {
    fn describe(&self) -> Description {
        self.inner.describe()
    }

    fn prepare(
        &self,
        system: &System,
        options: &PrepareOptions<'_>,
        on: &mut dyn FnMut(Phase),
    ) -> Result<Box<dyn Factor>, PrepareError> {
        match self.fault {
            Fault::Panics => panic!("as it should"),
            Fault::Exits => std::process::exit(7),
            Fault::Greedy => drop(std::hint::black_box(vec![1u8; 64 << 30])),
            _ => {}
        }
        let inner = self.inner.prepare(system, options, on)?;
        let multiple = system.matrix().diagonal(0);
        Ok(Box::new(FaultyFactor { inner, fault: self.fault, solves: 0, multiple }))
    }
}

impl Factor for FaultyFactor {
    fn solve(&mut self, rhs: Columns<&[f64]>, mut x: Columns<&mut [f64]>) -> Result<Solved, SolveError> {
        self.solves += 1;
        if self.fault == Fault::Overhead {
            x.data_mut().iter_mut().zip(rhs.data()).for_each(|(x, b)| *x = b / self.multiple);
            return Ok(Solved::default());
        }
        let solved = self.inner.solve(rhs, x.reborrow())?;
        match self.fault {
            Fault::Wrong => x.data_mut()[0] += 1e-6,
            Fault::WrongLater if self.solves > 3 => x.data_mut()[0] += 1e-6,
            Fault::NotANumber => x.data_mut()[0] = f64::NAN,
            Fault::Hangs => std::thread::sleep(Duration::from_secs(1_000)),
            Fault::Slow => std::thread::sleep(Duration::from_millis(20)),
            Fault::Allocates => drop(std::hint::black_box(Box::new(1u8))),
            Fault::Prints => println!("hello from a solver"),
            _ => {}
        }
        Ok(solved)
    }

    fn update_values(&mut self, values: &[f64], on: &mut dyn FnMut(Phase)) -> Result<(), PrepareError> {
        self.multiple = values[0];
        if self.fault == Fault::Stale { Ok(()) } else { self.inner.update_values(values, on) }
    }

    fn footprint(&self) -> Footprint {
        self.inner.footprint()
    }
}

fn open(fault: Fault, options: &OpenOptions<'_>) -> Result<Box<dyn Backend>, Unavailable> {
    let inner = (find("dense").expect("always there").open)(options)?;
    Ok(Box::new(Faulty { inner, fault }))
}

const fn entry(
    id: &'static str,
    open: fn(&OpenOptions<'_>) -> Result<Box<dyn Backend>, Unavailable>,
) -> Entry {
    Entry { id, open, max_unknowns: None, ..lapsolve::registry::BACKENDS[0] }
}

fn main() -> ExitCode {
    lapbench::main_with(&[
        entry("overhead", |o| open(Fault::Overhead, o)),
        entry("wrong", |o| open(Fault::Wrong, o)),
        entry("wrong-later", |o| open(Fault::WrongLater, o)),
        entry("stale", |o| open(Fault::Stale, o)),
        entry("not-a-number", |o| open(Fault::NotANumber, o)),
        entry("panics", |o| open(Fault::Panics, o)),
        entry("exits", |o| open(Fault::Exits, o)),
        entry("hangs", |o| open(Fault::Hangs, o)),
        entry("slow", |o| open(Fault::Slow, o)),
        entry("greedy", |o| open(Fault::Greedy, o)),
        entry("allocates", |o| open(Fault::Allocates, o)),
        entry("prints", |o| open(Fault::Prints, o)),
        entry("absent", |_| {
            Err(Unavailable { what: "no such device".into(), how_to_get_it: "buy one".into() })
        }),
    ])
}
