//! Project tasks: `cargo xtask setup`, `cargo xtask test`, `cargo xtask ci`, `cargo xtask shaders`.
//!
//! Everything that is installed lands in a cache folder outside the tree (see [`cache`]) or comes from the system's
//! package manager (see [`system`]); the solvers and the harness themselves need none of it.

mod cache;
mod ci;
mod gate;
mod peers;
mod python;
mod results;
mod shaders;
mod shell;
mod splice;
mod system;
mod test_runs;

use std::process::ExitCode;

use clap::{Args, Parser, Subcommand};

/// The command line of `cargo xtask`.
#[derive(Parser)]
#[command(name = "cargo xtask", about = "Sets up, tests and checks this project")]
struct Cli {
    #[command(subcommand)]
    task: Task,
}

#[derive(Subcommand)]
enum Task {
    /// Install what the tests need: software Vulkan, a browser and the pinned Python references
    Setup {
        /// Also the solvers to compare with: CHOLMOD and Eigen (C++), MKL PARDISO, PyAMG, cholespy, potpourri3d
        #[arg(long)]
        peers: bool,
    },
    /// Compile the Vulkan shaders again, after a change of one
    Shaders,
    /// Set up, then run all tests and doc tests
    Test(TestOptions),
    /// Write the results of a result file into the README, between its markers, and its picture beside it
    Results {
        /// A result file of `lapbench run`, in `bench_results`
        file: std::path::PathBuf,
    },
    /// Simulate gate runs and write the table into METHODOLOGY
    GateSimulation {
        /// Runs under each noise with each truth
        #[arg(long, default_value_t = 1000)]
        runs: usize,
    },
    /// Run the gate on two builds of this tree, one slowed down on purpose; record what it said and write the table into METHODOLOGY
    GateRuns(gate::Runs),
    /// Formatting, lints, documentation, the build without C++ tools, then all tests; warnings are errors
    Ci(TestOptions),
}

/// What decides how the tests treat things that are not there.
#[derive(Args)]
struct TestOptions {
    /// Fail where these are missing instead of skipping: `all`, or some of data,reference,vulkan,peers,browser
    #[arg(long, value_name = "WHAT", num_args = 0..=1, default_missing_value = "all")]
    require: Option<String>,
    /// Install nothing: run with what there is
    #[arg(long)]
    no_setup: bool,
}

fn main() -> ExitCode {
    let outcome = match Cli::parse().task {
        Task::Setup { peers } => setup(peers),
        Task::Results { file } => results::splice(&file),
        Task::GateSimulation { runs } => gate::simulation(runs),
        Task::GateRuns(runs) => gate::runs(&runs),
        Task::Shaders => shaders::regenerate(),
        Task::Test(options) => test_runs::run(&options),
        Task::Ci(options) => ci::run(&options),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("xtask: {error:#}"); // the causes without a backtrace, whatever RUST_BACKTRACE says
            ExitCode::FAILURE
        }
    }
}

fn setup(with_peers: bool) -> anyhow::Result<()> {
    system::install(system::FOR_TESTS)?;
    system::install_optional(system::FOR_BROWSER);
    let python = python::install()?;
    eprintln!("xtask: reference programs run with {}", python.display());
    if with_peers {
        peers::install(&python)?;
    }
    Ok(())
}
