//! The proof: thousands of gate runs on simulated machines, through the same code as the real ones.

pub mod machine;
pub mod noise;
pub mod recorded;
pub mod table;
