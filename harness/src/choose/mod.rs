//! Which backend for this mesh and this use: measured on the mesh itself, or predicted from a fitted model.
//!
//! ```text
//! question -> candidates -> race (or model) -> figures -> ranking -> explanation, Cargo.toml lines, program
//! ```

pub mod answer;
pub mod cost;
pub mod explain;
pub mod figures;
pub mod model;
pub mod question;
pub mod race;
pub mod ranking;
pub mod rules;
pub mod snippet;
