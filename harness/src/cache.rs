//! The folder outside the tree into which `cargo xtask setup` installs references and peers.

use std::path::PathBuf;

/// `$LAPBENCH_CACHE`, else `$XDG_CACHE_HOME/lapbench`, else `~/.cache/lapbench`; `None` where none of the variables is
/// set. The folder need not exist.
pub fn folder() -> Option<PathBuf> {
    let set = |name: &str| std::env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
    set("LAPBENCH_CACHE")
        .or_else(|| Some(set("XDG_CACHE_HOME")?.join("lapbench")))
        .or_else(|| Some(set("HOME")?.join(".cache/lapbench")))
}

/// The interpreter that has the pinned Python libraries: `$LAPBENCH_REFERENCE`, else the one in the cache folder. It
/// need not exist.
pub fn python() -> Option<PathBuf> {
    let own = std::env::var_os("LAPBENCH_REFERENCE").filter(|value| !value.is_empty()).map(PathBuf::from);
    own.or_else(|| Some(folder()?.join("reference/bin/python")))
}
