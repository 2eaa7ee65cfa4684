//! Results as data: what a result file holds, how it is written, read and compared.

pub mod file;
pub mod names;
pub mod rate;
pub mod result;
