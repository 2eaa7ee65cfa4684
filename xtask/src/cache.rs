//! The folder outside the tree that keeps what `setup` installs, shared by all working copies.

use std::fs::{self, File};
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};

/// `$LAPBENCH_CACHE`, else `$XDG_CACHE_HOME/lapbench`, else `~/.cache/lapbench`. Created where it is missing.
pub fn folder() -> anyhow::Result<PathBuf> {
    let set = |name: &str| std::env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
    let folder = if let Some(own) = set("LAPBENCH_CACHE") {
        own
    } else if let Some(caches) = set("XDG_CACHE_HOME") {
        caches.join("lapbench")
    } else if let Some(home) = set("HOME") {
        home.join(".cache/lapbench")
    } else {
        bail!("no place for the cache: set LAPBENCH_CACHE to a folder that can be written");
    };
    fs::create_dir_all(&folder).with_context(|| {
        format!("cannot create the cache folder {}; set LAPBENCH_CACHE to another", folder.display())
    })?;
    Ok(folder)
}

/// Waits until no other `setup` works on the cache; the lock ends with the returned file.
pub fn lock(folder: &Path) -> anyhow::Result<File> {
    let path = folder.join("setup.lock");
    let file = File::create(&path).with_context(|| format!("cannot write {}", path.display()))?;
    if file.try_lock().is_err() {
        eprintln!("xtask: waiting for another setup that holds {}", path.display());
        file.lock().with_context(|| format!("cannot lock {}", path.display()))?;
    }
    Ok(file)
}

/// A file that says what was installed: installed again when `content` (sources, lock file) is another.
pub struct Stamp {
    path: PathBuf,
    content: String,
}

impl Stamp {
    /// The stamp at `path` for something made from `content`.
    pub fn new(path: PathBuf, content: String) -> Self {
        Self { path, content }
    }

    /// Whether exactly this content was installed to its end.
    pub fn is_current(&self) -> bool {
        fs::read_to_string(&self.path).is_ok_and(|installed| installed == self.content)
    }

    /// To be called when the installation is complete.
    pub fn write(&self) -> anyhow::Result<()> {
        fs::write(&self.path, &self.content).with_context(|| format!("cannot write {}", self.path.display()))
    }
}
