//! The volume that a surface encloses, and the surface moved outwards or inwards until it encloses another one.
//!
//! ```text
//! V(x) = 1/6 sum over triangles (a, b, c) of x_a . (x_b x x_c)            the divergence theorem
//! V(x + s d) = V + s V1 + s^2 V2 + s^3 V3                                 exactly, whatever the directions d
//! ```
//! [`Enclosure`] is V with the small holes of scans closed; [`Inflation`] finds s.

mod enclosure;
mod inflation;
#[cfg(test)]
mod tests;

pub use enclosure::Enclosure;
pub use inflation::Inflation;

use crate::error::{PrepareError, SolveError};
use crate::system::SystemError;
use thiserror::Error;

/// Why a surface has no volume, or not the one that is asked for.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum VolumeError {
    /// Too many edges belong to one triangle only.
    #[error("the surface is open ({edges} edges lack a triangle on one side): it encloses no volume")]
    Open {
        /// Directed edges without a partner.
        edges: usize,
    },
    /// The cones of all triangles cancel, or their volume is no number.
    #[error("the surface encloses a volume of {volume}")]
    Nothing {
        /// What they sum to.
        volume: f64,
    },
    /// The system of the directions is not acceptable.
    #[error(transparent)]
    System(#[from] SystemError),
    /// The backend cannot prepare it.
    #[error(transparent)]
    Prepare(#[from] PrepareError),
    /// The backend cannot solve it.
    #[error(transparent)]
    Solve(#[from] SolveError),
    /// The system refuses a thread.
    #[error("no threads to move the surface with ({why})")]
    Threads {
        /// What it says.
        why: String,
    },
    /// The surface would have to be turned inside out.
    #[error("no step along the normals takes the volume from {volume} to {wanted}")]
    Unreachable {
        /// Where it starts.
        volume: f64,
        /// What was asked for.
        wanted: f64,
    },
}
