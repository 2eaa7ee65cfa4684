//! What a preconditioner is to the Krylov core.

use super::operator::Csr;
use crate::error::PrepareError;

/// z = M^-1 r for rows of W lanes, M symmetric positive definite and the same in every call.
pub(crate) trait Preconditioner<const W: usize>: Send {
    /// Reads `r`, writes all of `z`. No allocation.
    fn apply(&mut self, r: &[[f64; W]], z: &mut [[f64; W]]);
}

/// A preconditioner for every lane width, with its facts.
pub(crate) trait AnyPreconditioner: Preconditioner<1> + Preconditioner<4> + Preconditioner<8> {
    /// Takes new values on the same pattern; keeps what depends on the pattern only.
    fn update(&mut self, matrix: Csr<'_>) -> Result<(), PrepareError>;

    /// True where rounding (a store in f32) makes M^-1 slightly unsymmetric: the core then spends one more dot product
    /// per iteration (Polak-Ribiere instead of Fletcher-Reeves; Golub and Ye 1999) and keeps converging.
    fn is_inexact(&self) -> bool {
        false
    }

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
}
