//! Pure statistics of samples: no clock, no I/O.

pub mod autocorrelation;
pub mod binomial;
pub mod bootstrap;
pub mod frames;
pub mod hodges_lehmann;
pub mod normal;
pub mod percentiles;
pub mod random;
pub mod signed_rank;
