//! One file or folder per backend. [`crate::registry`] lists them.

pub mod dense;
