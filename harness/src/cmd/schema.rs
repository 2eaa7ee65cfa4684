//! `schema`: the JSON Schema of result files.

use super::{Outcome, output};
use crate::exit::Exit;
use crate::record::result::ResultFile;

/// Print the JSON Schema of result files
#[derive(Debug, clap::Args)]
pub struct Args {}

/// Prints it.
///
/// # Errors
/// Where stdout cannot be written.
pub fn run(_: &Args) -> Outcome {
    output::print(&serde_json::to_string_pretty(&schemars::schema_for!(ResultFile))?)?;
    Ok(Exit::Ok)
}
