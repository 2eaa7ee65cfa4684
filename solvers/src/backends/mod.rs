//! One file or folder per backend. [`crate::registry`] lists them.

pub mod cg;
pub mod dense;
#[cfg(feature = "faer")]
pub mod faer;
pub mod framechol;
pub mod multigrid;
#[cfg(feature = "nalgebra")]
pub mod nalgebra;
#[cfg(any(feature = "nalgebra", feature = "sprs-ldl"))]
mod permuted;
#[cfg(feature = "sprs")]
pub mod sprs_cg;
#[cfg(feature = "sprs-ldl")]
pub mod sprs_ldl;
#[cfg(feature = "vulkan")]
pub mod vulkan;
