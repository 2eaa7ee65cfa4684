//! What makes figures of a machine doubtful and backends unavailable, each with what to do about it.

pub mod finding;
pub mod machine;
pub mod noise;
pub mod software;
pub mod triad;
pub mod vulkan;
