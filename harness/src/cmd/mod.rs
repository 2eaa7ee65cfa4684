//! The command line: one file per subcommand.
//!
//! A new subcommand is a file with a `clap::Args` struct and a `run`, a `mod` line, a variant of [`Command`] and an arm
//! in `dispatch`. Data goes to stdout through [`output`], everything else to stderr.

pub mod completions;
pub mod list;
pub mod output;

use crate::exit::Exit;
use clap::{Parser, Subcommand};
use lapsolve::registry::{BACKENDS, Entry};
use std::process::ExitCode;

/// What a command returns: how it ended, or an error that is printed with its causes and ends in exit code 1.
pub type Outcome = anyhow::Result<Exit>;

/// Measures and validates mesh-Laplacian solvers on real workloads.
#[derive(Debug, Parser)]
#[command(name = "lapbench", version, propagate_version = true)]
#[command(
    after_help = "Exit codes: 0 all is well; 1 error; 2 usage; 3 slower than allowed; 4 wrong answer; \
    5 no statement (--strict); 6 environments do not match."
)]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    List(list::Args),
    Completions(completions::Args),
}

/// What every command may use besides its arguments.
pub struct Context {
    /// All backends: the built-in ones, then those of the program that called [`main_with`].
    pub backends: Vec<Entry>,
}

impl Context {
    /// The backend of that name.
    pub fn backend(&self, id: &str) -> Option<&Entry> {
        self.backends.iter().find(|entry| entry.id == id)
    }
}

/// The whole program, with `extra` backends beside the built-in ones: parses the command line, runs the command, prints
/// its error or the meaning of its exit code.
///
/// Cells are processes of the running program, so a binary of your own serves its own backends:
/// ```no_run
/// # use lapsolve::registry::Entry;
/// const MINE: Entry = Entry { id: "mine", ..lapsolve::registry::BACKENDS[0] };
/// fn main() -> std::process::ExitCode {
///     lapbench::main_with(&[MINE])
/// }
/// ```
pub fn main_with(extra: &[Entry]) -> ExitCode {
    let cli = Cli::parse();
    let context = Context { backends: BACKENDS.iter().chain(extra).copied().collect() };
    let exit = match dispatch(cli.command, &context) {
        Ok(exit) => exit,
        Err(error) => {
            eprintln!("error: {error:#}");
            Exit::Error
        }
    };
    if exit != Exit::Ok {
        eprintln!("exit {}: {exit}", exit.code());
    }
    exit.into()
}

fn dispatch(command: Command, context: &Context) -> Outcome {
    match command {
        Command::List(args) => list::run(&args, context),
        Command::Completions(args) => completions::run(&args),
    }
}
