//! `completions`: shell completions on stdout.

use super::{Cli, Outcome, output};
use crate::exit::Exit;
use clap::CommandFactory;

/// Print completions for a shell
#[derive(Debug, clap::Args)]
pub struct Args {
    /// The shell to complete for
    shell: clap_complete::Shell,
}

/// Prints them.
///
/// # Errors
/// Where stdout cannot be written.
pub fn run(args: &Args) -> Outcome {
    let mut text = Vec::new();
    clap_complete::generate(args.shell, &mut Cli::command(), "lapbench", &mut text);
    output::print(&String::from_utf8_lossy(&text))?;
    Ok(Exit::Ok)
}
