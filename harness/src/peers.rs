//! Solvers of others that this project can install: which there are, and the command that starts each.
//!
//! The list is `reference/peers/peers.json`. A peer that is not installed stays in it, with the remedy.

use std::path::{Path, PathBuf};

use serde::Deserialize;

use crate::cache;
use crate::record::names::Division;

/// A solver of others behind the peer protocol.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Peer {
    /// The name users type, as in results.
    pub id: String,
    /// The shell line that starts it, with `{peers}` and `{python}` for what `setup` installed.
    command: String,
    /// Whether its settings are the library's defaults or chosen for this work.
    #[serde(default)]
    pub division: Option<Division>,
    /// SPDX expression of the library that does the work.
    pub licence: String,
    /// The one workload that it takes, where it is not made for systems.
    pub takes: Option<String>,
}

/// Why a peer cannot be started.
const REMEDY: &str = "install it with `cargo xtask setup --peers`";

/// Every peer that there is a program for, installed or not.
///
/// # Panics
/// Never: the list is part of the program, and a test reads it.
pub fn catalogue() -> Vec<Peer> {
    serde_json::from_str(include_str!("../../reference/peers/peers.json")).expect("the list is valid")
}

/// The peer of that name.
pub fn find(id: &str) -> Option<Peer> {
    catalogue().into_iter().find(|peer| peer.id == id)
}

impl Peer {
    /// The shell line that starts it.
    ///
    /// # Errors
    /// What is not installed, and the remedy. Whether the program's own libraries are there, it says itself.
    pub fn command(&self) -> Result<String, String> {
        let folder = cache::folder().map(|cache| cache.join("peers"));
        let (Some(folder), Some(python)) = (folder, cache::python()) else {
            return Err(format!(
                "no cache folder is known (neither LAPBENCH_CACHE nor HOME is set); {REMEDY}"
            ));
        };
        self.command_in(&folder, &python)
    }

    fn command_in(&self, folder: &Path, python: &Path) -> Result<String, String> {
        let mut needed: Vec<PathBuf> = Vec::new();
        let words = self.command.split(' ').map(|word| {
            let expanded = match word.strip_prefix("{peers}/") {
                Some(rest) => folder.join(rest),
                None if word == "{python}" => python.to_path_buf(),
                None => return word.to_owned(),
            };
            let quoted = quote(&expanded.to_string_lossy());
            needed.push(expanded);
            quoted
        });
        let line = words.collect::<Vec<_>>().join(" ");
        match needed.iter().find(|path| !path.exists()) {
            Some(absent) => Err(format!("{} does not exist; {REMEDY}", absent.display())),
            None => Ok(line),
        }
    }
}

/// One word of a shell line, whatever it holds.
fn quote(word: &str) -> String {
    format!("'{}'", word.replace('\'', r"'\''"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_unique_and_none_is_a_backend_of_ours() {
        let ids: Vec<String> = catalogue().into_iter().map(|peer| peer.id).collect();
        for (k, id) in ids.iter().enumerate() {
            assert!(!ids[..k].contains(id), "{id} stands there twice");
            assert!(lapsolve::registry::find(id).is_none(), "{id} is a built-in backend");
        }
        assert!(find("cholmod-simplicial-metis").is_some() && find("nobody").is_none());
    }

    #[test]
    fn commands_are_quoted_and_what_is_missing_is_named() {
        let folder = tempfile::Builder::new().prefix("it's a").tempdir().unwrap();
        let peer = find("cholespy").unwrap();
        let python = folder.path().join("python3");
        let missing = peer.command_in(folder.path(), &python).unwrap_err();
        assert!(missing.contains("python3 does not exist") && missing.contains("--peers"), "{missing}");

        std::fs::create_dir(folder.path().join("python")).unwrap();
        std::fs::write(folder.path().join("python/peer.py"), "").unwrap();
        std::fs::write(&python, "#!/bin/sh\nprintf '%s ' \"$@\"").unwrap();
        let line = peer.command_in(folder.path(), &python).unwrap();
        let output = std::process::Command::new("sh").args(["-c", &format!("sh {line}")]).output().unwrap();
        let script = folder.path().join("python/peer.py");
        assert_eq!(String::from_utf8_lossy(&output.stdout), format!("{} cholespy ", script.display()));
    }
}
