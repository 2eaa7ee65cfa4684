//! Is an answer right? Residuals recomputed in twice the precision, distances from a refined solution, limits from one
//! table ([`lapsolve::limits`]), and the cases whose answers are known on paper.
//!
//! What a backend says about itself counts for nothing here.

pub mod condition;
pub mod reference;
pub mod solution;
