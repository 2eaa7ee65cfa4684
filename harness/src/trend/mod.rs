//! How cells developed over recorded results.

pub mod plot;
pub mod series;
