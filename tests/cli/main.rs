//! The command line from outside: exit codes, forms of output, and what becomes of cells whose process misbehaves.

mod choose;
mod disks;
mod faults;
mod foreign;
mod forms;
mod kills;
mod workloads;

use lapbench::record::result::{Cell, ResultFile};
use std::path::Path;
use std::process::{Command, Output};

/// The program under test, with faulty backends beside the built-in ones.
fn program() -> Command {
    Command::new(env!("CARGO_BIN_EXE_lapbench-faulty"))
}

/// Runs it with arguments separated by blanks.
fn lapbench(arguments: &str) -> Output {
    program().args(arguments.split_whitespace()).output().expect("the program starts")
}

/// A quick run on a small sphere; exit code, cells, stderr.
fn run(arguments: &str) -> (i32, Vec<Cell>, String) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("r.json");
    let output = program()
        .args("run --quick --mesh sphere:3 --workload harmonic --threads 1 --cell-time 0.1".split(' '))
        .args(arguments.split_whitespace())
        .arg("--out")
        .arg(&out)
        .output()
        .expect("the program starts");
    let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
    (output.status.code().expect("an exit code"), read(&out).cells, stderr)
}

fn read(path: &Path) -> ResultFile {
    lapbench::record::file::read(path).expect("a result file")
}
