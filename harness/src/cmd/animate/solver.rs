//! Which backend works for an animation.

use crate::cmd::Context;
use anyhow::{anyhow, bail};
use lapsolve::backend::Backend;
use lapsolve::registry::OpenOptions;

/// The backend and its threads.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Solver")]
pub struct SolverArgs {
    /// The backend
    #[arg(long, value_name = "ID", default_value = "framechol-f64")]
    pub backend: String,
    /// Threads of a frame [default: all cores]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
    /// Relative residual asked of iterative backends
    #[arg(long, value_name = "TOL", default_value_t = lapsolve::limits::DEFAULT_TOLERANCE)]
    pub tol: f64,
    /// Vulkan device: index or part of its name
    #[arg(long, value_name = "DEVICE")]
    pub device: Option<String>,
}

impl SolverArgs {
    /// Opens the backend.
    ///
    /// # Errors
    /// An unknown name, or what is missing.
    pub fn open(&self, context: &Context) -> anyhow::Result<Box<dyn Backend>> {
        let Some(entry) = context.backend(&self.backend) else {
            let ids: Vec<&str> = context.backends.iter().map(|entry| entry.id).collect();
            bail!("there is no backend `{}`; there are {}", self.backend, ids.join(", "));
        };
        let options =
            OpenOptions { threads: self.threads(), tolerance: self.tol, device: self.device.as_deref() };
        (entry.open)(&options).map_err(|missing| anyhow!("{}: {missing}", self.backend))
    }

    /// Threads asked for, or all cores.
    pub fn threads(&self) -> usize {
        let all = || std::thread::available_parallelism().map_or(1, usize::from);
        self.threads.map_or_else(all, usize::from)
    }
}
