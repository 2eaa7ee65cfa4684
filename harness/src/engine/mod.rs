//! The measuring engine: every cell is a process of its own, driven over one small protocol.

pub mod allocation;
pub mod array_file;
pub mod bandwidth;
pub mod cell;
pub mod check;
pub mod child;
pub mod contention;
pub mod equations;
pub mod inputs;
pub mod motion;
pub mod plan;
pub mod protocol;
pub mod rounds;
pub mod session;
pub mod settings;
pub mod single;
pub mod solver;
pub mod source;
pub mod task;
pub mod workload;
pub mod workspace;
