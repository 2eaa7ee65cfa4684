//! Results as data: what a result file holds, how it is written, read and compared.

pub mod names;
