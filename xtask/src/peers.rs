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
    let folder = cache::folder()?.join("peers");
    fs::create_dir_all(&folder).with_context(|| format!("cannot create {}", folder.display()))?;
    let _lock = cache::lock(&folder)?;
    build(&folder)?;
    eprintln!("xtask: peers are in {}", folder.display());
    Ok(())
}

/// Optimised for this processor, as its users would build it.
const OPTIMISATION: &str = "-O3 -march=native -DNDEBUG -fopenmp";
/// GCC 12 calls variables in its own AVX-512 headers uninitialised.
const FLAGS: [&str; 6] = [
    "-std=c++17",
    "-Wall",
    "-Wextra",
    "-Wno-maybe-uninitialized",
    "-isystem/usr/include/suitesparse",
    "-isystem/usr/include/eigen3",
];
const LIBRARIES: [&str; 3] = ["-lcholmod", "-lmetis", "-lopenblas"];
/// The sources that have a `main`; every other one goes into both programs.
const PROGRAMS: [&str; 2] = ["chol_runner", "solver_peer"];

/// Compiles `reference/peers/cpp` into `<cache>/peers` and copies the Python peer there, so that the harness needs no
/// source tree; done again when a source or flag has changed.
fn build(folder: &Path) -> anyhow::Result<()> {
    let source = shell::root().join("reference/peers");
    let (files, text) = sources(&source.join("cpp"))?;
    let flags = format!("{OPTIMISATION} {}", FLAGS.join(" "));
    let stamp = Stamp::new(folder.join("cpp.installed"), format!("{flags}\n{text}"));
    if !stamp.is_current() || PROGRAMS.iter().any(|program| !folder.join(program).exists()) {
        for program in PROGRAMS {
            compile(&files, program, &folder.join(program))?;
        }
        stamp.write()?;
    }
    let (scripts, _) = sources(&source.join("python"))?;
    let installed = folder.join("python");
    fs::create_dir_all(&installed).with_context(|| format!("cannot create {}", installed.display()))?;
    for script in scripts {
        let name = script.file_name().expect("a file of the folder");
        fs::copy(&script, installed.join(name))
            .with_context(|| format!("cannot copy {}", script.display()))?;
    }
    Ok(())
}

fn compile(files: &[PathBuf], program: &str, output: &Path) -> anyhow::Result<()> {
    let is_other_program = |file: &Path| {
        PROGRAMS.iter().any(|other| *other != program && file.file_stem().is_some_and(|stem| stem == *other))
    };
    let mut compile = shell::command("g++", &FLAGS);
    compile.args(OPTIMISATION.split(' ')).arg(format!("-DPEER_FLAGS=\"{OPTIMISATION}\""));
    compile.args(files.iter().filter(|file| !is_other_program(file)));
    shell::run(compile.arg("-o").arg(output).args(LIBRARIES))
}

/// The `.cpp` and `.py` files of a folder, and the text of all its files, headers included, in a fixed order.
fn sources(folder: &Path) -> anyhow::Result<(Vec<PathBuf>, String)> {
    let entries = fs::read_dir(folder).with_context(|| format!("cannot read {}", folder.display()))?;
    let mut files = entries.map(|entry| entry.map(|entry| entry.path())).collect::<Result<Vec<_>, _>>()?;
    files.retain(|file| file.is_file());
    files.sort();
    let mut text = String::new();
    for file in &files {
        text += &fs::read_to_string(file).with_context(|| format!("cannot read {}", file.display()))?;
    }
    files.retain(|file| file.extension().is_some_and(|extension| extension == "cpp" || extension == "py"));
    Ok((files, text))
}
