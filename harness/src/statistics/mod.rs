//! Pure statistics of samples: no clock, no I/O.

pub mod autocorrelation;
pub mod binomial;
pub mod blocks;
pub mod bootstrap;
pub mod change_points;
pub mod frames;
pub mod hodges_lehmann;
pub mod median_interval;
pub mod normal;
pub mod percentiles;
pub mod random;
pub mod rank_sum;
pub mod ranking;
pub mod signed_rank;
