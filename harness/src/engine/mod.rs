//! The measuring engine: every cell is a process of its own, driven over one small protocol.

pub mod allocation;
pub mod array_file;
pub mod bandwidth;
pub mod check;
pub mod child;
pub mod equations;
pub mod protocol;
pub mod session;
pub mod shuffle;
pub mod solver;
pub mod workspace;
