//! Results for people: rows of text from result files.

pub mod rows;
pub mod table;
