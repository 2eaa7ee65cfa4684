//! The Python environment of the reference programs: exact versions, every download checked against the hash in the
//! lock file.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};

use crate::cache::{self, Stamp};
use crate::shell;

/// Imported once after the installation: a wheel that installs but does not load is found here and not in a test.
const IMPORTS: &str = "import numpy, scipy.sparse, igl, open3d";

/// Makes `<cache>/reference` agree with `reference/requirements.txt` and returns its interpreter.
pub fn install() -> anyhow::Result<PathBuf> {
    let cache = cache::folder()?;
    let _lock = cache::lock(&cache)?;
    let environment = cache.join("reference");
    let python = environment.join("bin/python");
    let lock_file = shell::root().join("reference/requirements.txt");
    let stamp = stamp(&environment, "requirements", &lock_file)?;
    if stamp.is_current() && shell::succeeds(&mut shell::command(&python, &["-c", ""])) {
        return Ok(python);
    }
    if environment.exists() {
        fs::remove_dir_all(&environment)
            .with_context(|| format!("cannot replace {}", environment.display()))?;
    }
    shell::run(shell::command("python3", &["-m", "venv"]).arg(&environment))?;
    pip_install(&python, &lock_file)?;
    if let Err(cause) = shell::run(&mut shell::command(&python, &["-c", IMPORTS])) {
        bail!("the reference libraries are installed but do not load: {cause}");
    }
    stamp.write()?;
    Ok(python)
}

/// Adds one optional lock file to the environment of `python`; quick when it is there already.
pub fn install_optional(python: &Path, name: &str, lock_file: &Path) -> anyhow::Result<()> {
    let environment =
        python.parent().and_then(Path::parent).context("the interpreter lies in an environment")?;
    let stamp = stamp(environment, name, lock_file)?;
    if stamp.is_current() {
        return Ok(());
    }
    pip_install(python, lock_file)?;
    stamp.write()
}

fn stamp(environment: &Path, name: &str, lock_file: &Path) -> anyhow::Result<Stamp> {
    let content =
        fs::read_to_string(lock_file).with_context(|| format!("cannot read {}", lock_file.display()))?;
    Ok(Stamp::new(environment.join(format!("{name}.installed")), content))
}

/// Exactly the wheels of the lock file: nothing is built here, nothing is added by dependency resolution.
fn pip_install(python: &Path, lock_file: &Path) -> anyhow::Result<()> {
    let arguments = [
        "-m",
        "pip",
        "install",
        "--quiet",
        "--disable-pip-version-check",
        "--no-deps",
        "--only-binary",
        ":all:",
        "--require-hashes",
        "--requirement",
    ];
    shell::run(shell::command(python, &arguments).arg(lock_file)).with_context(|| {
        format!(
            "pip could not install {}: it needs the network (PIP_INDEX_URL or a proxy where there is no direct way) \
             and a wheel for this Python and processor. Run again: finished downloads are kept",
            lock_file.display()
        )
    })
}
