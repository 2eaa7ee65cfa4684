//! What is solved, from the two papers: each workload turns a mesh into systems and right-hand sides, generic over the
//! [`crate::backend`] traits.

pub mod arap;
pub mod geodesic;
pub mod harmonic;
pub mod kharmonic;
pub mod matrix;
pub mod poisson;
pub mod sampling;
pub mod screened;
pub mod skinning;
pub mod smoothing;
pub mod transfer;
pub mod twist;
pub mod vertex_system;
pub mod volume;
