//! Open3D: its reading of a file, the surface area, and one iteration of as-rigid-as-possible deformation.

use std::path::Path;

use lapsolve::backend::{Backend, PrepareOptions};
use lapsolve::columns::Columns;
use lapsolve::dirichlet::Dirichlet;
use lapsolve::laplacian::{Laplacian, Weights};
use lapsolve::mass::{self, Mass};
use lapsolve::mesh::TriangleMesh;

use super::python::MeshFile;
use super::{Agreement, CompareError, Python, ReferenceError};
use crate::mesh_io::table;

/// Relative difference of total areas; Open3D sums in f64.
const AREA_LIMIT: f64 = 1e-10;
/// Difference of deformed positions, in diagonals of the bounding box.
const DEFORMED_LIMIT: f64 = 1e-9;

/// What Open3D makes of the file at `path`, against our reading of it: same vertices in the same order, same triangles,
/// same area. Open3D splits or merges vertices of formats other than PLY and OFF.
///
/// # Errors
/// [`ReferenceError`].
pub fn compare_reading(
    python: &Python,
    path: &Path,
    ours: &TriangleMesh,
) -> Result<Vec<Agreement>, ReferenceError> {
    let answer = python.run("open3d_reference.py", MeshFile::Path(path), |_| Ok(Vec::new()))?;
    let mut sizes = Agreement::new("sizes as read from the file", 0.0);
    let mut positions = Agreement::new("positions as read from the file", 0.0);
    let mut corners = Agreement::new("triangles as read from the file", 0.0);
    let (x, t) = (ours.positions().as_flattened(), ours.triangles().as_flattened());
    let (their_x, their_t) = (answer.array("positions", None)?, answer.array("triangles", None)?);
    sizes.add(x.len() as f64, their_x.len() as f64, 1.0, || "coordinates".into());
    sizes.add(t.len() as f64, their_t.len() as f64, 1.0, || "triangle corners".into());
    for (at, (&ours, &theirs)) in x.iter().zip(&their_x).enumerate() {
        positions.add(ours, theirs, 1.0, || format!("vertex {}", at / 3));
    }
    for (at, (&ours, &theirs)) in t.iter().zip(&their_t).enumerate() {
        corners.add(f64::from(ours), theirs, 1.0, || format!("triangle {}", at / 3));
    }
    let mut area = Agreement::new("area", AREA_LIMIT);
    let theirs = answer.facts["area"].as_f64().unwrap_or(f64::NAN);
    area.add(mass::lumped(ours, Mass::Barycentric).iter().sum(), theirs, theirs, || "sum of masses".into());
    Ok(vec![sizes, positions, corners, area])
}

/// One iteration of as-rigid-as-possible deformation of a closed mesh whose `handles` move to `targets`. Its rotations
/// are identities, so positions move by the field that is harmonic off the handles for weights clamped per edge.
///
/// # Errors
/// [`CompareError`].
pub fn compare_deformation(
    python: &Python,
    mesh: &TriangleMesh,
    handles: &[u32],
    targets: &[[f64; 3]],
    backend: &dyn Backend,
) -> Result<Agreement, CompareError> {
    let rows: Vec<f64> =
        handles.iter().zip(targets).flat_map(|(&v, x)| [f64::from(v), x[0], x[1], x[2]]).collect();
    let answer = python.run("open3d_reference.py", MeshFile::Mesh(mesh), |folder| {
        let file = folder.join("handles.csv");
        table::write_columns(&file, &rows, 4)?;
        Ok(vec!["--handles".into(), file.display().to_string()])
    })?;
    let theirs = answer.array("deformed", Some(mesh.positions().len()))?;

    let x = mesh.positions();
    let l = Laplacian::assemble(mesh, Weights::ClampedPerEdge).into_matrix();
    let problem = Dirichlet::new(l, Some(x), handles)?;
    let shift =
        |(&v, target): (&u32, &[f64; 3])| std::array::from_fn::<f64, 3, _>(|a| target[a] - x[v as usize][a]);
    let shifts: Vec<f64> = handles.iter().zip(targets).flat_map(shift).collect();
    let mut field = vec![0.0; 3 * x.len()];
    let mut handle = backend.prepare_harmonic(&problem, &PrepareOptions::columns(3), &mut |_| {})?;
    handle.solve(Columns::new(&shifts[..], handles.len(), 3), Columns::new(&mut field[..], x.len(), 3))?;

    let mut agreement = Agreement::new("as-rigid-as-possible, first iteration", DEFORMED_LIMIT);
    for (at, (&from, &theirs)) in x.as_flattened().iter().zip(&theirs).enumerate() {
        agreement.add(from + field[at], theirs, mesh.diagonal(), || format!("vertex {}", at / 3));
    }
    Ok(agreement)
}
