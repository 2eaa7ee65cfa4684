//! Results for people: rows of text from result files.

pub mod chart;
pub mod html;
pub mod junit;
pub mod markdown;
pub mod numbers;
pub mod ranking;
pub mod rows;
pub mod table;
pub mod view;
pub mod wording;
