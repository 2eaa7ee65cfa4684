//! One report, many readers.

pub mod annotations;
pub mod bencher;
pub mod benchmark_action;
pub mod junit;
pub mod markdown;
pub mod table;
