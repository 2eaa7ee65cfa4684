//! Workloads whose answer comes out of several solves and steps between them, checked as a whole: `arap` and `geodesic`.
//!
//! The answer must be that of the same pipeline with every solve refined in twice the precision, in two elimination orders. A
//! solver that declares a convention is held to the pipeline as that program defines it.

use super::transfer::write_mesh;
use super::{Goal, Solve, Task};
use crate::engine::array_file::ArrayFile;
use crate::engine::check::Judge;
use crate::engine::inputs::Inputs;
use crate::engine::protocol::Problem;
use crate::engine::source::Source;
use crate::engine::workload::Workload;
use crate::mesh_io::table;
use crate::record::result::Accuracy;
use crate::verify::conventions;
use crate::verify::refined::Refined;
use crate::verify::solution::Checked;
use anyhow::ensure;
use lapsolve::laplacian::Weights;
use lapsolve::limits::Limits;
use lapsolve::mass::Mass;
use lapsolve::mesh::TriangleMesh;
use lapsolve::registry::Entry;
use lapsolve::workload::arap::{self, Arap, ArapProblem};
use lapsolve::workload::geodesic::{Geodesic, GeodesicProblem, default_sources};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::{Arc, Mutex};

/// A pipeline with its input, and its refined answers by convention.
#[derive(Debug)]
pub struct Pipeline {
    kind: Kind,
    mesh: TriangleMesh,
    unknowns: usize,
    backends: Vec<Entry>,
    known: Mutex<BTreeMap<Option<String>, Arc<Result<Known, String>>>>,
}

#[derive(Clone, Debug)]
enum Kind {
    Arap { handles: Vec<u32>, targets: Vec<[f64; 3]>, iterations: u32 },
    Geodesic { sources: Vec<u32> },
}

/// An answer computed with refined solves.
#[derive(Debug)]
struct Known {
    answer: Vec<f64>,
    /// Largest difference to the answer with another elimination order.
    spread: f64,
    made_by: String,
}

/// The task of `arap` or `geodesic`.
///
/// # Errors
/// Inputs that do not fit, or a full disk.
pub fn task(
    workload: Workload,
    source: &Source,
    mesh: &TriangleMesh,
    inputs: &Inputs,
    backends: &[Entry],
    folder: PathBuf,
) -> anyhow::Result<Task> {
    let kind =
        if workload == Workload::Arap { Kind::arap(mesh, inputs)? } else { Kind::geodesic(mesh, inputs)? };
    let unknowns = match &kind {
        Kind::Arap { handles, .. } => {
            ArapProblem::new(mesh, handles, Weights::ClampedPerEdge)?.dirichlet().free().len()
        }
        Kind::Geodesic { sources } => {
            let problem = GeodesicProblem::new(mesh, Mass::Barycentric)?;
            problem.check_sources(sources)?;
            problem.heat().vertices().len()
        }
    };
    let files = write_mesh(&folder, "mesh", mesh)?;
    let rhs = folder.join("rhs.f64");
    let (problem, input) = match &kind {
        Kind::Arap { handles, targets, iterations } => {
            let handles = ArrayFile::write(&folder.join("handles.u32"), handles, 1)?;
            let problem = Problem::Arap { mesh: files, handles, iterations: *iterations };
            (problem, ArrayFile::write(&rhs, targets.as_flattened(), 3)?)
        }
        Kind::Geodesic { sources } => {
            let mut delta = vec![0.0; mesh.positions().len()];
            sources.iter().for_each(|&v| delta[v as usize] = 1.0);
            (Problem::Geodesic { mesh: files }, ArrayFile::write(&rhs, &delta, 1)?)
        }
    };
    let pipeline =
        Pipeline { kind, mesh: mesh.clone(), unknowns, backends: backends.to_vec(), known: Mutex::default() };
    if let Err(why) = &*pipeline.known(None) {
        eprintln!("{}: {workload}: no reference answer: {why}", source.record.name);
    }
    let check = Judge::Pipeline(pipeline);
    let goal = Goal::Solve(Box::new(Solve { check, input, update: None, edits: None }));
    Ok(Task { workload, problem, goal, folder })
}

impl Kind {
    /// Handles from the file, else the default ones; ascending by vertex.
    fn arap(mesh: &TriangleMesh, inputs: &Inputs) -> anyhow::Result<Self> {
        let iterations = inputs.iterations;
        let Some(path) = &inputs.constraints else {
            let (handles, targets) = arap::defaults::handles(mesh);
            return Ok(Kind::Arap { handles, targets, iterations });
        };
        let table = table::read_constraints(path, mesh.positions().len())?;
        ensure!(
            table.k == 3,
            "{}: rows `vertex, x, y, z` expected, found {} values",
            path.display(),
            table.k
        );
        Ok(Kind::Arap { handles: table.vertices, targets: table.values.as_chunks().0.to_vec(), iterations })
    }

    fn geodesic(mesh: &TriangleMesh, inputs: &Inputs) -> anyhow::Result<Self> {
        let sources = match &inputs.sources {
            Some(path) => table::read_vertices(path, mesh.positions().len())?,
            None => default_sources(mesh),
        };
        Ok(Kind::Geodesic { sources })
    }
}

impl Pipeline {
    /// Rows of an answer: vertices.
    pub fn rows(&self) -> usize {
        self.mesh.positions().len()
    }

    /// Columns of an answer.
    pub fn columns(&self) -> usize {
        match self.kind {
            Kind::Arap { .. } => 3,
            Kind::Geodesic { .. } => 1,
        }
    }

    /// Unknowns of the larger system.
    pub fn unknowns(&self) -> usize {
        self.unknowns
    }

    /// Checks an answer (rows x columns) against the refined one of its convention, and what it must fulfil exactly.
    pub fn check(&self, x: &[f64], limits: &Limits, convention: Option<&str>) -> Checked {
        let diagonal = self.mesh.diagonal();
        let unit = if diagonal > 0.0 { diagonal } else { 1.0 };
        let limit = match self.kind {
            Kind::Arap { .. } => limits.arap,
            Kind::Geodesic { .. } => limits.poisson,
        };
        let constraint_error = self.constraint_error(x) / unit;
        let mut accuracy =
            Accuracy { limit: Some(limit), constraint_error: Some(constraint_error), ..Accuracy::default() };
        let mut faults = Vec::new();
        if x.iter().any(|x| x.is_nan()) {
            faults.push("an answer is not a number".to_owned());
        }
        if constraint_error.is_nan() || constraint_error > limit {
            faults.push(format!("a handle or source is off by {constraint_error:.1e}"));
        }
        if let Ok(known) = &*self.known(convention) {
            let error = largest_difference(&known.answer, x) / unit;
            let certifiable = known.spread / unit <= 0.1 * limit;
            accuracy.forward_error = Some(error).filter(|e| e.is_finite());
            accuracy.certifiable = Some(certifiable);
            accuracy.reference = Some(known.made_by.clone());
            if certifiable && !(error <= limit) {
                faults.push(format!("forward error {error:.1e} exceeds {limit:.1e}"));
            }
        }
        Checked { accuracy, faults }
    }

    /// How far handles are from where they belong; how far the distance of a source is from 0, where it is the only one of its
    /// component.
    fn constraint_error(&self, x: &[f64]) -> f64 {
        let larger = |m: f64, d: f64| if d.is_nan() { f64::INFINITY } else { m.max(d) };
        match &self.kind {
            Kind::Arap { handles, targets, .. } => {
                let rows = handles.iter().map(|&v| &x[3 * v as usize..3 * v as usize + 3]);
                let off = rows.zip(targets).flat_map(|(x, t)| x.iter().zip(t).map(|(a, b)| (a - b).abs()));
                off.fold(0.0, larger)
            }
            Kind::Geodesic { sources } => {
                let [only] = sources[..] else { return 0.0 };
                x[only as usize].abs()
            }
        }
    }

    /// The refined answer of a convention, made when first asked for.
    fn known(&self, convention: Option<&str>) -> Arc<Result<Known, String>> {
        let mut known = self.known.lock().expect("no check panics while it holds the lock");
        let made =
            known.entry(convention.map(str::to_owned)).or_insert_with(|| Arc::new(self.refined(convention)));
        Arc::clone(made)
    }

    fn refined(&self, convention: Option<&str>) -> Result<Known, String> {
        let (first, second) =
            rayon::join(|| self.answer(convention, false), || self.answer(convention, true));
        let ((answer, made_by), (second, _)) = (first?, second?);
        let spread = largest_difference(&answer, &second);
        let convention = convention.map_or(String::new(), |name| format!(", as {name} defines it"));
        Ok(Known { answer, spread, made_by: made_by + &convention })
    }

    fn answer(&self, convention: Option<&str>, other_order: bool) -> Result<(Vec<f64>, String), String> {
        let backend = Refined::choose(&self.backends, self.unknowns, other_order)?;
        let mesh = &self.mesh;
        let answer = match &self.kind {
            Kind::Arap { handles, targets, iterations } => {
                let laplacian = conventions::arap_laplacian(mesh, convention)?;
                let problem = ArapProblem::from_laplacian(laplacian, mesh.positions(), handles)
                    .map_err(|error| error.to_string())?;
                let mut arap =
                    Arap::prepare(&backend, &problem, &mut |_| {}).map_err(|error| error.to_string())?;
                let mut positions = mesh.positions().to_vec();
                arap.solve(targets, *iterations, &mut positions).map_err(|error| error.to_string())?;
                positions.into_flattened()
            }
            Kind::Geodesic { sources } => {
                let problem = conventions::geodesic(mesh, convention)?;
                let mut geodesic =
                    Geodesic::prepare(&backend, &problem, &mut |_| {}).map_err(|error| error.to_string())?;
                let mut distances = vec![0.0; mesh.positions().len()];
                geodesic.solve(sources, &mut distances).map_err(|error| error.to_string())?;
                distances
            }
        };
        Ok((answer, backend.description()))
    }
}

/// Largest absolute difference, equal infinities being equal; infinite where one is not a number.
fn largest_difference(a: &[f64], b: &[f64]) -> f64 {
    let difference = |(a, b): (&f64, &f64)| if a == b { 0.0 } else { (a - b).abs() };
    a.iter().zip(b).map(difference).fold(0.0, |m, d| if d.is_nan() { f64::INFINITY } else { m.max(d) })
}
