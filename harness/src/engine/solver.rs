//! What fills the backend column: a built-in backend or a foreign program, and the command that starts its process.

use crate::process;
use anyhow::Context;
use lapsolve::registry::Entry;
use std::path::PathBuf;
use std::process::Command;

/// A solver to measure.
#[derive(Clone, Debug)]
pub enum Solver {
    /// A backend of this program, served by `lapbench peer --backend ID`.
    BuiltIn(Entry),
    /// Another program that speaks the protocol.
    Foreign(Peer),
}

/// A foreign solver: `NAME=COMMAND`, the command being a shell line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Peer {
    /// Its name in results.
    pub name: String,
    /// The shell line that starts it.
    pub command: String,
}

impl std::str::FromStr for Peer {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.split_once('=') {
            Some((name, command)) if !name.trim().is_empty() && !command.trim().is_empty() => {
                Ok(Self { name: name.trim().to_owned(), command: command.trim().to_owned() })
            }
            _ => Err("expected NAME=COMMAND, for example eigen='./eigen_peer --llt'".to_owned()),
        }
    }
}

/// Environment variables by which libraries take their number of threads; set for every child, so that a peer's BLAS,
/// OpenMP, rayon or lavapipe uses what the cell says.
const THREAD_VARIABLES: [&str; 6] = [
    "RAYON_NUM_THREADS",
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
    "LP_NUM_THREADS",
];

impl Solver {
    /// The name in results.
    pub fn name(&self) -> &str {
        match self {
            Solver::BuiltIn(entry) => entry.id,
            Solver::Foreign(peer) => &peer.name,
        }
    }

    /// The command that serves it with `threads` threads and, if given, a cap on its address space. Foreign programs are
    /// started through this program too, which sets the cap and the tie to the parent before it becomes them.
    ///
    /// # Errors
    /// Where the path of this program is unknown.
    pub fn command(&self, threads: usize, memory_limit: Option<u64>) -> anyhow::Result<Command> {
        let mut command = Command::new(this_program()?);
        command.arg("peer");
        if let Some(bytes) = memory_limit {
            command.args(["--memory-limit", &bytes.to_string()]);
        }
        match self {
            Solver::BuiltIn(entry) => command.args(["--backend", entry.id]),
            Solver::Foreign(peer) => command.args(["--exec", &peer.command]),
        };
        for variable in THREAD_VARIABLES {
            command.env(variable, threads.to_string());
        }
        Ok(command)
    }
}

fn this_program() -> anyhow::Result<PathBuf> {
    std::env::current_exe().context("the path of this program is not known")
}

/// Becomes the foreign program `line` (a shell line); returns only if that fails.
///
/// # Errors
/// Where there is no shell.
pub fn become_peer(line: &str) -> anyhow::Result<()> {
    process::die_with_parent();
    #[cfg(unix)]
    {
        let error = std::os::unix::process::CommandExt::exec(
            Command::new("sh").arg("-c").arg(format!("exec {line}")),
        );
        Err(error).context("cannot start `sh`")
    }
    #[cfg(not(unix))]
    anyhow::bail!("foreign peers need a Unix shell: {line}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn peers_have_a_name_and_a_command() {
        let peer: Peer = "eigen=python3 x.py --a=b".parse().unwrap();
        assert_eq!((peer.name.as_str(), peer.command.as_str()), ("eigen", "python3 x.py --a=b"));
        assert!(
            "eigen".parse::<Peer>().is_err()
                && "=x".parse::<Peer>().is_err()
                && "x= ".parse::<Peer>().is_err()
        );
    }
}
