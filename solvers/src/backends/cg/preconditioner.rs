//! What a preconditioner is to the Krylov core.

use super::operator::Csr;
use super::workers::Workers;
use crate::error::PrepareError;

/// z = M^-1 r for rows of W lanes, M symmetric positive definite and the same in every call.
pub(crate) trait Preconditioner<S, const W: usize>: Send {
    /// Reads `r`, writes all of `z`. `r` may serve as workspace, but comes back as it was. No allocation.
    fn apply(&mut self, workers: &mut Workers, r: &mut [[S; W]], z: &mut [[S; W]]);
}

/// A preconditioner for every lane width, with its facts. S is what it, and the vectors of the iteration, are stored in.
pub(crate) trait AnyPreconditioner<S>:
    Preconditioner<S, 1> + Preconditioner<S, 4> + Preconditioner<S, 8>
{
    /// Takes new values on the same pattern; keeps what depends on the pattern only.
    fn update(&mut self, workers: &mut Workers, matrix: Csr<'_>) -> Result<(), PrepareError>;

    /// When to give up.
    fn budget(&self) -> Budget {
        Budget::SIMPLE
    }

    /// Entries stored, and the bytes they take.
    fn size(&self) -> Size;
}

/// Entries of a preconditioner and their bytes as stored.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Size {
    /// Entries of all factors and levels.
    pub(crate) entries: u64,
    /// Bytes of those entries, values and indices.
    pub(crate) bytes: u64,
}

/// When an iteration gives up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Budget {
    /// Most iterations of one solve.
    pub(crate) iterations: u32,
    /// Most iterations without a tenth off the smallest residual seen.
    pub(crate) patience: u32,
}

impl Budget {
    /// For methods whose iterations grow with the mesh: residuals of plain CG may stand still for about the square root
    /// of the condition number, some thousand iterations on the slivered scans of a million triangles.
    pub(crate) const SIMPLE: Self = Self { iterations: 20_000, patience: 3_000 };
    /// For methods that take some tens of iterations, hundreds on the worst meshes.
    pub(crate) const MULTILEVEL: Self = Self { iterations: 2_000, patience: 200 };
}
