//! `peer`: serves one backend over the peer protocol; what the harness starts for every cell.

use super::{Context, Outcome};
use crate::engine::{child, solver};
use crate::exit::Exit;
use crate::process;
use anyhow::Context as _;

/// Serve a backend over the peer protocol on stdin and stdout (started by `run` for every cell)
#[derive(Debug, clap::Args)]
pub struct Args {
    /// The backend to serve
    #[arg(long, value_name = "ID", required_unless_present = "exec")]
    backend: Option<String>,
    /// Become this foreign program instead (a shell line)
    #[arg(long, value_name = "COMMAND", conflicts_with = "backend")]
    exec: Option<String>,
    /// Cap on the address space, bytes
    #[arg(long, value_name = "BYTES")]
    memory_limit: Option<u64>,
}

/// Serves until stdin ends.
///
/// # Errors
/// An unknown backend, or a limit or program that the system refuses.
pub fn run(args: &Args, context: &Context) -> Outcome {
    process::die_with_parent();
    if let Some(bytes) = args.memory_limit {
        process::limit_memory(bytes).with_context(|| format!("cannot limit memory to {bytes} bytes"))?;
    }
    if let Some(line) = &args.exec {
        solver::become_peer(line)?;
        return Ok(Exit::Ok);
    }
    let id = args.backend.as_deref().unwrap_or_default();
    let Some(entry) = context.backend(id) else { return Ok(context.unknown_backend(id)) };
    child::serve(entry, std::io::stdin().lock(), std::io::stdout().lock())?;
    Ok(Exit::Ok)
}
