//! What is solved, from the two papers: each workload turns a mesh into systems and right-hand sides, generic over the
//! [`crate::backend`] traits.

pub mod transfer;
