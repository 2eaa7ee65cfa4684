//! The workloads of animation by the command line: tables in, tables out, and rows of a run.

use super::{program, run};
use lapbench::mesh_io::table;
use lapbench::record::names::Status;
use std::path::Path;
use tempfile::TempDir;

/// `solve` on a sphere with the dense backend; the rows it wrote, or what it said.
fn solve(folder: &TempDir, arguments: &str, input: (&str, &str)) -> Result<(usize, Vec<f64>), String> {
    let (file, out) = (folder.path().join(input.0), folder.path().join("out.csv"));
    let _ = std::fs::remove_file(&out);
    std::fs::write(&file, input.1).expect("a temporary folder");
    let output = program()
        .args("solve --backend dense --out".split(' '))
        .arg(&out)
        .args(arguments.replace("FILE", &file.display().to_string()).split_whitespace())
        .output()
        .expect("the program starts");
    match output.status.code() {
        Some(0) => Ok(table::read_rows(&out).expect("what was written can be read")),
        _ => {
            assert!(!Path::new(&out).exists(), "a failed solve leaves no file");
            Err(String::from_utf8_lossy(&output.stderr).into_owned())
        }
    }
}

#[test]
fn skinning_takes_bones_and_gives_weights() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let bones = "x1,y1,z1,x2,y2,z2\n0,0,-0.5,0,0,0\n0,0,0,0,0,0.5\n";
    let base = "--mesh sphere:2 --workload skinning";
    let (k, weights) =
        solve(&folder, &format!("{base} --bones FILE --heat 1000"), ("b.csv", bones)).expect("solves");
    assert_eq!(k, 2);
    assert!(weights.chunks(2).all(|w| (w[0] + w[1] - 1.0).abs() < 1e-10));
    assert!(weights.iter().any(|&w| w > 0.9) && weights.iter().any(|&w| w < 0.1));
    let (k, _) = solve(&folder, base, ("unused", "")).expect("default bones");
    assert_eq!(k, lapsolve::workload::skinning::defaults::BONES);
    let wrong = solve(&folder, &format!("{base} --bones FILE"), ("b.csv", "0 0 0 1\n")).unwrap_err();
    assert!(wrong.contains("b.csv") && wrong.contains("found 4 values"), "{wrong}");
    let wrong = solve(&folder, &format!("{base} --heat 0"), ("unused", "")).unwrap_err();
    assert!(wrong.contains("positive"), "{wrong}");
}

#[test]
fn smoothing_needs_no_mesh() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let zigzag: String = (0..60).map(|f| format!("{f}, {}\n", if f % 2 == 0 { 1 } else { -1 })).collect();
    let (k, smooth) = solve(&folder, "--angles FILE --lambda 2", ("a.csv", &zigzag)).expect("solves");
    assert_eq!((k, smooth.len()), (2, 120));
    assert!((0..60).all(|f| (smooth[2 * f] - f as f64).abs() < 1e-10), "a line stays");
    assert!((smooth[61] - 1.0 / 33.0).abs() < 1e-6, "{}", smooth[61]);
    let wrong = solve(&folder, "--angles FILE", ("a.csv", "1 2\n3\n")).unwrap_err();
    assert!(wrong.contains("line 2"), "{wrong}");
    let wrong = solve(&folder, "--angles FILE --lambda -1", ("a.csv", "1\n2\n3\n")).unwrap_err();
    assert!(wrong.contains("lambda"), "{wrong}");
}

#[test]
fn arap_takes_handles() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let base = "--mesh sphere:2 --workload arap --handles FILE --iterations 3";
    let (k, moved) = solve(&folder, base, ("h.csv", "0 1 2 3\n40 1 2 3.5\n")).expect("solves");
    assert_eq!((k, &moved[..3]), (3, &[1.0, 2.0, 3.0][..]));
    assert_eq!(&moved[120..123], [1.0, 2.0, 3.5]);
    for (handles, part) in
        [("9999 0 0 0\n", "out of range"), ("0 1 2\n", "x, y, z"), ("0 0 0 nan\n", "not finite")]
    {
        let wrong = solve(&folder, base, ("h.csv", handles)).unwrap_err();
        assert!(wrong.contains(part), "{handles}: {wrong}");
    }
}

#[test]
fn geodesic_takes_sources() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let base = "--mesh sphere:3 --workload geodesic --sources FILE";
    let (k, distances) = solve(&folder, base, ("s.csv", "source\n7\n")).expect("solves");
    let farthest = distances.iter().fold(0.0_f64, |m, &d| m.max(d));
    assert_eq!((k, distances[7].abs() < 1e-12), (1, true));
    assert!((farthest / std::f64::consts::PI - 1.0).abs() < 0.05, "{farthest}");
    let wrong = solve(&folder, base, ("s.csv", "-1\n")).unwrap_err();
    assert!(wrong.contains("out of range"), "{wrong}");
}

#[test]
fn all_of_them_run_and_wrong_answers_have_no_time() {
    let workloads = "--workload skinning,smoothing,arap,geodesic";
    let (exit, cells, stderr) = run(&format!("{workloads} --backend dense"));
    assert_eq!(exit, 0, "{stderr}");
    for workload in ["skinning", "smoothing", "arap", "geodesic"] {
        let cell = cells.iter().find(|cell| cell.workload == workload).expect("a row");
        assert_eq!(cell.status, Status::Ok, "{workload}: {:?}", cell.reason);
        assert!(cell.solve_ns.p50.is_some() && cell.accuracy.forward_error.is_some(), "{workload}");
        assert_eq!(cell.allocations_per_frame, Some(0.0), "{workload}");
    }
    let (exit, cells, _) = run("--workload arap,geodesic --backend wrong");
    assert_eq!(exit, 4);
    let wrong = |w: &str| cells.iter().find(|cell| cell.workload == w).map(|cell| cell.status);
    assert_eq!((wrong("arap"), wrong("geodesic")), (Some(Status::Invalid), Some(Status::Invalid)));
}
