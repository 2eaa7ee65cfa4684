//! A workload on a source: equations, reference, and the files that children read. Made once, for all cells.

pub mod edits;
pub mod frames;
pub mod pipeline;
pub mod skinning;
pub mod smoothing;
pub mod transfer;

use super::array_file::ArrayFile;
use super::check::{Check, ForwardLimit, Judge};
use super::equations::Equations;
use super::inputs::Inputs;
use super::protocol::Problem;
use super::session::Failure;
use super::source::{Content, Source};
use super::workload::Workload;
use crate::mesh_io::{npy, table};
use crate::record::names::{Precision, Status};
use crate::verify::reference::Trusted;
use anyhow::{Context, anyhow};
use edits::Edits;
use frames::FrameCheck;
use lapsolve::columns::Columns;
use lapsolve::dirichlet::Dirichlet;
use lapsolve::laplacian::{Laplacian, Weights};
use lapsolve::limits::Limits;
use lapsolve::mass::{self, Mass};
use lapsolve::mesh::TriangleMesh;
use lapsolve::registry::Entry;
use lapsolve::sparse::SymmetricCsr;
use lapsolve::system::System;
use lapsolve::workload::{harmonic, kharmonic, matrix, poisson, screened};
use std::path::{Path, PathBuf};
use transfer::Setting;

/// A workload on a mesh or matrix, ready for any number of cells.
#[derive(Debug)]
pub struct Task {
    /// Which workload.
    pub workload: Workload,
    /// What children prepare.
    pub problem: Problem,
    /// What they do then.
    pub goal: Goal,
    /// Where children put solutions.
    pub folder: PathBuf,
}

/// What a prepared child does, and what its answers are checked against.
#[derive(Debug)]
pub enum Goal {
    /// Solves one right-hand side, again and again.
    Solve(Box<Solve>),
    /// Does frame after frame.
    Frames(Box<Frames>),
}

/// Solves of one right-hand side.
#[derive(Debug)]
pub struct Solve {
    /// What answers are held against.
    pub check: Judge,
    /// The right-hand side or the constraint values.
    pub input: ArrayFile,
    /// Other values on the same pattern, to be refactored; none where the workload has no such values.
    pub update: Option<Update>,
    /// How the constraints move, in `harmonic-edit`.
    pub edits: Option<Edits>,
}

/// Frames of `transfer`.
#[derive(Debug)]
pub struct Frames {
    /// Meshes, marks and motion.
    pub setting: Setting,
    /// Both systems and the known frame.
    pub check: FrameCheck,
    /// The known frame's pose.
    pub checked: ArrayFile,
}

/// Values for `update`.
#[derive(Debug)]
pub struct Update {
    /// The equations with the new values.
    pub equations: Equations,
    /// The new values.
    pub new: ArrayFile,
    /// The original ones, to return to.
    pub original: ArrayFile,
}

impl Task {
    /// Makes the equations, solves them for reference with the best of `backends`, and writes the files to `folder`.
    ///
    /// # Errors
    /// Inputs that do not fit, a system that is not acceptable, or a full disk.
    pub fn new(
        workload: Workload,
        source: &Source,
        inputs: &Inputs,
        backends: &[Entry],
        folder: PathBuf,
    ) -> anyhow::Result<Self> {
        match (workload, &source.content) {
            (Workload::Transfer, Content::Mesh(mesh)) => Self::frames(source, mesh, inputs, backends, folder),
            (Workload::Arap | Workload::Geodesic, Content::Mesh(mesh)) => {
                pipeline::task(workload, source, mesh, inputs, backends, folder)
            }
            _ => Self::solves(workload, source, inputs, backends, folder),
        }
    }

    fn solves(
        workload: Workload,
        source: &Source,
        inputs: &Inputs,
        backends: &[Entry],
        folder: PathBuf,
    ) -> anyhow::Result<Self> {
        let equations = equations(workload, source, inputs, backends)?;
        let edits = match (workload, &source.content) {
            (Workload::HarmonicEdit, Content::Mesh(mesh)) => Some(Edits::new(mesh, inputs)?),
            _ => None,
        };
        let updated = match edits {
            Some(_) => None, // the rows of `harmonic` have that
            None => other_values(workload, source, inputs, backends, &equations),
        };
        let (problem, input) = equations.write(&folder)?;
        let update = updated.map(|changed| Update::write(&folder, &equations, changed)).transpose()?;
        let scale = match (workload, &source.content) {
            (Workload::Poisson, Content::Mesh(mesh)) => Some(mesh.diagonal()),
            _ => None,
        };
        let check = Check::new(equations, scale, forward_limit(workload), backends);
        if let Some(why) = &check.no_reference {
            eprintln!("{}: {workload}: no reference solution: {why}", source.record.name);
        }
        let check = Judge::Equations(check);
        let goal = Goal::Solve(Box::new(Solve { check, input, update, edits }));
        Ok(Self { workload, problem, goal, folder })
    }

    fn frames(
        source: &Source,
        mesh: &TriangleMesh,
        inputs: &Inputs,
        backends: &[Entry],
        folder: PathBuf,
    ) -> anyhow::Result<Self> {
        let setting = Setting::new(source, mesh, inputs)?;
        let problem = setting.problem()?;
        let check = FrameCheck::new(&setting, problem, backends)?;
        let problem = setting.write(&folder)?;
        let checked = setting.write_frames(&folder.join("checked.f64"), setting.motion.checked_frame(), 1)?;
        let goal = Goal::Frames(Box::new(Frames { setting, check, checked }));
        Ok(Self { workload: Workload::Transfer, problem, goal, folder })
    }

    /// Unknowns of the (largest) system that is solved.
    pub fn unknowns(&self) -> usize {
        match &self.goal {
            Goal::Solve(solve) => solve.check.unknowns(),
            Goal::Frames(frames) => frames.check.unknowns(),
        }
    }

    /// Columns of a right-hand side; of a frame's three coordinates.
    pub fn columns(&self) -> usize {
        match &self.goal {
            Goal::Solve(solve) => solve.input.columns,
            Goal::Frames(_) => 3,
        }
    }

    /// What the answers of a class are held to in this workload.
    pub fn limits(&self, class: Limits) -> Limits {
        match self.workload {
            // f64 itself runs out: only a backward error that says "the solver did something" is asked for.
            Workload::Kharmonic2 | Workload::Kharmonic3 => {
                Limits { backward_error: Some(kharmonic::BACKWARD_ERROR), ..class }
            }
            _ => class,
        }
    }

    /// A checked solution as one row per vertex; vertices without an equation get 0.
    pub fn on_vertices(&self, x: Vec<f64>) -> Vec<f64> {
        match &self.goal {
            Goal::Solve(solve) => solve.check.on_vertices(x),
            Goal::Frames(_) => x,
        }
    }

    /// Why a solver of this class is not asked: rounding in f32 exceeds what k >= 2 leaves; the heat of `geodesic` falls below
    /// what f32 can hold and what a residual can see.
    pub fn beyond(&self, precision: Precision, iterative: bool) -> Option<String> {
        let steep = matches!(self.workload, Workload::Kharmonic2 | Workload::Kharmonic3 | Workload::Geodesic);
        if steep && precision != Precision::F64 {
            return Some(format!("`{}` needs f64 throughout", self.workload));
        }
        let decays = self.workload == Workload::Geodesic && iterative;
        decays.then(|| {
            "far from the source heat is below any tolerance: `geodesic` needs a direct solver".into()
        })
    }

    /// `failure`, or the status that this workload has for it: the matrix of `kharmonic-3` may lose definiteness to rounding,
    /// which is no fault of the solver.
    pub fn expected(&self, failure: Failure) -> Failure {
        if failure.indefinite && self.workload == Workload::Kharmonic3 {
            let reason =
                format!("`{}` is not definite in f64 on this mesh: {}", self.workload, failure.reason);
            return Failure::new(Status::Unsupported, reason);
        }
        failure
    }

    /// A path for a child's solution.
    pub fn solution_path(&self, child: usize) -> PathBuf {
        self.folder.join(format!("solution-{child}.f64"))
    }
}

impl Update {
    fn write(folder: &Path, equations: &Equations, changed: Equations) -> std::io::Result<Self> {
        let new = ArrayFile::write(&folder.join("values-new.f64"), changed.values(), 1)?;
        let original = ArrayFile::write(&folder.join("values-original.f64"), equations.values(), 1)?;
        Ok(Self { equations: changed, new, original })
    }
}

fn forward_limit(workload: Workload) -> ForwardLimit {
    match workload {
        Workload::Harmonic | Workload::HarmonicEdit => |l| Some(l.harmonic),
        Workload::Kharmonic2 | Workload::Kharmonic3 => |_| None,
        Workload::Matrix => |l| l.matrix,
        _ => |l| Some(l.poisson),
    }
}

/// The equations of a workload on a mesh or matrix.
///
/// # Errors
/// Inputs that do not fit, or a system that is not acceptable.
pub fn equations(
    workload: Workload,
    source: &Source,
    inputs: &Inputs,
    backends: &[Entry],
) -> anyhow::Result<Equations> {
    match (workload, &source.content) {
        (Workload::Matrix, Content::Matrix(matrix)) => of_matrix(matrix, inputs),
        (Workload::Harmonic | Workload::HarmonicEdit, Content::Mesh(mesh)) => of_harmonic(mesh, inputs),
        (Workload::Poisson, Content::Mesh(mesh)) => of_poisson(mesh, inputs, backends),
        (Workload::Transfer, Content::Mesh(_)) => {
            Err(anyhow!("`transfer` is two systems; ask for `harmonic` or `poisson`"))
        }
        (Workload::Arap | Workload::Geodesic, Content::Mesh(_)) => {
            Err(anyhow!("`{workload}` is a pipeline around solves, not one system"))
        }
        (Workload::Skinning, Content::Mesh(mesh)) => skinning::equations(source, mesh, inputs),
        (Workload::Smoothing, Content::Mesh(mesh)) => smoothing::of_size(mesh.positions().len(), inputs),
        (Workload::Smoothing, Content::Sequence(sequence)) => smoothing::of_angles(sequence, inputs),
        (_, Content::Mesh(mesh)) => of_mass_and_stiffness(workload, mesh, inputs),
        (_, Content::Matrix(_)) => {
            Err(anyhow!("`{workload}` needs a mesh; a matrix has the workload `matrix`"))
        }
        (_, Content::Sequence(_)) => {
            Err(anyhow!("`{workload}` needs a mesh; angles have the workload `smoothing`"))
        }
    }
}

fn of_matrix(a: &SymmetricCsr, inputs: &Inputs) -> anyhow::Result<Equations> {
    let (b, k) = match &inputs.rhs {
        Some(path) => npy::read_columns(path, a.n()).map(|(k, b)| (b, k))?,
        None => {
            let k = inputs.columns.map_or(matrix::COLUMNS, |k| k as usize);
            (matrix::default_right_hand_side(a, k), k)
        }
    };
    Ok(Equations::System { system: System::new(a.clone(), None)?, b, k, vertices: None })
}

fn of_harmonic(mesh: &TriangleMesh, inputs: &Inputs) -> anyhow::Result<Equations> {
    let laplacian = Laplacian::assemble(mesh, Weights::Plain).into_matrix();
    let (fixed, g, k) = match &inputs.constraints {
        Some(path) => {
            let table = table::read_constraints(path, mesh.positions().len())?;
            (table.vertices, table.values, table.k)
        }
        None => {
            let constraints = harmonic::Constraints::sample(mesh, &laplacian, harmonic::DEFAULT_CONSTRAINTS);
            let fixed = constraints.default_set();
            let (g, k) = default_values(mesh, &fixed, inputs);
            (fixed, g, k)
        }
    };
    let problem = Box::new(Dirichlet::new(laplacian, Some(mesh.positions()), &fixed)?);
    let positions = Some(mesh.positions().to_vec());
    Ok(Equations::Harmonic { problem, positions, triangles: Some(mesh.triangles().to_vec()), g, k })
}

/// Values of `harmonic` at the vertices `fixed`, and their number of columns.
fn default_values(mesh: &TriangleMesh, fixed: &[u32], inputs: &Inputs) -> (Vec<f64>, usize) {
    match inputs.columns {
        Some(k) => (matrix::default_solution(fixed.len(), k as usize), k as usize),
        None => (harmonic::default_values(mesh, fixed), harmonic::COLUMNS),
    }
}

/// L x = U, grounded; U is that of the default motion's extreme frame unless given.
fn of_poisson(mesh: &TriangleMesh, inputs: &Inputs, backends: &[Entry]) -> anyhow::Result<Equations> {
    let n = mesh.positions().len();
    let (laplacian, u, k) = match &inputs.rhs {
        Some(path) => {
            let (k, u) = npy::read_columns(path, n)?;
            (Laplacian::assemble(mesh, Weights::Plain).into_matrix(), u, k)
        }
        None => {
            let trusted = Trusted::choose(backends, n).map_err(|why| anyhow!("{why}"))?;
            let input = poisson::default_input(mesh, &*trusted.backend)?;
            (input.laplacian, input.rhs, poisson::COLUMNS)
        }
    };
    let problem = Dirichlet::grounded(laplacian, Some(mesh.positions()))?;
    let system = problem.system().context("there is nothing to solve: no triangle has an area")?.clone();
    let mut b = vec![0.0; system.n() * k];
    problem.gather(Columns::new(&u[..], n, k), Columns::new(&mut b, system.n(), k));
    Ok(Equations::System { system, b, k, vertices: Some((problem.free().to_vec(), n)) })
}

/// `screened` and `kharmonic`: M f on the right, f = the positions unless given.
fn of_mass_and_stiffness(
    workload: Workload,
    mesh: &TriangleMesh,
    inputs: &Inputs,
) -> anyhow::Result<Equations> {
    let n = mesh.positions().len();
    let laplacian = Laplacian::assemble(mesh, Weights::Plain).into_matrix();
    let mass = mass::lumped(mesh, Mass::Voronoi);
    let vertex_system = match workload {
        Workload::Kharmonic1 => kharmonic::system(mesh, &laplacian, &mass, 1),
        Workload::Kharmonic2 => kharmonic::system(mesh, &laplacian, &mass, 2),
        Workload::Kharmonic3 => kharmonic::system(mesh, &laplacian, &mass, 3),
        _ => screened::system(mesh, &laplacian, &mass, inputs.tau),
    }
    .with_context(|| format!("the system of `{workload}`"))?;
    let (f, k) = match (&inputs.rhs, inputs.columns) {
        (Some(path), _) => npy::read_columns(path, n).map(|(k, f)| (f, k))?,
        (None, Some(k)) => (matrix::default_solution(n, k as usize), k as usize),
        (None, None) => (mesh.positions().as_flattened().to_vec(), 3),
    };
    let b = screened::right_hand_side(&vertex_system, &mass, Columns::new(&f[..], n, k));
    let vertices = Some((vertex_system.vertices().to_vec(), n));
    Ok(Equations::System { system: vertex_system.system().clone(), b, k, vertices })
}

/// How far a mesh is stretched along z for other values on the same pattern.
const STRETCH: f64 = 1.25;

/// The equations with the values of a stretched mesh, or of twice the matrix. None where stretching changes the pattern.
fn other_values(
    workload: Workload,
    source: &Source,
    inputs: &Inputs,
    backends: &[Entry],
    equations: &Equations,
) -> Option<Equations> {
    let mesh = match &source.content {
        Content::Mesh(mesh) if workload != Workload::Smoothing => mesh,
        _ => {
            return equations.with_values(&equations.values().iter().map(|v| 2.0 * v).collect::<Vec<_>>());
        }
    };
    let stretched = mesh.positions().iter().map(|&[x, y, z]| [x, y, STRETCH * z]).collect();
    let stretched = mesh.with_positions(stretched).ok()?;
    let stretched = Source {
        record: source.record.clone(),
        load_ns: 0,
        assemble_ns: None,
        content: Content::Mesh(stretched),
        unsubdivided: None,
        body: source.body,
    };
    let other = self::equations(workload, &stretched, inputs, backends).ok()?;
    let same = equations.pattern() == other.pattern();
    if same { equations.with_values(other.values()) } else { None }
}
