//! Measures and validates mesh-Laplacian solvers on real workloads.
//!
//! ```text
//! mesh -> system -> prepared handle (a process of its own) -> frames -> record -> report
//! ```
//! [`main_with`] is the whole program; give it backends of your own and they stand in every command beside the
//! built-in ones, under the same checks.

pub mod animation;
pub mod body;
pub mod cache;
pub mod choose;
pub mod cmd;
pub mod doctor;
pub mod engine;
pub mod environment;
pub mod exit;
pub mod file;
pub mod gate;
pub mod mesh_io;
pub mod mesh_source;
pub mod peers;
pub mod process;
pub mod record;
pub mod reference;
pub mod render;
pub mod report;
pub mod shapes;
pub mod statistics;
pub mod subdivision;
pub mod trend;
pub mod vector;
pub mod verify;

pub use cmd::main_with;
