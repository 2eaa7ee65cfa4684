//! `poisson`: step 5 of `transfer` alone, L x = U with three columns, grounded.
//!
//! The default right-hand side is the U of the extreme frame of the default motion ([`super::twist`]).

use super::transfer::TransferError;
use super::transfer::defaults::default_problem;
use super::transfer::differential::DifferentialCoordinates;
use super::twist::{EXTREME_FRAME, Twist};
use crate::backend::Backend;
use crate::error::SolveError;
use crate::mesh::TriangleMesh;
use crate::sparse::SymmetricCsr;
use thiserror::Error;

/// Columns of the right-hand side.
pub const COLUMNS: usize = 3;

/// L and U of a mesh that comes alone.
#[derive(Clone, Debug)]
pub struct PoissonInput {
    /// L, n x n; rows of components without a default mark are empty.
    pub laplacian: SymmetricCsr,
    /// U, n x 3; sums to zero over every component.
    pub rhs: Vec<f64>,
}

/// Why there is no default right-hand side.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum PoissonInputError {
    /// The mesh allows no transfer, or the backend cannot prepare it.
    #[error(transparent)]
    Transfer(#[from] TransferError),
    /// The field could not be solved.
    #[error(transparent)]
    Solve(#[from] SolveError),
}

/// The default input: `backend` (a trusted direct one) solves the harmonic field of step 2. Cost: one preparation and
/// one solve with four columns.
///
/// # Errors
/// [`PoissonInputError`].
pub fn default_input(mesh: &TriangleMesh, backend: &dyn Backend) -> Result<PoissonInput, PoissonInputError> {
    let problem = default_problem(mesh)?;
    let mut pose = mesh.positions().to_vec();
    Twist::of(mesh).frame(EXTREME_FRAME, &mut pose);
    let mut differential = DifferentialCoordinates::prepare(backend, &problem, None, &mut |_| {})?;
    differential.compute(&pose)?;
    let rhs = differential.trace().rhs.to_vec();
    Ok(PoissonInput { laplacian: problem.laplacian().matrix().clone(), rhs })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::registry::{OpenOptions, find};

    #[test]
    fn the_default_right_hand_side_is_solvable_and_not_that_of_the_reference_pose() {
        let corners = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 3.0]];
        let mesh =
            TriangleMesh::new(corners, vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]).expect("valid");
        let dense = (find("dense").expect("built in").open)(&OpenOptions::default()).expect("always there");
        let input = default_input(&mesh, &*dense).expect("definite");
        let mut still = vec![0.0; 12];
        let x = crate::columns::Columns::new(mesh.positions().as_flattened(), 4, 3);
        input.laplacian.multiply(x, crate::columns::Columns::new(&mut still, 4, 3));
        for c in 0..3 {
            assert!(input.rhs.iter().skip(c).step_by(3).sum::<f64>().abs() < 1e-14);
        }
        let change = input.rhs.iter().zip(&still).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(change > 0.1, "the extreme frame twists: {change}");
    }
}
