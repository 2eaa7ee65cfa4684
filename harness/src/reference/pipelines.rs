//! libigl, Open3D and potpourri3d: deformation by handles and distances from a vertex, on closed surfaces.

use super::python::MeshFile;
use super::{Agreement, Python, ReferenceError};
use crate::mesh_io::table;
use crate::verify::behaviour::is_m_matrix;
use crate::verify::conventions;
use lapsolve::backend::Backend;
use lapsolve::laplacian::{Laplacian, Weights};
use lapsolve::mesh::TriangleMesh;
use lapsolve::workload::arap::{Arap, ArapError, ArapProblem};
use lapsolve::workload::geodesic::{Geodesic, GeodesicError, GeodesicProblem};

/// Difference of deformed positions to Open3D, in diagonals of the bounding box.
const OPEN3D_LIMIT: f64 = 1e-9;
/// The same to libigl, which fits rotations in f32: where no weight is negative, and elsewhere.
const IGL_ARAP_LIMITS: [f64; 2] = [1e-4, 1e-3];
/// Difference of distances, in diagonals: all solve in f64.
const DISTANCE_LIMIT: f64 = 1e-9;

/// What is asked of all.
#[derive(Clone, Copy, Debug)]
pub struct Question<'a> {
    /// Handles, ascending.
    pub handles: &'a [u32],
    /// Where they go.
    pub targets: &'a [[f64; 3]],
    /// Iterations after the first step.
    pub iterations: u32,
    /// Where distances start.
    pub source: u32,
}

/// Why a comparison of pipelines could not be made.
#[derive(Debug, thiserror::Error)]
pub enum PipelineError {
    /// The reference did not run or answered something else.
    #[error(transparent)]
    Reference(#[from] ReferenceError),
    /// The deformation cannot be prepared.
    #[error(transparent)]
    Arap(#[from] ArapError),
    /// The distances cannot be prepared.
    #[error(transparent)]
    Geodesic(#[from] GeodesicError),
    /// A solve failed, or a convention is not known.
    #[error("{0}")]
    Other(String),
}

/// Our answers by the convention of each program against theirs, every vertex. potpourri3d is left out where it is not
/// installed.
///
/// # Errors
/// [`PipelineError`].
pub fn compare(
    python: &Python,
    mesh: &TriangleMesh,
    question: Question<'_>,
    backend: &dyn Backend,
) -> Result<Vec<Agreement>, PipelineError> {
    let Question { handles, targets, iterations, source } = question;
    let rows: Vec<f64> =
        handles.iter().zip(targets).flat_map(|(&v, x)| [f64::from(v), x[0], x[1], x[2]]).collect();
    let answer = python.run("pipelines_reference.py", MeshFile::Mesh(mesh), |folder| {
        let file = folder.join("handles.csv");
        table::write_columns(&file, &rows, 4)?;
        let file = file.display().to_string();
        let numbers = [iterations.to_string(), source.to_string()];
        let [iterations, source] = numbers;
        Ok(vec!["--handles".into(), file, "--iterations".into(), iterations, "--source".into(), source])
    })?;
    let n = mesh.positions().len();
    let mut agreements = Vec::new();
    let negative = !is_m_matrix(Laplacian::assemble(mesh, Weights::Plain).matrix());
    let igl_limit = IGL_ARAP_LIMITS[usize::from(negative)];
    for (array, quantity, convention, limit) in [
        ("open3d_arap", "as-rigid-as-possible against Open3D", Some("open3d"), OPEN3D_LIMIT),
        ("igl_arap", "as-rigid-as-possible against libigl", Some("libigl"), igl_limit),
    ] {
        let ours = deform(mesh, question, convention, backend)?;
        let theirs = answer.array(array, Some(n))?;
        agreements.push(agreement(quantity, limit, mesh, ours.as_flattened(), &theirs));
    }
    for (array, quantity, convention) in [
        ("igl_heat", "distances against libigl", Some("libigl")),
        ("potpourri3d", "distances against potpourri3d", Some("geometry-central")),
    ] {
        if array == "potpourri3d" && answer.facts["potpourri3d"] != true {
            continue;
        }
        let problem = conventions::geodesic(mesh, convention).map_err(PipelineError::Other)?;
        let ours = distances(&problem, source, backend)?;
        agreements.push(agreement(quantity, DISTANCE_LIMIT, mesh, &ours, &answer.array(array, Some(n))?));
    }
    Ok(agreements)
}

fn agreement(
    quantity: &'static str,
    limit: f64,
    mesh: &TriangleMesh,
    ours: &[f64],
    theirs: &[f64],
) -> Agreement {
    let mut agreement = Agreement::new(quantity, limit);
    let columns = ours.len() / mesh.positions().len();
    for (at, (&ours, &theirs)) in ours.iter().zip(theirs).enumerate() {
        agreement.add(ours, theirs, mesh.diagonal(), || format!("vertex {}", at / columns));
    }
    agreement
}

fn deform(
    mesh: &TriangleMesh,
    question: Question<'_>,
    convention: Option<&str>,
    backend: &dyn Backend,
) -> Result<Vec<[f64; 3]>, PipelineError> {
    let laplacian = conventions::arap_laplacian(mesh, convention).map_err(PipelineError::Other)?;
    let problem = ArapProblem::from_laplacian(laplacian, mesh.positions(), question.handles)?;
    let mut arap = Arap::prepare(backend, &problem, &mut |_| {})?;
    let mut positions = mesh.positions().to_vec();
    arap.solve(question.targets, question.iterations, &mut positions)
        .map_err(|error| PipelineError::Other(error.to_string()))?;
    Ok(positions)
}

fn distances(
    problem: &GeodesicProblem,
    source: u32,
    backend: &dyn Backend,
) -> Result<Vec<f64>, PipelineError> {
    problem.check_sources(&[source])?;
    let mut geodesic = Geodesic::prepare(backend, problem, &mut |_| {})?;
    let mut distances = vec![0.0; problem.vertices()];
    geodesic.solve(&[source], &mut distances).map_err(|error| PipelineError::Other(error.to_string()))?;
    Ok(distances)
}
