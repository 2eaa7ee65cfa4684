//! Measures and validates mesh-Laplacian solvers on real workloads.
