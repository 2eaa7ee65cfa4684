//! What fills the backend column: a built-in backend or a foreign program, and the command that starts its process.

use super::session::Failure;
use crate::peers;
use crate::process;
use crate::record::names::{Division, Status};
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
    /// A backend of another build of this program.
    Build(Build),
}

/// A backend of another build of this program.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Build {
    /// The backend.
    pub id: String,
    /// The program.
    pub program: PathBuf,
}

/// A foreign solver: one of the catalogue by its name, or any program as `NAME=COMMAND`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Peer {
    /// Its name in results.
    pub name: String,
    /// The shell line that starts it, or what is not installed.
    pub command: Result<String, String>,
    /// Whether its settings are defaults or tuned, as the catalogue says.
    pub division: Option<Division>,
}

impl Peer {
    /// The peer of the catalogue ([`peers`]) with that name.
    pub fn known(name: &str) -> Option<Self> {
        peers::find(name).map(|peer| Self {
            name: peer.id.clone(),
            command: peer.command(),
            division: peer.division,
        })
    }
}

impl std::str::FromStr for Peer {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if let Some(known) = Self::known(text) {
            return Ok(known);
        }
        match text.split_once('=').map(|(name, command)| (name.trim(), command.trim())) {
            Some((name, command)) if !name.is_empty() && !command.is_empty() => {
                Ok(Self { name: name.to_owned(), command: Ok(command.to_owned()), division: None })
            }
            _ => {
                Err("expected a peer of `lapbench list` or NAME=COMMAND, for example mine='./solver --fast'"
                    .into())
            }
        }
    }
}

/// Environment variables by which libraries take their number of threads; set for every child, so that a peer's BLAS,
/// OpenMP or rayon uses what the cell says.
const THREAD_VARIABLES: [&str; 5] = [
    "RAYON_NUM_THREADS",
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
];

/// The same for lavapipe, which counts threads besides the one that submits: with none that one computes, and handing work
/// over costs nothing; more than one are a pool.
const LAVAPIPE_THREADS: &str = "LP_NUM_THREADS";

impl Solver {
    /// The name in results.
    pub fn name(&self) -> &str {
        match self {
            Solver::BuiltIn(entry) => entry.id,
            Solver::Foreign(peer) => &peer.name,
            Solver::Build(build) => &build.id,
        }
    }

    /// Whether its settings are defaults or tuned. Our own backends are all tuned: we know the work they do here.
    pub fn division(&self) -> Option<Division> {
        match self {
            Solver::BuiltIn(_) | Solver::Build(_) => Some(Division::Open),
            Solver::Foreign(peer) => peer.division,
        }
    }

    /// The command that serves it with `threads` threads and, if given, a cap on its address space. Foreign programs are
    /// started through this program too, which sets the cap and the tie to the parent before it becomes them.
    ///
    /// # Errors
    /// `unavailable` for a peer that is not installed, `error` where the path of this program is unknown.
    pub fn command(&self, threads: usize, memory_limit: Option<u64>) -> Result<Command, Failure> {
        let mut command = match self {
            Solver::Build(build) => Command::new(&build.program),
            _ => Command::new(std::env::current_exe().map_err(|error| {
                Failure::new(Status::Error, format!("the path of this program is not known: {error}"))
            })?),
        };
        command.arg("peer");
        if let Some(bytes) = memory_limit {
            command.args(["--memory-limit", &bytes.to_string()]);
        }
        match self {
            Solver::BuiltIn(_) | Solver::Build(_) => command.args(["--backend", self.name()]),
            Solver::Foreign(Peer { command: Ok(line), .. }) => command.args(["--exec", line]),
            Solver::Foreign(Peer { command: Err(missing), .. }) => {
                return Err(Failure::new(Status::Unavailable, missing.as_str()));
            }
        };
        for variable in THREAD_VARIABLES {
            command.env(variable, threads.to_string());
        }
        command.env(LAVAPIPE_THREADS, if threads > 1 { threads.to_string() } else { "0".into() });
        Ok(command)
    }
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
        assert_eq!(
            peer,
            Peer { name: "eigen".into(), command: Ok("python3 x.py --a=b".into()), division: None }
        );
        assert_eq!("eigen-llt".parse::<Peer>().unwrap().name, "eigen-llt");
        assert!(
            "eigen".parse::<Peer>().is_err()
                && "=x".parse::<Peer>().is_err()
                && "x= ".parse::<Peer>().is_err()
        );
    }
}
