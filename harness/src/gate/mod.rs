//! The regression gate: is `head` slower than `base`, on this machine, today?
//!
//! ```text
//! cells -> laboratory (processes in couples ABBA) -> series -> evidence -> verdict -> repetition -> report
//! ```
//! Both sides run interleaved, in fresh processes. A couple is A B B A or B A A B; its difference is the mean log time of
//! the B slots minus that of the A slots, so a linear drift cancels. Looks at the data are fixed beforehand
//! ([`rules`]); what they may conclude stands in [`verdict`]. In front of the times stand counters, which have no noise
//! ([`counters`]).

pub mod aa;
pub mod bench;
pub mod builds;
pub mod cell;
pub mod control;
pub mod counters;
pub mod couple;
pub mod evidence;
pub mod laboratory;
pub mod neighbours;
pub mod output;
pub mod report;
pub mod rules;
pub mod run;
pub mod sequence;
pub mod series;
pub mod side;
pub mod simulation;
pub mod verdict;
