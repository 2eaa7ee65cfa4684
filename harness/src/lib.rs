//! Measures and validates mesh-Laplacian solvers on real workloads.
pub mod file;
pub mod mesh_io;
pub mod mesh_source;
