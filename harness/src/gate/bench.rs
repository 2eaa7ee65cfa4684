//! Where couples come from: this machine, or a simulation of one. The sequence of looks is the same code for both.

use super::couple::{Couple, Side};
use crate::record::names::Status;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// A source of couples.
pub trait Bench {
    /// Time since the gate began.
    fn elapsed(&self) -> Duration;

    /// Runs couple number `round` of case `case`, with the copy of the base program where that is asked for.
    ///
    /// # Errors
    /// The first process that crashed or answered wrongly; the couple is void then.
    fn couple(&mut self, case: usize, round: usize, with_copy: bool) -> Result<Couple, Fault>;
}

/// A process that crashed, gave no answer or a wrong one.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Fault {
    /// Whose.
    pub side: Side,
    /// How it ended.
    pub status: Status,
    /// Why.
    pub reason: String,
}
