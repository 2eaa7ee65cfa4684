//! The command line: one file per subcommand.
//!
//! A new subcommand is a file with a `clap::Args` struct and a `run`, a `mod` line, a variant of `Command` and an arm
//! in `dispatch`. Data goes to stdout through [`output`], everything else to stderr.

pub mod animate;
pub mod choose;
pub mod compare;
pub mod completions;
pub mod cost_model;
pub mod doctor;
pub mod gate;
pub mod kharmonic;
pub mod list;
pub mod matrix;
pub mod merge;
pub mod output;
pub mod peer;
pub mod render;
pub mod report;
pub mod run;
pub mod schema;
pub mod solve;
pub mod trend;
pub mod validate;

use crate::exit::Exit;
use clap::{Parser, Subcommand};
use lapsolve::registry::{BACKENDS, Entry};
use std::process::ExitCode;

/// What a command returns: how it ended, or an error that is printed with its causes and ends in exit code 1.
pub type Outcome = anyhow::Result<Exit>;

/// Measures and validates mesh-Laplacian solvers on real workloads. Without a command: `run`, the default suite.
#[derive(Debug, Parser)]
#[command(name = "lapbench", version, propagate_version = true)]
#[command(
    after_help = "Exit codes: 0 all is well; 1 error; 2 usage; 3 slower than allowed; 4 wrong answer; \
    5 no statement (--strict); 6 environments do not match."
)]
pub struct Cli {
    #[command(subcommand)]
    command: Option<Command>,
}

#[derive(Debug, Subcommand)]
enum Command {
    Run(Box<run::Args>),
    Solve(solve::Args),
    Validate(validate::Args),
    Matrix(matrix::Args),
    Render(render::Args),
    Kharmonic(kharmonic::Args),
    Report(report::Args),
    Merge(merge::Args),
    Animate(animate::Args),
    Compare(compare::Args),
    Trend(trend::Args),
    Choose(Box<choose::Args>),
    CostModel(cost_model::Args),
    Gate(Box<gate::Args>),
    List(list::Args),
    Doctor(doctor::Args),
    Schema(schema::Args),
    Peer(peer::Args),
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

    /// Says that there is no backend of that name, and which ones there are.
    pub fn unknown_backend(&self, id: &str) -> Exit {
        let ids: Vec<&str> = self.backends.iter().map(|entry| entry.id).collect();
        eprintln!("error: there is no backend `{id}`; there are {}", ids.join(", "));
        Exit::Usage
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
    let command = cli.command.or_else(|| Cli::parse_from(["lapbench", "run"]).command);
    let exit = match command.map_or(Ok(Exit::Ok), |command| dispatch(command, &context)) {
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
        Command::Run(args) => run::run(&args, context),
        Command::Solve(args) => solve::run(&args, context),
        Command::Validate(args) => validate::run(&args, context),
        Command::Matrix(args) => matrix::run(&args, context),
        Command::Render(args) => render::run(&args),
        Command::Kharmonic(args) => kharmonic::run(&args, context),
        Command::Report(args) => report::run(&args),
        Command::Merge(args) => merge::run(&args),
        Command::Animate(args) => animate::run(&args, context),
        Command::Compare(args) => compare::run(&args),
        Command::Trend(args) => trend::run(&args),
        Command::Choose(args) => choose::run(&args, context),
        Command::CostModel(args) => cost_model::run(&args, context),
        Command::Gate(args) => gate::run(&args, context),
        Command::Doctor(args) => doctor::run(&args, context),
        Command::Schema(args) => schema::run(&args),
        Command::Peer(args) => peer::run(&args, context),
        Command::List(args) => list::run(&args, context),
        Command::Completions(args) => completions::run(&args),
    }
}
