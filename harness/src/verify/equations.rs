//! L2 and L3: systems of a mesh, answered by every backend, held against one reference each; and against each other.

use super::agreement::Answers;
use super::finding::{Findings, Level, Outcome};
use super::reference::Reference;
use super::solution::{Checked, Question, Tolerance, check_solution};
use super::subject::{Discretisation, NoAnswer, Subject};
use lapsolve::columns::Columns;
use lapsolve::dirichlet::Dirichlet;
use lapsolve::limits::Limits;
use lapsolve::mass::Mass;
use lapsolve::mesh::TriangleMesh;
use lapsolve::registry::Entry;
use lapsolve::system::System;
use lapsolve::workload::{harmonic, poisson, screened};

/// Which of the limits of a class holds for the forward error.
type Forward = fn(&Limits) -> f64;

/// A system with its reference solution.
pub struct Equations {
    name: String,
    kind: Kind,
    reference: Result<Reference, String>,
    scale: f64,
    forward: Forward,
    ill_conditioned: bool,
}

enum Kind {
    System { system: System, rhs: Vec<f64>, k: usize },
    Harmonic { problem: Box<Dirichlet>, values: Vec<f64>, k: usize },
}

impl Equations {
    /// A x = b, `rhs` being n x k; forward errors are relative to `scale`, or to the largest |x|.
    pub fn system(
        name: impl Into<String>,
        system: System,
        rhs: Vec<f64>,
        k: usize,
        scale: Option<f64>,
        trusted: &[Entry],
    ) -> Self {
        let reference = Reference::solve(trusted, &system, Columns::new(&rhs, system.n(), k));
        let largest = reference.as_ref().map_or(1.0, |r| largest(r.solution()));
        let kind = Kind::System { system, rhs, k };
        let scale = scale.unwrap_or(largest);
        Self { name: name.into(), kind, reference, scale, forward: |l| l.poisson, ill_conditioned: false }
    }

    /// The harmonic extension of `values`, |C| x k.
    pub fn harmonic(
        name: impl Into<String>,
        problem: Dirichlet,
        values: Vec<f64>,
        k: usize,
        trusted: &[Entry],
    ) -> Self {
        let g = Columns::new(&values[..], problem.fixed().len(), k);
        let reference = match problem.system() {
            None => Err("no vertex is free".to_owned()),
            Some(system) => {
                let mut rhs = vec![0.0; system.n() * k];
                problem.right_hand_side(g, Columns::new(&mut rhs, system.n(), k));
                Reference::solve(trusted, system, Columns::new(&rhs, system.n(), k))
            }
        };
        let scale = largest(&values);
        let kind = Kind::Harmonic { problem: Box::new(problem), values, k };
        Self { name: name.into(), kind, reference, scale, forward: |l| l.harmonic, ill_conditioned: false }
    }

    /// Made to be hard: the forward error may reach the bound condition x backward error where that exceeds the limit of
    /// the class, and not converging is legal.
    pub fn ill_conditioned(self) -> Self {
        Self { ill_conditioned: true, ..self }
    }

    /// Largest forward error of a class.
    fn forward_limit(&self, limits: &Limits) -> f64 {
        let class = (self.forward)(limits);
        let condition = self.reference().and_then(Reference::condition).filter(|_| self.ill_conditioned);
        let residual = limits.backward_error.or(limits.relative_residual);
        condition.zip(residual).map_or(class, |(condition, residual)| class.max(condition * residual))
    }

    /// What is solved.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The reference solution, where there is one.
    pub fn reference(&self) -> Option<&Reference> {
        self.reference.as_ref().ok()
    }

    fn unknowns(&self) -> usize {
        match &self.kind {
            Kind::System { system, .. } => system.n(),
            Kind::Harmonic { problem, .. } => problem.free().len(),
        }
    }

    fn answer(&self, subject: &Subject) -> Result<Vec<f64>, NoAnswer> {
        match &self.kind {
            Kind::System { system, rhs, k } => subject.solve(system, Columns::new(rhs, system.n(), *k)),
            Kind::Harmonic { problem, values, k } => {
                subject.harmonic(problem, Columns::new(values, problem.fixed().len(), *k))
            }
        }
    }

    fn check(&self, x: &[f64], limits: &Limits) -> Checked {
        let (question, rows, k) = match &self.kind {
            Kind::System { system, rhs, k } => {
                let rhs = Columns::new(&rhs[..], system.n(), *k);
                (Question::System { matrix: system.matrix(), rhs }, system.n(), *k)
            }
            Kind::Harmonic { problem, values, k } => {
                let values = Columns::new(&values[..], problem.fixed().len(), *k);
                (Question::Harmonic { problem, values }, problem.laplacian().n(), *k)
            }
        };
        let tolerance =
            Tolerance { limits: *limits, forward: Some(self.forward_limit(limits)), scale: self.scale };
        check_solution(question, Columns::new(x, rows, k), self.reference(), &tolerance)
    }

    /// Asks every subject and records residual, forward error, and who disagrees with the others.
    pub fn ask(&self, case: &str, subjects: &[Subject], must_converge: bool, findings: &mut Findings) {
        let case = format!("{case}, {}", self.name);
        let mut answers = Answers::new(self.scale);
        for subject in subjects {
            findings.about(&case, Some(&subject.id));
            if !subject.takes(self.unknowns()) {
                let why =
                    format!("{} unknowns, it takes {:?}", self.unknowns(), subject.max_unknowns.unwrap_or(0));
                findings.note(Level::Residual, "backward error", Outcome::Skipped, why);
                continue;
            }
            match self.answer(subject) {
                Ok(x) => {
                    self.judge(&x, &subject.limits, findings);
                    answers.add(&subject.id, self.forward_limit(&subject.limits), x);
                }
                Err(no) => no.record(
                    findings,
                    Level::Residual,
                    "backward error",
                    must_converge && !self.ill_conditioned,
                ),
            }
        }
        let spread = self.reference().map_or(0.0, Reference::spread);
        findings.about(case, None);
        if let Err(why) = &self.reference {
            findings.note(Level::Forward, "reference solution", Outcome::Skipped, why.clone());
        }
        answers.compare(spread, findings);
    }

    fn judge(&self, x: &[f64], limits: &Limits, findings: &mut Findings) {
        let accuracy = self.check(x, limits).accuracy;
        let infinite = |value: Option<f64>| value.unwrap_or(f64::INFINITY);
        if let Some(limit) = limits.backward_error {
            findings.at_most(Level::Residual, "backward error", infinite(accuracy.backward_error), limit, "");
        }
        if let Some(limit) = limits.relative_residual {
            findings.at_most(
                Level::Residual,
                "relative residual",
                infinite(accuracy.relative_residual),
                limit,
                "",
            );
        }
        if let Some(error) = accuracy.constraint_error {
            findings.at_most(
                Level::Residual,
                "constraints",
                error,
                limits.harmonic,
                "of the largest constraint",
            );
        }
        let Some(reference) = self.reference() else { return };
        let condition = reference.condition().map_or(String::new(), |c| format!("condition {c:.0e}"));
        if accuracy.certifiable == Some(true) {
            let error = infinite(accuracy.forward_error);
            findings.at_most(Level::Forward, "forward error", error, self.forward_limit(limits), condition);
        } else {
            let spread = reference.spread() / self.scale;
            let note = format!("{condition}, two refined solutions differ by {spread:.1e}");
            let (value, limit) = (accuracy.forward_error, Some(self.forward_limit(limits)));
            findings.push(Level::Forward, "forward error", value, limit, Outcome::NotCertifiable, note);
        }
    }
}

fn largest(block: &[f64]) -> f64 {
    block.iter().fold(0.0, |m, x| m.max(x.abs()))
}

/// The systems that any mesh has: `harmonic`, `poisson` and `screened` with their default inputs. What cannot be made is
/// recorded.
pub fn of_mesh(
    mesh: &TriangleMesh,
    discretisation: &Discretisation,
    trusted: &[Entry],
    findings: &mut Findings,
) -> Vec<Equations> {
    let mut all = Vec::new();
    let mut keep = |name: &'static str, made: Result<Equations, String>| match made {
        Ok(equations) => all.push(equations),
        Err(why) => findings.note(Level::Input, name, Outcome::Failed, why),
    };
    keep("harmonic", harmonic_of(mesh, discretisation, trusted));
    keep("poisson", poisson_of(mesh, discretisation, trusted));
    for tau in [1e-4, 1.0, 1e6] {
        keep("screened", screened_of(mesh, discretisation, tau, trusted));
    }
    all
}

fn harmonic_of(
    mesh: &TriangleMesh,
    discretisation: &Discretisation,
    trusted: &[Entry],
) -> Result<Equations, String> {
    let l = (discretisation.laplacian)(mesh);
    let fixed = harmonic::Constraints::sample(mesh, &l, harmonic::DEFAULT_CONSTRAINTS).default_set();
    let values = harmonic::default_values(mesh, &fixed);
    let problem = Dirichlet::new(l, Some(mesh.positions()), &fixed).map_err(|error| error.to_string())?;
    Ok(Equations::harmonic("harmonic", problem, values, harmonic::COLUMNS, trusted))
}

fn poisson_of(
    mesh: &TriangleMesh,
    discretisation: &Discretisation,
    trusted: &[Entry],
) -> Result<Equations, String> {
    let options = Default::default();
    let opened = trusted.iter().filter(|e| e.max_unknowns.is_none()).find_map(|e| (e.open)(&options).ok());
    let backend = opened.ok_or("no direct backend for the right-hand side")?;
    let input = poisson::default_input(mesh, &*backend).map_err(|error| error.to_string())?;
    let problem =
        discretisation.grounded(input.laplacian, mesh.positions()).map_err(|error| error.to_string())?;
    let system = problem.system().ok_or("no vertex is free")?.clone();
    let k = poisson::COLUMNS;
    let mut rhs = vec![0.0; system.n() * k];
    let n = mesh.positions().len();
    problem.gather(Columns::new(&input.rhs, n, k), Columns::new(&mut rhs, system.n(), k));
    Ok(Equations::system("poisson", system, rhs, k, Some(mesh.diagonal()), trusted))
}

fn screened_of(
    mesh: &TriangleMesh,
    discretisation: &Discretisation,
    tau: f64,
    trusted: &[Entry],
) -> Result<Equations, String> {
    let (l, mass) = ((discretisation.laplacian)(mesh), (discretisation.mass)(mesh, Mass::Voronoi));
    let system = screened::system(mesh, &l, &mass, tau).map_err(|error| error.to_string())?;
    let n = mesh.positions().len();
    let rhs = screened::right_hand_side(&system, &mass, Columns::new(mesh.positions().as_flattened(), n, 3));
    let name = format!("screened tau {tau:e}");
    let equations = Equations::system(name, system.system().clone(), rhs, 3, None, trusted);
    Ok(if tau > 1.0 { equations.ill_conditioned() } else { equations })
}
