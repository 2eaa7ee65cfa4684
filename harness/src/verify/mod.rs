//! Is an answer right? Residuals recomputed in twice the precision, distances from a refined solution, limits from one
//! table ([`lapsolve::limits`]), and the cases whose answers are known on paper.
//!
//! What a backend says about itself counts for nothing here. [`solution`] checks one answer, with a [`mod@reference`];
//! [`suite`] puts the named checks together that `lapbench validate` runs.

pub mod agreement;
pub mod analytic;
pub mod arap;
pub mod behaviour;
pub mod condition;
pub mod conventions;
pub mod equations;
pub mod finding;
pub mod geodesic;
pub mod matrix;
pub mod motion;
#[cfg(feature = "mutants")]
pub mod mutants;
pub mod noise;
pub mod reference;
pub mod refined;
pub mod skinning;
pub mod smoothing;
pub mod solution;
pub mod subject;
pub mod suite;
