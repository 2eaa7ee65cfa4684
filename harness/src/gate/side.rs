//! The two programs: builds of this one, or foreign solvers.

use super::cell::Case;
use crate::engine::session::one_line;
use crate::engine::solver::{Build, Peer, Solver};
use crate::environment::BuildRecord;
use anyhow::{Context, bail};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::mpsc;
use std::time::Duration;

/// A program to compare.
#[derive(Clone, Debug)]
pub enum Program {
    /// A build of this program, with what it says of itself.
    Build {
        /// Where it is.
        path: PathBuf,
        /// Its backends.
        inventory: Inventory,
    },
    /// A foreign solver.
    Foreign(Peer),
}

/// What `list --format json` of a build says.
#[derive(Clone, Debug, Deserialize)]
pub struct Inventory {
    backends: Vec<Listed>,
    /// How it was built; builds from before there was a gate do not say.
    #[serde(default)]
    pub build: Option<BuildRecord>,
}

#[derive(Clone, Debug, Deserialize)]
struct Listed {
    id: String,
    available: bool,
    reason: Option<String>,
}

/// Longest wait for a program's list: it opens every backend, a Vulkan loader among them.
const LIST_TIMEOUT: Duration = Duration::from_secs(60);

/// Longest list that is read, bytes.
const LONGEST_LIST: u64 = 16 << 20;

impl Program {
    /// Asks the build at `path` what it has.
    ///
    /// # Errors
    /// Where it cannot be started or is no build of this program.
    pub fn build(path: &Path) -> anyhow::Result<Self> {
        let path = path.canonicalize().with_context(|| format!("{}: no such program", path.display()))?;
        let text = list(&path)?;
        let inventory = serde_json::from_slice(&text).with_context(|| {
            let start = one_line(&String::from_utf8_lossy(&text[..text.len().min(80)]));
            format!("{}: `list --format json` gave no list of backends but \"{start}\"", path.display())
        })?;
        Ok(Self::Build { path, inventory })
    }

    /// A foreign solver of the catalogue, `NAME=COMMAND`, or a plain command.
    ///
    /// # Errors
    /// What is not installed.
    pub fn foreign(text: &str) -> anyhow::Result<Self> {
        let peer = text.parse().unwrap_or_else(|_| Peer {
            name: text.to_owned(),
            command: Ok(text.to_owned()),
            division: None,
        });
        match peer.command {
            Ok(_) => Ok(Self::Foreign(peer)),
            Err(missing) => bail!("{}: {missing}", peer.name),
        }
    }

    /// How it is named in reports.
    pub fn name(&self) -> String {
        match self {
            Self::Build { path, .. } => path.display().to_string(),
            Self::Foreign(peer) => peer.name.clone(),
        }
    }

    /// How it was built, if it says so.
    pub fn record(&self) -> Option<&BuildRecord> {
        match self {
            Self::Build { inventory, .. } => inventory.build.as_ref(),
            Self::Foreign(_) => None,
        }
    }

    /// Why it cannot serve `case`, if so: no such backend, or one that does not open here.
    pub fn lacks(&self, case: &Case) -> Option<String> {
        let (Self::Build { inventory, .. }, Some(id)) = (self, &case.backend) else { return None };
        match inventory.backends.iter().find(|listed| &listed.id == id) {
            None => Some(format!("it has no backend `{id}`")),
            Some(listed) if listed.available => None,
            Some(listed) => Some(listed.reason.clone().unwrap_or_else(|| "not available here".into())),
        }
    }

    /// What serves `case`; a build is taken from `path` where that is given (its copy).
    pub fn solver(&self, case: &Case, copy: Option<&Path>) -> Solver {
        match self {
            Self::Foreign(peer) => Solver::Foreign(peer.clone()),
            Self::Build { path, .. } => Solver::Build(Build {
                id: case.backend.clone().unwrap_or_default(),
                program: copy.unwrap_or(path).to_owned(),
            }),
        }
    }

    /// A copy of it in `folder`, at another place on disk and in memory. Scripts and foreign solvers stay where they are: what
    /// they start is found from there.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn copy(&self, folder: &Path) -> std::io::Result<Option<PathBuf>> {
        let Self::Build { path, .. } = self else { return Ok(None) };
        let mut start = [0; 2];
        if std::fs::File::open(path)?.read(&mut start)? == 2 && &start == b"#!" {
            return Ok(None);
        }
        let copy = folder.join("copy-of-base");
        std::fs::copy(path, &copy)?;
        Ok(Some(copy))
    }
}

/// In what the two builds differ that decides about speed and is not the change: compiler, flags, profile. Members that one
/// side does not tell are left out.
pub fn mismatches(base: Option<&BuildRecord>, head: Option<&BuildRecord>) -> Vec<String> {
    let (Some(base), Some(head)) = (base, head) else { return Vec::new() };
    let members: BTreeMap<&str, [&Option<String>; 2]> = BTreeMap::from([
        ("compiler", [&base.rustc, &head.rustc]),
        ("flags", [&base.rustflags, &head.rustflags]),
        ("profile", [&base.profile, &head.profile]),
        ("target", [&base.target, &head.target]),
    ]);
    let shown = |value: &Option<String>| value.clone().unwrap_or_else(|| "none".into());
    members
        .iter()
        .filter(|(_, [a, b])| a != b)
        .map(|(name, [a, b])| format!("{name}: {} and {}", shown(a), shown(b)))
        .collect()
}

/// The output of `program list --format json`.
fn list(program: &Path) -> anyhow::Result<Vec<u8>> {
    let name = program.display();
    let mut child = Command::new(program)
        .args(["list", "--format", "json"])
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .with_context(|| format!("{name}: cannot be started"))?;
    let Some(stdout) = child.stdout.take() else { unreachable!("stdout is piped") };
    let (sender, answer) = mpsc::channel();
    std::thread::spawn(move || {
        let mut text = Vec::new();
        let read = stdout.take(LONGEST_LIST).read_to_end(&mut text).map(|_| text);
        let _ = sender.send(read); // nobody waits any more after the timeout
    });
    let text = answer.recv_timeout(LIST_TIMEOUT);
    let _ = child.kill(); // it has answered, or never will
    let _ = child.wait();
    Ok(text.with_context(|| format!("{name}: no answer to `list --format json`"))??)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn builds_of_other_kinds_are_told_apart() {
        let build = |profile: &str| BuildRecord { profile: Some(profile.into()), ..BuildRecord::default() };
        let (release, debug) = (build("release"), build("debug"));
        assert!(mismatches(Some(&release), Some(&release)).is_empty());
        assert_eq!(mismatches(Some(&debug), Some(&release)), ["profile: debug and release"]);
        assert!(mismatches(None, Some(&release)).is_empty());
    }

    #[test]
    #[cfg(unix)]
    fn other_programs_are_refused() {
        for program in ["/bin/echo", "/bin/false", "/nonexistent"] {
            assert!(Program::build(Path::new(program)).is_err(), "{program}");
        }
    }

    #[test]
    fn any_command_is_a_foreign_solver() {
        let Ok(Program::Foreign(peer)) = Program::foreign("./solver --fast") else { panic!() };
        assert_eq!(peer.command, Ok("./solver --fast".into()));
    }
}
