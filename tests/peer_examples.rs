//! The example peers of the protocol's page, and what becomes of them when they lie or die.

use lapbench::record::names::Status;
use lapbench::record::result::{Cell, Summary};
use std::path::{Path, PathBuf};
use std::process::Command;
use tests::needs::{self, Need};

fn examples() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../reference/peers/examples")
}

/// The cells of a short run of one peer beside a good backend, which must come out well whatever its neighbour does.
fn cells(workloads: &str, peer: &str) -> Vec<Cell> {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("r.json");
    let run = format!(
        "run --quick --mesh sphere:3 --threads 1 --cell-time 0.1 --backend dense --workload {workloads}"
    );
    let output = Command::new(env!("CARGO_BIN_EXE_lapbench-faulty"))
        .args(run.split(' '))
        .args(["--peer", &format!("example={peer}"), "--out"])
        .arg(&out)
        .output()
        .expect("the program starts");
    let cells =
        lapbench::record::file::read(&out).unwrap_or_else(|error| panic!("{error:#}: {output:?}")).cells;
    let (theirs, ours): (Vec<Cell>, Vec<Cell>) =
        cells.into_iter().partition(|cell| cell.backend == "example");
    assert!(ours.iter().all(|cell| cell.status == Status::Ok), "{ours:?}");
    theirs
}

fn assert_right(cells: &[Cell], count: usize) {
    assert_eq!(cells.len(), count);
    for cell in cells {
        assert_eq!(cell.status, Status::Ok, "{}: {:?}", cell.workload, cell.reason);
        assert!(cell.solve_ns.p50.is_some() && cell.phases_ns.numeric.is_some());
        assert_eq!((cell.division, cell.threads_used), (None, Some(1)));
    }
}

/// The command of the Python example with a change in its source.
fn python(folder: &Path, change: &[(&str, &str)]) -> Option<String> {
    let interpreter = needs::reference()?;
    let mut source = std::fs::read_to_string(examples().join("superlu.py")).expect("committed");
    for (from, to) in change {
        assert!(source.contains(from), "{from}");
        source = source.replace(from, to);
    }
    let script = folder.join("superlu.py");
    std::fs::write(&script, source).expect("written");
    Some(format!("'{}' '{}'", interpreter.display(), script.display()))
}

#[test]
fn the_python_example_takes_part() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let Some(peer) = python(folder.path(), &[]) else { return };
    assert_right(&cells("harmonic,poisson,kharmonic-1", &peer), 3);
    let frames = &cells("transfer", &peer)[0];
    assert_eq!(frames.status, Status::Unsupported, "{:?}", frames.reason);
}

#[test]
fn a_peer_that_returns_a_wrong_solution_is_invalid_not_fast() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let lie = [("solution.tofile(", "(solution * (1 + 1e-7)).tofile(")];
    let Some(peer) = python(folder.path(), &lie) else { return };
    for cell in cells("harmonic,poisson", &peer) {
        assert_eq!(cell.status, Status::Invalid, "{}", cell.workload);
        assert_eq!(
            (cell.solve_ns, cell.phases_ns.numeric, cell.samples_ns.len()),
            (Summary::default(), None, 0)
        );
    }
}

#[test]
fn a_peer_that_dies_in_the_middle_is_a_row_with_its_reason() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let death = [(
        "        solution.tofile(",
        "        if request[\"times\"] > 1: import os; os.kill(os.getpid(), 9)\n        solution.tofile(",
    )];
    let Some(peer) = python(folder.path(), &death) else { return };
    let cell = &cells("harmonic", &peer)[0];
    assert_eq!(cell.status, Status::Error);
    assert!(
        cell.reason.as_deref().is_some_and(|r| r.contains("killed by signal 9 during `solve`")),
        "{:?}",
        cell.reason
    );
    assert!(cell.complete);
}

#[test]
fn the_cpp_example_takes_part() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let program = folder.path().join("sparse_lu");
    let compiled = Command::new("g++")
        .args(["-O1", "-std=c++17", "-I/usr/include/eigen3"])
        .arg(examples().join("sparse_lu.cpp"))
        .arg("-o")
        .arg(&program)
        .output();
    match compiled {
        Ok(output) if output.status.success() => {}
        Ok(output) if String::from_utf8_lossy(&output.stderr).contains("No such file or directory") => {
            return needs::skip(
                Need::Peers,
                "Eigen or nlohmann-json is not installed; `cargo xtask setup --peers` installs them",
            );
        }
        Ok(output) => panic!("{}", String::from_utf8_lossy(&output.stderr)),
        Err(error) => return needs::skip(Need::Peers, &format!("g++: {error}")),
    }
    assert_right(&cells("poisson,screened", &program.display().to_string()), 2);
    assert_eq!(cells("harmonic", &program.display().to_string())[0].status, Status::Unsupported);
}
