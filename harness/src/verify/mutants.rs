//! The code broken on purpose, in ways that people break it. Every mutant must be noticed by a named check: a check that
//! notices nothing is decoration, and an error that nothing notices will be shipped one day.

use super::finding::{Findings, Outcome};
use super::subject::{Discretisation, Subject};
use super::suite;
use lapsolve::backend::{
    Backend, Description, Factor, Footprint, FrameTrace, Harmonic, Phase, PrepareOptions, Solved,
    TransferFrame,
};
use lapsolve::columns::Columns;
use lapsolve::dirichlet::{Dirichlet, ReducedHarmonic};
use lapsolve::error::{PrepareError, SolveError};
use lapsolve::mass::{self, Mass};
use lapsolve::registry::{Entry, OpenOptions};
use lapsolve::sparse::SymmetricCsr;
use lapsolve::system::System;
use lapsolve::vector::{Vector, add, scale, sub};
use lapsolve::workload::transfer::{Transfer, TransferError, TransferProblem};
use std::collections::BTreeSet;

/// A mutant and the checks that noticed it.
#[derive(Clone, Debug)]
pub struct Kill {
    /// What was broken.
    pub mutant: &'static str,
    /// Names of the checks that failed for it and not for the unbroken code; empty: it survived.
    pub killed_by: BTreeSet<&'static str>,
}

/// Runs all mutants against the cases with known answers, and the unbroken code for comparison.
///
/// # Errors
/// Where a backend that mutants are made of is not available, or the unbroken code fails a check by itself.
pub fn kill_table(backends: &[Entry]) -> Result<Vec<Kill>, String> {
    let healthy = failures(&subject(backends, DIRECT, OpenOptions::default())?, backends);
    if !healthy.is_empty() {
        return Err(format!("the unbroken code fails {healthy:?}; a kill would mean nothing"));
    }
    let mutants = discretisations(backends)?.into_iter().chain(solvers(backends)?);
    Ok(mutants.map(|(mutant, subject)| Kill { mutant, killed_by: failures(&subject, backends) }).collect())
}

/// The backend that most mutants break, and the one that stops early.
const DIRECT: &str = "faer-llt";
const ITERATIVE: &str = "cg-jacobi";

fn subject(backends: &[Entry], id: &str, options: OpenOptions<'_>) -> Result<Subject, String> {
    let entry = backends.iter().find(|e| e.id == id).ok_or_else(|| format!("no backend {id}"))?;
    Subject::open(entry, &options).map_err(|why| format!("{id}: {why}"))
}

fn failures(subject: &Subject, backends: &[Entry]) -> BTreeSet<&'static str> {
    let discretisation = subject.discretisation;
    let findings: Findings = suite::analytic(std::slice::from_ref(subject), &discretisation, backends, &[17]);
    findings.all.iter().filter(|f| f.outcome == Outcome::Failed).map(|f| f.check).collect()
}

/// Changes every value of L.
fn mapped(l: SymmetricCsr, change: fn(f64) -> f64) -> SymmetricCsr {
    let mut l = l;
    l.values_mut().iter_mut().for_each(|v| *v = change(*v));
    l
}

fn discretisations(backends: &[Entry]) -> Result<Vec<(&'static str, Subject)>, String> {
    const TRUE: Discretisation = Discretisation::TRUE;
    let broken: [(&'static str, Discretisation); 6] = [
        ("sign flip", Discretisation { laplacian: |m| mapped((TRUE.laplacian)(m), |v| -v), ..TRUE }),
        (
            "factor one half",
            Discretisation { laplacian: |m| mapped((TRUE.laplacian)(m), |v| 0.5 * v), ..TRUE },
        ),
        (
            "f32 truncation",
            Discretisation { laplacian: |m| mapped((TRUE.laplacian)(m), |v| f64::from(v as f32)), ..TRUE },
        ),
        ("dropped entry", Discretisation { laplacian: |m| without_an_entry((TRUE.laplacian)(m)), ..TRUE }),
        ("wrong mass", Discretisation { mass: |m, _| mass::lumped(m, Mass::Barycentric), ..TRUE }),
        (
            "ungrounded component",
            Discretisation { ground: |l| (TRUE.ground)(l).into_iter().take(1).collect(), ..TRUE },
        ),
    ];
    broken
        .into_iter()
        .map(|(name, discretisation)| {
            let healthy = subject(backends, DIRECT, OpenOptions::default())?;
            Ok((name, Subject { discretisation, ..healthy }))
        })
        .collect()
}

/// One coupling in the middle of the matrix is lost; the diagonal still counts it.
fn without_an_entry(mut l: SymmetricCsr) -> SymmetricCsr {
    let row = (l.n() / 2..l.n()).find(|&i| l.row(i).1.iter().skip(1).any(|v| *v != 0.0));
    if let Some(range) = row.map(|i| l.row_range(i)) {
        let values = &mut l.values_mut()[range];
        if let Some(value) = values[1..].iter_mut().find(|v| **v != 0.0) {
            *value = 0.0;
        }
    }
    l
}

fn solvers(backends: &[Entry]) -> Result<Vec<(&'static str, Subject)>, String> {
    let mut all = Vec::new();
    for (name, defect) in [
        ("stale factor", Defect::StaleFactor),
        ("swapped columns", Defect::SwappedColumns),
        ("skipped component", Defect::SkippedComponent),
        ("wrong quaternion sign", Defect::WrongSign),
        ("missing translation", Defect::MissingTranslation),
        ("clamped weights on one side only", Defect::ClampedMatrix),
    ] {
        let healthy = subject(backends, DIRECT, OpenOptions::default())?;
        let backend = Box::new(Broken { inner: healthy.backend, defect });
        all.push((name, Subject { backend, ..healthy }));
    }
    let hasty = subject(backends, ITERATIVE, OpenOptions { tolerance: 1e-5, ..OpenOptions::default() })?;
    let promised = subject(backends, ITERATIVE, OpenOptions::default())?.limits;
    all.push(("CG stopped early", Subject { limits: promised, ..hasty }));
    Ok(all)
}

/// What is wrong with a [`Broken`] backend.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Defect {
    /// `update_values` is accepted and ignored.
    StaleFactor,
    /// The first two columns of every solution change places.
    SwappedColumns,
    /// The last component of a system is never solved.
    SkippedComponent,
    /// Quaternions are brought to w >= 0, which tears a field at 180 degrees.
    WrongSign,
    /// A frame's result stays where the reference pose is.
    MissingTranslation,
    /// Negative weights are clamped in the factor, not on the right-hand side.
    ClampedMatrix,
}

struct Broken {
    inner: Box<dyn Backend>,
    defect: Defect,
}

impl Backend for Broken {
    fn describe(&self) -> Description {
        self.inner.describe()
    }

    fn prepare(
        &self,
        system: &System,
        options: &PrepareOptions<'_>,
        on: &mut dyn FnMut(Phase),
    ) -> Result<Box<dyn Factor>, PrepareError> {
        let defect = self.defect;
        let inner = match defect {
            Defect::ClampedMatrix => self.inner.prepare(&clamped(system)?, options, on)?,
            _ => self.inner.prepare(system, options, on)?,
        };
        let skipped =
            if defect == Defect::SkippedComponent { last_component(system.matrix()) } else { Vec::new() };
        Ok(Box::new(BrokenFactor { inner, defect, skipped }))
    }

    fn prepare_harmonic(
        &self,
        problem: &Dirichlet,
        options: &PrepareOptions<'_>,
        on: &mut dyn FnMut(Phase),
    ) -> Result<Box<dyn Harmonic>, PrepareError> {
        let factor = problem.system().map(|system| self.prepare(system, options, on)).transpose()?;
        let inner = Box::new(ReducedHarmonic::new(problem.clone(), factor, options.max_columns));
        Ok(if self.defect == Defect::WrongSign { Box::new(WrongSign { inner }) } else { inner })
    }

    fn prepare_transfer(
        &self,
        problem: &TransferProblem,
        _: &PrepareOptions<'_>,
        on: &mut dyn FnMut(Phase),
    ) -> Result<Option<Box<dyn TransferFrame>>, PrepareError> {
        if self.defect != Defect::MissingTranslation {
            return Ok(None);
        }
        let inner = Transfer::prepare(&*self.inner, problem, on).map_err(|error| match error {
            TransferError::Prepare(error) => error,
            other => PrepareError::Unsupported { what: other.to_string() },
        })?;
        Ok(Some(Box::new(Untranslated { inner, centre: mean(problem.target().positions()) })))
    }
}

/// The matrix without positive off-diagonal entries, rows still summing to what they did.
fn clamped(system: &System) -> Result<System, PrepareError> {
    let mut matrix = system.matrix().clone();
    let mut excess = vec![0.0; matrix.n()];
    for i in 0..matrix.n() {
        let range = matrix.row_range(i);
        for entry in range.start + 1..range.end {
            let (j, value) = (matrix.columns()[entry] as usize, matrix.values()[entry].max(0.0));
            matrix.values_mut()[entry] -= value;
            excess[i] += value;
            excess[j] += value;
        }
    }
    matrix.add_diagonal(&excess);
    Ok(System::new(matrix, system.positions().map(<[_]>::to_vec))?)
}

/// Rows connected with the last one, where not all are.
fn last_component(matrix: &SymmetricCsr) -> Vec<usize> {
    let pattern = matrix.full_pattern();
    let mut reached = vec![false; matrix.n()];
    let mut stack = vec![matrix.n() - 1];
    while let Some(row) = stack.pop() {
        if !std::mem::replace(&mut reached[row], true) {
            let range = pattern.starts[row] as usize..pattern.starts[row + 1] as usize;
            stack.extend(pattern.columns[range].iter().map(|&j| j as usize));
        }
    }
    if reached.iter().all(|r| *r) {
        Vec::new()
    } else {
        (0..reached.len()).filter(|&row| reached[row]).collect()
    }
}

struct BrokenFactor {
    inner: Box<dyn Factor>,
    defect: Defect,
    skipped: Vec<usize>,
}

impl Factor for BrokenFactor {
    fn solve(&mut self, rhs: Columns<&[f64]>, mut x: Columns<&mut [f64]>) -> Result<Solved, SolveError> {
        let solved = self.inner.solve(rhs, x.reborrow())?;
        self.skipped.iter().for_each(|&row| x.row_mut(row).fill(0.0));
        if self.defect == Defect::SwappedColumns && x.k() > 1 {
            (0..x.n()).for_each(|row| x.row_mut(row).swap(0, 1));
        }
        Ok(solved)
    }

    fn update_values(&mut self, values: &[f64], on: &mut dyn FnMut(Phase)) -> Result<(), PrepareError> {
        if self.defect == Defect::StaleFactor { Ok(()) } else { self.inner.update_values(values, on) }
    }

    fn footprint(&self) -> Footprint {
        self.inner.footprint()
    }
}

struct WrongSign {
    inner: Box<ReducedHarmonic>,
}

impl Harmonic for WrongSign {
    fn solve(
        &mut self,
        constraints: Columns<&[f64]>,
        field: Columns<&mut [f64]>,
    ) -> Result<Solved, SolveError> {
        let mut values = constraints.slice().to_vec();
        for q in values.chunks_exact_mut(constraints.k()).filter(|q| q.len() == 4 && q[0] < 0.0) {
            q.iter_mut().for_each(|x| *x = -*x);
        }
        self.inner.solve(Columns::new(&values, constraints.n(), constraints.k()), field)
    }

    fn update_values(&mut self, values: &[f64], on: &mut dyn FnMut(Phase)) -> Result<(), PrepareError> {
        self.inner.update_values(values, on)
    }

    fn footprint(&self) -> Footprint {
        self.inner.footprint()
    }
}

struct Untranslated {
    inner: Transfer,
    centre: Vector,
}

impl TransferFrame for Untranslated {
    fn frame(&mut self, template: &[[f64; 3]], target: &mut [[f64; 3]]) -> Result<Solved, SolveError> {
        let solved = self.inner.frame(template, target)?;
        let back = sub(self.centre, mean(target));
        target.iter_mut().for_each(|x| *x = add(*x, back));
        Ok(solved)
    }

    fn trace(&mut self) -> Option<FrameTrace<'_>> {
        self.inner.trace()
    }

    fn replaced(&self) -> usize {
        self.inner.replaced()
    }

    fn footprint(&self) -> Footprint {
        self.inner.footprint()
    }
}

fn mean(points: &[[f64; 3]]) -> Vector {
    points.iter().fold([0.0; 3], |sum, &p| add(sum, scale(1.0 / points.len() as f64, p)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use lapsolve::registry::BACKENDS;

    #[test]
    fn no_mutant_survives() {
        let table = kill_table(BACKENDS).expect("the unbroken code is healthy");
        assert_eq!(table.len(), 13);
        for kill in table {
            assert!(!kill.killed_by.is_empty(), "`{}` survived", kill.mutant);
        }
    }
}
