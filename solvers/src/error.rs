//! What can go wrong in a backend, with the data to act on it.

use crate::system::SystemError;
use thiserror::Error;

/// Why a backend cannot be opened on this machine or in this build.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("{what}: {how_to_get_it}")]
pub struct Unavailable {
    /// What is missing.
    pub what: String,
    /// What to install, enable or set.
    pub how_to_get_it: String,
}

impl Unavailable {
    /// The crate was built without a cargo feature.
    pub fn feature(name: &str) -> Self {
        Self {
            what: format!("built without the feature `{name}`"),
            how_to_get_it: format!("build lapsolve with `--features {name}`"),
        }
    }
}

/// Why a system could not be prepared.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum PrepareError {
    /// A pivot is zero or negative: the matrix is not positive definite (to working precision).
    #[error("the matrix is not positive definite: elimination breaks down at row {row}")]
    NotPositiveDefinite {
        /// 0-based row of the system.
        row: usize,
    },
    /// Memory is not enough.
    #[error("out of memory: {bytes} bytes could not be had; choose an iterative backend or a smaller mesh")]
    OutOfMemory {
        /// Bytes asked for.
        bytes: u64,
    },
    /// A value is NaN or infinite, or became so.
    #[error("row {row} of the matrix holds or produces a value that is not finite")]
    NonFinite {
        /// 0-based row of the system.
        row: usize,
    },
    /// The backend does not do this.
    #[error("not supported: {what}")]
    Unsupported {
        /// What was asked for, and why not.
        what: String,
    },
    /// The system itself is not acceptable.
    #[error(transparent)]
    System(#[from] SystemError),
    /// The device was lost or its driver failed.
    #[error("the device was lost: {what}")]
    DeviceLost {
        /// The driver's words.
        what: String,
    },
}

/// Why a prepared handle could not deliver a solution.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum SolveError {
    /// The tolerance was not reached; the best iterate is in place.
    #[error("not converged: relative residual {residual:.2e} after {iterations} iterations")]
    NotConverged {
        /// Iterations done (the largest over the columns).
        iterations: u32,
        /// Relative residual of the worst column, as the backend sees it.
        residual: f64,
    },
    /// The right-hand side or the result is not finite.
    #[error("row {row} of the right-hand side or of the solution is not finite")]
    NonFinite {
        /// 0-based row of the system.
        row: usize,
    },
    /// The device was lost or its driver failed.
    #[error("the device was lost: {what}")]
    DeviceLost {
        /// The driver's words.
        what: String,
    },
}

/// Why constraints could not be edited in place.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum EditError {
    /// The handle cannot edit constraints; prepare anew.
    #[error("this backend cannot edit constraints; prepare a new handle")]
    Unsupported,
    /// A vertex to add is out of range, absent or constrained already; or one to remove is not constrained.
    #[error("vertex {vertex} cannot be {action}")]
    Vertex {
        /// 0-based vertex.
        vertex: u32,
        /// "added" or "removed".
        action: &'static str,
    },
    /// A component would lose its last constraint.
    #[error("without vertex {vertex} its component has no constraint left")]
    Unconstrained {
        /// The vertex that must stay.
        vertex: u32,
    },
    /// The change is too large for an update, or the corrected matrix lost definiteness.
    #[error(transparent)]
    Prepare(#[from] PrepareError),
}
