//! The measuring engine: every cell is a process of its own, driven over one small protocol.

pub mod allocation;
