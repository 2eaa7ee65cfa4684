//! Factor a mesh Laplacian once, solve it in every frame.
//!
//! ```text
//! mesh -> laplacian -> dirichlet -> system -> backend (prepare) -> factor (solve, frame after frame)
//! ```
//! Conventions, everywhere: L is the **positive** semi-definite cotangent stiffness matrix, L_ij = -(cot a + cot b) / 2;
//! blocks of vectors are vertex-major ([`columns`]); symmetric matrices store their upper triangle by rows ([`sparse`]);
//! indices are 0-based `u32`; numbers are f64 at every border. This crate does no I/O, reads no clock and prints nothing.

pub mod aligned;
pub mod backend;
pub mod backends;
pub mod columns;
pub mod conformance;
pub mod devices;
pub mod dirichlet;
pub mod error;
pub mod incidence;
pub mod intrinsic;
pub mod isa;
pub mod lanes;
pub mod laplacian;
pub mod limits;
pub mod mass;
pub mod mesh;
pub mod ordering;
pub mod poisson;
pub mod range;
pub mod registry;
pub mod residual;
pub mod rigid;
pub mod rotation;
pub mod sparse;
pub mod system;
pub mod team;
pub mod tile;
pub mod topology;
pub mod triangle;
pub mod triangle_tree;
pub mod vector;
pub mod workload;

/// The example in the README is compiled and run with the documentation tests.
#[cfg(doctest)]
#[doc = include_str!("../../README.md")]
pub struct Readme;
