//! `transfer`: a moving template drives a target mesh (VA section 4), the whole frame.
//!
//! ```text
//! template vertices -> 1 rotations of the marked triangles          marks
//!                   -> 2 harmonic field of quaternions              a Harmonic handle, 4 columns
//!                   -> 3 rotation of every triangle                 fragments
//!                   -> 4 their differential coordinates U           fragments
//!                   -> 5 L x' = U, one translation per component    a Poisson handle, 3 columns; place
//! ```
//! A [`TransferProblem`] is everything known before the first frame; [`Transfer`] does frames on the CPU around any
//! backend's handles. A backend with frames of its own is asked first: [`prepare`].

pub mod alignment;
pub mod defaults;
pub mod differential;
pub mod fragments;
mod frame;
pub mod marks;
mod pieces;
pub(crate) mod placement;
pub(crate) mod posing;
mod prediction;
#[cfg(test)]
pub(crate) mod tests;

pub use frame::Transfer;
pub use pieces::{Detached, Pieces};

use crate::backend::{Backend, Phase, PrepareOptions, TransferFrame};
use crate::dirichlet::{Dirichlet, DirichletError};
use crate::error::PrepareError;
use crate::laplacian::{Laplacian, Weights};
use crate::mesh::TriangleMesh;
use crate::poisson::PoissonError;
use marks::Marks;
use thiserror::Error;

/// Everything a `transfer` preparation needs, worked out once.
///
/// Components of the target without a mark are *detached*: they stay out of both systems (their rows of L are empty) and
/// follow the nearest vertex of a marked component rigidly.
#[derive(Clone, Debug)]
pub struct TransferProblem {
    target: TriangleMesh,
    marks: Marks,
    laplacian: Laplacian,
    harmonic: Dirichlet,
    pieces: Pieces,
}

/// Why meshes and marks do not make a transfer.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum TransferError {
    /// No correspondence at all.
    #[error("no correspondences: mark at least one triangle of the template and one of the target")]
    NoMarks,
    /// A pair names a triangle that does not exist.
    #[error(
        "correspondence {pair}: {side} triangle {triangle} does not exist, the {side} has {triangles} triangles (0-based)"
    )]
    OutOfRange {
        /// 0-based pair.
        pair: usize,
        /// "template" or "target".
        side: &'static str,
        /// The index.
        triangle: u32,
        /// Number of triangles on that side.
        triangles: usize,
    },
    /// A pair names a triangle without area: it has no rotation.
    #[error("correspondence {pair}: {side} triangle {triangle} has zero area; mark another one")]
    ZeroArea {
        /// 0-based pair.
        pair: usize,
        /// "template" or "target".
        side: &'static str,
        /// The index.
        triangle: u32,
    },
    /// Weights that cannot be split among the corners of the mesh's own triangles.
    #[error(
        "{weights:?} weights do not belong to the triangles of the mesh; transfer takes plain or per-corner clamped ones"
    )]
    Weights {
        /// What was asked for.
        weights: Weights,
    },
    /// The target's Laplacian is not acceptable.
    #[error(transparent)]
    Dirichlet(#[from] DirichletError),
    /// The backend failed.
    #[error(transparent)]
    Prepare(#[from] PrepareError),
}

impl From<PoissonError> for TransferError {
    fn from(error: PoissonError) -> Self {
        match error {
            PoissonError::Dirichlet(error) => Self::Dirichlet(error),
            PoissonError::Prepare(error) => Self::Prepare(error),
        }
    }
}

impl TransferProblem {
    /// Checks the correspondences (template triangle, target triangle), aligns the reference poses and assembles L.
    /// `weights` must be [`Weights::Plain`] or [`Weights::ClampedPerCorner`].
    ///
    /// # Errors
    /// [`TransferError`] naming the pair.
    pub fn new(
        template: &TriangleMesh,
        target: TriangleMesh,
        pairs: &[(u32, u32)],
        weights: Weights,
    ) -> Result<Self, TransferError> {
        if !matches!(weights, Weights::Plain | Weights::ClampedPerCorner) {
            return Err(TransferError::Weights { weights });
        }
        let marks = Marks::new(template, &target, pairs)?;
        let (laplacian, pieces) = pieces::split(&target, &marks, weights);
        let harmonic =
            Dirichlet::new(laplacian.matrix().clone(), Some(target.positions()), marks.vertices())?;
        Ok(Self { target, marks, laplacian, harmonic, pieces })
    }

    /// The target in its reference pose.
    pub fn target(&self) -> &TriangleMesh {
        &self.target
    }

    /// The marks with their alignment.
    pub fn marks(&self) -> &Marks {
        &self.marks
    }

    /// L over all vertices of the target; rows of detached components and unused vertices are empty.
    pub fn laplacian(&self) -> &Laplacian {
        &self.laplacian
    }

    /// The system of step 2: L split by the vertices of the marked triangles.
    pub fn harmonic(&self) -> &Dirichlet {
        &self.harmonic
    }

    /// Components and what becomes of their vertices.
    pub fn pieces(&self) -> &Pieces {
        &self.pieces
    }
}

/// Prepares frames: the backend's own if it has them, else [`Transfer`] around its handles. `options.order` is ignored.
///
/// # Errors
/// [`TransferError::Prepare`] with what the backend says.
pub fn prepare(
    backend: &dyn Backend,
    problem: &TransferProblem,
    options: &PrepareOptions<'_>,
    on: &mut dyn FnMut(Phase),
) -> Result<Box<dyn TransferFrame>, TransferError> {
    match backend.prepare_transfer(problem, options, on)? {
        Some(frames) => Ok(frames),
        None => Ok(Box::new(Transfer::prepare(backend, problem, on)?)),
    }
}
