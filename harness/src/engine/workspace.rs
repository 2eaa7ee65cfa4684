//! The folder through which parent and children exchange arrays.

use anyhow::Context;
use std::fs;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

const PREFIX: &str = "lapbench-";

/// A temporary folder of this process, removed with it. Folders that killed runs left behind are removed when the next
/// one starts.
#[derive(Debug)]
pub struct Workspace(TempDir);

impl Workspace {
    /// Makes the folder in the system's place for temporary files (`TMPDIR`).
    ///
    /// # Errors
    /// Where that is not writable.
    pub fn new() -> anyhow::Result<Self> {
        let place = std::env::temp_dir();
        sweep(&place);
        let prefix = format!("{PREFIX}{}-", std::process::id());
        let folder = tempfile::Builder::new()
            .prefix(&prefix)
            .tempdir_in(&place)
            .with_context(|| format!("no temporary folder in {}; set TMPDIR", place.display()))?;
        Ok(Self(folder))
    }

    /// A path in the folder.
    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// A new folder in the folder.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn folder(&self, name: &str) -> anyhow::Result<PathBuf> {
        let path = self.path(name);
        fs::create_dir(&path).with_context(|| format!("cannot make {}", path.display()))?;
        Ok(path)
    }
}

/// Removes folders whose process no longer runs. Only Linux can tell; elsewhere they stay.
fn sweep(place: &Path) {
    if !Path::new("/proc/self").exists() {
        return;
    }
    for folder in fs::read_dir(place).into_iter().flatten().flatten() {
        let name = folder.file_name();
        let owner =
            name.to_str().and_then(|n| n.strip_prefix(PREFIX)?.split_once('-')?.0.parse::<u32>().ok());
        if owner.is_some_and(|id| !Path::new(&format!("/proc/{id}")).exists()) {
            let _ = fs::remove_dir_all(folder.path()); // another user's, or just gone
        }
    }
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    #[test]
    fn folders_of_dead_processes_are_removed() {
        let place = tempfile::tempdir().unwrap();
        let mine = format!("{PREFIX}{}-abc", std::process::id());
        let dead = format!("{PREFIX}4194305-abc"); // above the largest process id
        for name in [mine.as_str(), dead.as_str(), "lapbench-notes", "other"] {
            fs::create_dir(place.path().join(name)).unwrap();
        }
        sweep(place.path());
        let left = |name: &str| place.path().join(name).exists();
        assert!(left(&mine) && left("lapbench-notes") && left("other") && !left(&dead));
    }
}
