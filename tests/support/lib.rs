//! Helpers shared by the integration tests.

pub mod needs;
pub mod sheet;
