//! The `skinning` workload of a run: the bones, and the system that their weights solve.

use crate::body::Skeleton;
use crate::engine::equations::Equations;
use crate::engine::inputs::Inputs;
use crate::engine::source::Source;
use crate::mesh_io::table;
use anyhow::{Context, ensure};
use lapsolve::mesh::TriangleMesh;
use lapsolve::workload::skinning::defaults::default_bones;
use lapsolve::workload::skinning::{Bone, SkinningProblem};
use std::path::Path;

/// (L + M H) w = M H p of a mesh: with the bones of a file, of a generated human its own, else the default ones.
///
/// # Errors
/// A file that cannot be read, or bones that do not fit.
pub fn equations(source: &Source, mesh: &TriangleMesh, inputs: &Inputs) -> anyhow::Result<Equations> {
    let bones = match (&inputs.bones, source.body) {
        (Some(path), _) => read(path)?,
        (None, Some(build)) => {
            Skeleton::of(build).bones.iter().map(|bone| Bone::segment(bone.head, bone.tail)).collect()
        }
        (None, None) => default_bones(mesh),
    };
    let problem = SkinningProblem::new(mesh, &bones, inputs.heat)?;
    let system = problem.system();
    Ok(Equations::System {
        system: system.system().clone(),
        b: problem.right_hand_side(),
        k: problem.bones(),
        vertices: Some((system.vertices().to_vec(), mesh.positions().len())),
    })
}

/// One segment per row: both ends.
fn read(path: &Path) -> anyhow::Result<Vec<Bone>> {
    let (k, numbers) = table::read_rows(path).context("--bones")?;
    ensure!(k == 6, "--bones: {}: rows `x1, y1, z1, x2, y2, z2` expected, found {k} values", path.display());
    let bone = |&[a, b, c, d, e, f]: &[f64; 6]| Bone::segment([a, b, c], [d, e, f]);
    Ok(numbers.as_chunks().0.iter().map(bone).collect())
}
