//! What is validated: a backend together with the discretisation that feeds it.

use super::finding::{Findings, Level, Outcome};
use lapsolve::backend::{Backend, PrepareOptions, TransferFrame};
use lapsolve::columns::Columns;
use lapsolve::dirichlet::{Dirichlet, DirichletError};
use lapsolve::error::{PrepareError, SolveError, Unavailable};
use lapsolve::laplacian::{Laplacian, Weights};
use lapsolve::limits::Limits;
use lapsolve::mass::{self, Mass};
use lapsolve::mesh::TriangleMesh;
use lapsolve::registry::{Accuracy, Entry, OpenOptions, Precision};
use lapsolve::sparse::SymmetricCsr;
use lapsolve::system::System;
use lapsolve::workload::transfer::{self, TransferError, TransferProblem};
use std::cell::Cell;
use std::time::{Duration, Instant};

/// From meshes to matrices. The functions of lapsolve, or broken ones that the checks must notice.
#[derive(Clone, Copy)]
pub struct Discretisation {
    /// L with plain weights.
    pub laplacian: fn(&TriangleMesh) -> SymmetricCsr,
    /// Diagonal of M.
    pub mass: fn(&TriangleMesh, Mass) -> Vec<f64>,
    /// One vertex of every component, to be fixed at 0.
    pub ground: fn(&SymmetricCsr) -> Vec<u32>,
}

impl Discretisation {
    /// What lapsolve does.
    pub const TRUE: Self = Self {
        laplacian: |mesh| Laplacian::assemble(mesh, Weights::Plain).into_matrix(),
        mass: mass::lumped,
        ground: |l| {
            Dirichlet::grounded(l.clone(), None).map_or(Vec::new(), |problem| problem.fixed().to_vec())
        },
    };

    /// `laplacian` with the vertices of [`ground`](Self::ground) fixed.
    ///
    /// # Errors
    /// [`DirichletError`], for instance where a component has no fixed vertex.
    pub fn grounded(
        &self,
        laplacian: SymmetricCsr,
        positions: &[[f64; 3]],
    ) -> Result<Dirichlet, DirichletError> {
        let fixed = (self.ground)(&laplacian);
        Dirichlet::new(laplacian, Some(positions), &fixed)
    }
}

/// A backend under validation.
pub struct Subject {
    /// Its name.
    pub id: String,
    /// What its answers are held to.
    pub limits: Limits,
    /// Whether exact answers are held to the stricter limits of direct f64 solvers.
    pub exact: bool,
    /// What it computes in.
    pub precision: Precision,
    /// The largest system it takes.
    pub max_unknowns: Option<usize>,
    /// The backend itself.
    pub backend: Box<dyn Backend>,
    /// What feeds it.
    pub discretisation: Discretisation,
    /// How long it may take for its answers on one mesh; without it as long as it likes.
    pub patience: Option<Duration>,
    /// How long it has taken so far.
    pub(super) spent: Cell<Duration>,
}

/// Why there is no answer.
#[derive(Clone, Debug, PartialEq)]
pub enum NoAnswer {
    /// The backend does not take this.
    Unsupported(String),
    /// It says that it did not converge.
    NotConverged(String),
    /// Anything else.
    Failed(String),
}

impl NoAnswer {
    /// Records it: a failure fails the check; not converging does where `must_converge`.
    pub fn record(self, findings: &mut Findings, level: Level, check: &'static str, must_converge: bool) {
        let (outcome, why) = match self {
            NoAnswer::Unsupported(why) => (Outcome::Skipped, why),
            NoAnswer::NotConverged(why) if !must_converge => (Outcome::NotConverged, why),
            NoAnswer::NotConverged(why) | NoAnswer::Failed(why) => (Outcome::Failed, why),
        };
        findings.note(level, check, outcome, why);
    }
}

impl From<PrepareError> for NoAnswer {
    fn from(error: PrepareError) -> Self {
        match error {
            PrepareError::Unsupported { what } => NoAnswer::Unsupported(what),
            other => NoAnswer::Failed(other.to_string()),
        }
    }
}

impl From<SolveError> for NoAnswer {
    fn from(error: SolveError) -> Self {
        match error {
            SolveError::NotConverged { .. } => NoAnswer::NotConverged(error.to_string()),
            other => NoAnswer::Failed(other.to_string()),
        }
    }
}

impl From<DirichletError> for NoAnswer {
    fn from(error: DirichletError) -> Self {
        NoAnswer::Failed(error.to_string())
    }
}

impl From<TransferError> for NoAnswer {
    fn from(error: TransferError) -> Self {
        match error {
            TransferError::Prepare(error) => error.into(),
            other => NoAnswer::Failed(other.to_string()),
        }
    }
}

impl Subject {
    /// Opens a backend of the registry with one thread and the tolerance `tolerance`.
    ///
    /// # Errors
    /// [`Unavailable`] where it cannot be opened here.
    pub fn open(entry: &Entry, options: &OpenOptions<'_>) -> Result<Self, Unavailable> {
        Ok(Self {
            id: entry.id.to_owned(),
            limits: Limits::of(entry.precision, entry.accuracy, options.tolerance),
            exact: entry.precision == Precision::F64 && entry.accuracy == Accuracy::Direct,
            precision: entry.precision,
            max_unknowns: entry.max_unknowns,
            backend: (entry.open)(options)?,
            discretisation: Discretisation::TRUE,
            patience: None,
            spent: Cell::default(),
        })
    }

    /// Another mesh: its patience starts anew.
    pub fn rest(&self) {
        self.spent.set(Duration::ZERO);
    }

    /// The patience, where it is used up.
    pub fn overspent(&self) -> Option<Duration> {
        self.patience.filter(|patience| self.spent.get() > *patience)
    }

    /// The answer of `work`, unless earlier ones took all the patience: then the check is skipped and says so.
    ///
    /// # Errors
    /// [`NoAnswer`].
    pub fn ask<R>(&self, work: impl FnOnce() -> Result<R, NoAnswer>) -> Result<R, NoAnswer> {
        if let Some(patience) = self.overspent() {
            let seconds = patience.as_secs();
            return Err(NoAnswer::Unsupported(format!(
                "not asked: its answers on this mesh took more than {seconds} s (--patience)"
            )));
        }
        let start = Instant::now();
        let answer = work();
        self.spent.set(self.spent.get() + start.elapsed());
        answer
    }

    /// L of `mesh`.
    pub fn laplacian(&self, mesh: &TriangleMesh) -> SymmetricCsr {
        (self.discretisation.laplacian)(mesh)
    }

    /// Whether a system of `unknowns` is within what it takes.
    pub fn takes(&self, unknowns: usize) -> bool {
        self.max_unknowns.is_none_or(|most| unknowns <= most)
    }

    /// Solves A x = b from x = 0.
    ///
    /// # Errors
    /// [`NoAnswer`].
    pub fn solve(&self, system: &System, rhs: Columns<&[f64]>) -> Result<Vec<f64>, NoAnswer> {
        self.ask(|| {
            let mut factor = self.backend.prepare(system, &PrepareOptions::columns(rhs.k()), &mut |_| {})?;
            let mut x = vec![0.0; rhs.n() * rhs.k()];
            factor.solve(rhs, Columns::new(&mut x, rhs.n(), rhs.k()))?;
            Ok(x)
        })
    }

    /// The harmonic field of `values` (|C| x k) over all vertices.
    ///
    /// # Errors
    /// [`NoAnswer`].
    pub fn harmonic(&self, problem: &Dirichlet, values: Columns<&[f64]>) -> Result<Vec<f64>, NoAnswer> {
        self.ask(|| {
            let (n, k) = (problem.laplacian().n(), values.k());
            let mut handle =
                self.backend.prepare_harmonic(problem, &PrepareOptions::columns(k), &mut |_| {})?;
            let mut field = vec![0.0; n * k];
            handle.solve(values, Columns::new(&mut field, n, k))?;
            Ok(field)
        })
    }

    /// Prepared frames of `problem`.
    ///
    /// # Errors
    /// [`NoAnswer`].
    pub fn transfer(&self, problem: &TransferProblem) -> Result<Box<dyn TransferFrame>, NoAnswer> {
        self.ask(|| Ok(transfer::prepare(&*self.backend, problem, &PrepareOptions::columns(4), &mut |_| {})?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lapsolve::registry;

    #[test]
    fn a_backend_that_used_up_its_patience_is_not_asked_again_before_the_next_mesh() {
        let entry = registry::find("faer-llt").expect("a built-in backend");
        let mut subject = Subject::open(entry, &OpenOptions::default()).expect("always there");
        let slow = || {
            std::thread::sleep(Duration::from_millis(2));
            Ok(())
        };
        for _ in 0..2 {
            assert_eq!(subject.ask(slow), Ok(()), "without end");
        }
        subject.patience = Some(Duration::from_millis(1));
        subject.rest();
        assert_eq!(subject.ask(slow), Ok(()), "an answer that was begun is waited for");
        assert!(subject.overspent().is_some());
        let refused = subject.ask(|| -> Result<(), NoAnswer> { unreachable!("must not be asked") });
        assert!(matches!(refused, Err(NoAnswer::Unsupported(why)) if why.contains("--patience")));
        subject.rest();
        assert_eq!(subject.ask(slow), Ok(()), "another mesh");
    }
}
