//! The solvers that others would pick, for runs that compare with them: one C++ program, and optional Python wheels.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Context;

use crate::cache::{self, Stamp};
use crate::{python, shell, system};

/// Python peers, each with a lock file of its own in `reference/peers`: one that has no wheel for this machine is
/// noted and left out.
const WHEELS: [&str; 4] = ["pypardiso", "pyamg", "cholespy", "potpourri3d"];

/// Installs or builds every peer that this machine can have; only the C++ tools themselves are a must.
pub fn install(python: &Path) -> anyhow::Result<()> {
    for wheel in WHEELS {
        let lock_file = shell::root().join("reference/peers").join(wheel).with_extension("txt");
        if let Err(cause) = python::install_optional(python, wheel, &lock_file) {
            eprintln!("xtask: peer {wheel} left out: {cause:#}");
        }
    }
    system::install(system::FOR_PEERS)?;
    build_cpp()
}

/// Optimised for this processor, as its users would build it. GCC 12 calls its own AVX-512 headers uninitialised.
const FLAGS: [&str; 10] = [
    "-std=c++17",
    "-O3",
    "-march=native",
    "-DNDEBUG",
    "-fopenmp",
    "-Wall",
    "-Wextra",
    "-Wno-maybe-uninitialized",
    "-isystem/usr/include/suitesparse",
    "-isystem/usr/include/eigen3",
];
const LIBRARIES: [&str; 3] = ["-lcholmod", "-lmetis", "-lopenblas"];

/// Compiles `reference/peers/cpp` into `<cache>/peers`; compiled again when a source or flag has changed.
fn build_cpp() -> anyhow::Result<()> {
    let folder = cache::folder()?.join("peers");
    fs::create_dir_all(&folder).with_context(|| format!("cannot create {}", folder.display()))?;
    let _lock = cache::lock(&folder)?;
    let (sources, text) = sources(&shell::root().join("reference/peers/cpp"))?;
    let program = folder.join("chol_runner");
    let stamp = Stamp::new(folder.join("chol_runner.installed"), format!("{}\n{text}", FLAGS.join(" ")));
    if !(stamp.is_current() && program.exists()) {
        let mut compile = shell::command("g++", &FLAGS);
        shell::run(compile.args(sources).arg("-o").arg(&program).args(LIBRARIES))?;
        stamp.write()?;
    }
    eprintln!("xtask: C++ peers are in {}", program.display());
    Ok(())
}

/// The files to compile, and the text of all files of the folder, headers included, in a fixed order.
fn sources(folder: &Path) -> anyhow::Result<(Vec<PathBuf>, String)> {
    let entries = fs::read_dir(folder).with_context(|| format!("cannot read {}", folder.display()))?;
    let mut files = entries.map(|entry| entry.map(|entry| entry.path())).collect::<Result<Vec<_>, _>>()?;
    files.sort();
    let mut text = String::new();
    for file in &files {
        text += &fs::read_to_string(file).with_context(|| format!("cannot read {}", file.display()))?;
    }
    files.retain(|file| file.extension().is_some_and(|extension| extension == "cpp"));
    Ok((files, text))
}
