//! Pure statistics of samples: no clock, no I/O.

pub mod binomial;
pub mod frames;
pub mod median_interval;
pub mod percentiles;
pub mod ranking;
