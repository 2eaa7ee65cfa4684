//! The measuring engine: every cell is a process of its own, driven over one small protocol.

pub mod allocation;
pub mod array_file;
pub mod child;
pub mod protocol;
pub mod session;
