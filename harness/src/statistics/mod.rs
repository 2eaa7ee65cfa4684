//! Pure statistics of samples: no clock, no I/O.

pub mod binomial;
pub mod blocks;
pub mod change_points;
pub mod frames;
pub mod median_interval;
pub mod percentiles;
pub mod rank_sum;
pub mod ranking;
