//! Backends that misbehave inside their process.

use super::run;
use lapbench::record::names::Status;
use lapbench::record::result::{Cell, Summary};

/// The cell of a backend beside a good one, which must come out well whatever its neighbour does.
fn cell_of(backend: &str, arguments: &str, exit: i32) -> Cell {
    let (found, cells, stderr) = run(&format!("--backend {backend},dense {arguments}"));
    assert_eq!(found, exit, "{backend}: {stderr}");
    let find = |id: &str| cells.iter().find(|c| c.backend == id).expect("a row").clone();
    assert_eq!(find("dense").status, Status::Ok, "the neighbour of {backend}");
    find(backend)
}

fn fails(backend: &str, arguments: &str, exit: i32, status: Status, reason: &str) -> Cell {
    let cell = cell_of(backend, arguments, exit);
    assert_eq!(cell.status, status, "{backend}: {:?}", cell.reason);
    let found = cell.reason.as_deref().unwrap_or_default();
    assert!(found.contains(reason), "{backend}: {found}");
    assert!(cell.complete);
    cell
}

#[test]
fn wrong_answers_have_no_time() {
    for (backend, reason) in [
        ("wrong", "error"),
        ("wrong-later", "error"),
        ("stale", "after a change"),
        ("not-a-number", "exceeds"),
    ] {
        let cell = fails(backend, "", 4, Status::Invalid, reason);
        assert_eq!((cell.solve_ns, cell.samples_ns.len()), (Summary::default(), 0), "{backend}");
        assert_eq!((cell.frames_per_second, cell.phases_ns.numeric), (None, None), "{backend}");
    }
}

#[test]
fn crashes_are_error_rows() {
    fails("panics", "", 1, Status::Error, "as it should");
    fails("exits", "", 1, Status::Error, "exit code 7 during `prepare`");
    fails("prints", "", 1, Status::Error, "hello from a solver");
}

#[test]
fn a_backend_that_hangs_is_a_timeout() {
    fails("hangs", "--cell-timeout 1", 0, Status::Timeout, "no answer to `solve`");
}

#[test]
fn too_much_memory_is_out_of_memory() {
    fails(
        "greedy",
        "--memory-limit 1000000000",
        1,
        Status::Oom,
        "memory allocation of 68719476736 bytes failed",
    );
}

#[test]
fn allocations_are_counted() {
    assert_eq!(cell_of("allocates", "", 0).allocations_per_frame, Some(1.0));
}

/// No work on the identity: what a timed repetition costs by itself. The smallest real mesh of the data folder (8K triangles)
/// takes over 300 us for a solve, of which 2% are 6 us.
#[test]
fn the_harness_itself_costs_next_to_nothing() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (matrix, out) = (folder.path().join("i.mtx"), folder.path().join("r.json"));
    let lines: String = (1..=10).map(|i| format!("{i} {i} 1\n")).collect();
    std::fs::write(&matrix, format!("%%MatrixMarket matrix coordinate real symmetric\n10 10 10\n{lines}"))
        .expect("written");
    let output = super::program()
        .args("run --quick --backend overhead --threads 1 --cell-time 0.5 --matrix".split(' '))
        .arg(&matrix)
        .arg("--out")
        .arg(&out)
        .output()
        .expect("the program starts");
    let cell = super::read(&out).cells.remove(0);
    assert_eq!((output.status.code(), cell.status), (Some(0), Status::Ok), "{:?}", cell.reason);
    let median = cell.solve_ns.p50.expect("samples");
    println!("overhead: {median} ns at the median of {} solves", cell.samples_ns.len());
    assert!(median < 6_000, "{median} ns");
}
