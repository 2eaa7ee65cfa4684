//! The validation itself: it notices broken code, passes real meshes, and the transfer follows captured motion.

use lapbench::mesh_io::{self, npy, table};
use lapbench::verify::finding::Outcome;
use lapbench::verify::mutants::kill_table;
use lapbench::verify::subject::{Discretisation, Subject};
use lapbench::verify::suite;
use lapsolve::backend::{PrepareOptions, TransferFrame};
use lapsolve::laplacian::Weights;
use lapsolve::mesh::TriangleMesh;
use lapsolve::registry::{self, BACKENDS, OpenOptions};
use lapsolve::vector::distance_squared;
use lapsolve::workload::transfer::defaults::{default_marks, thinned};
use lapsolve::workload::transfer::{self, TransferProblem};
use std::path::Path;
use tests::needs;

fn mesh(path: &Path) -> TriangleMesh {
    mesh_io::read_mesh(path).unwrap_or_else(|error| panic!("{error}")).mesh
}

#[test]
fn every_mutant_is_noticed_by_a_named_check() {
    let table = kill_table(BACKENDS).expect("the unbroken code passes");
    let survivors: Vec<_> = table.iter().filter(|kill| kill.killed_by.is_empty()).map(|k| k.mutant).collect();
    assert!(survivors.is_empty(), "nothing notices {survivors:?}");
}

/// Nothing fails on `name` with direct and iterative backends; not converging is legal where there are slivers.
fn assert_valid(name: &str, backends: &[&str]) {
    let Some(data) = needs::data() else { return };
    let open = |id: &&str| {
        let entry = registry::find(id).unwrap_or_else(|| panic!("{id} is built in"));
        Subject::open(entry, &OpenOptions::default()).unwrap_or_else(|why| panic!("{id}: {why}"))
    };
    let subjects: Vec<Subject> = backends.iter().map(open).collect();
    let findings = suite::of_mesh(name, &mesh(&data.join(name)), &subjects, &Discretisation::TRUE, BACKENDS);
    let failed: Vec<_> = findings.failures().collect();
    assert!(failed.is_empty(), "{name}: {failed:#?}");
    assert!(
        findings.all.iter().filter(|f| f.outcome == Outcome::Passed).count() > 30,
        "{name}: too few checks ran"
    );
}

#[test]
fn a_clean_scan_is_valid() {
    assert_valid("meshes/femur_8k.ply", &["faer-llt", "faer-simplicial", "cg-jacobi"]);
}

#[test]
fn zero_area_triangles_and_many_pieces_are_valid() {
    assert_valid("bad/heart_20k.ply", &["faer-llt"]);
}

fn frames_of(problem: &TransferProblem) -> Box<dyn TransferFrame> {
    let entry = registry::find("faer-llt").expect("built in");
    let backend = (entry.open)(&OpenOptions::default()).expect("a default feature");
    transfer::prepare(&*backend, problem, &PrepareOptions::columns(4), &mut |_| {})
        .expect("positive definite")
}

/// Frame `k` of a sequence, one position per vertex.
fn pose(frames: &npy::Array, vertices: usize, k: usize) -> Vec<[f64; 3]> {
    frames.values[3 * vertices * k..3 * vertices * (k + 1)].as_chunks().0.to_vec()
}

#[test]
fn a_captured_dance_is_followed() {
    let Some(data) = needs::data() else { return };
    let body = mesh(&data.join("sequences/samba.ply"));
    let frames = npy::read(&data.join("sequences/samba_frames.npy")).expect("an array");
    let problem =
        TransferProblem::new(&body, body.clone(), &default_marks(&body), Weights::Plain).expect("usable");
    let mut transfer = frames_of(&problem);
    let n = body.positions().len();
    let mut moved = vec![[f64::NAN; 3]; n];
    for k in [0, 40, 80, 155] {
        let truth = pose(&frames, n, k);
        transfer.frame(&truth, &mut moved).expect("solvable");
        let squares: f64 = moved.iter().zip(&truth).map(|(&a, &b)| distance_squared(a, b)).sum();
        let off = (squares / n as f64).sqrt() / body.diagonal();
        // 64 marks know the rotation of 64 triangles only; the first frame is the reference pose itself.
        assert!(off < if k == 0 { 1e-6 } else { 0.05 }, "frame {k}: off by {off} diagonals in the mean");
    }
}

#[test]
fn a_horse_drives_a_camel() {
    let Some(data) = needs::data() else { return };
    let (horse, camel) = (mesh(&data.join("sequences/horse.ply")), mesh(&data.join("sequences/camel.ply")));
    let limits = [horse.triangles().len(), camel.triangles().len()];
    let pairs = table::read_pairs(&data.join("sequences/horse_camel_tri_many.txt"), limits).expect("pairs");
    let pairs: Vec<(u32, u32)> = pairs.iter().map(|p| (p[0], p[1])).collect();
    let few = thinned(&horse, &camel, &pairs, 150).expect("in range");
    assert_eq!(few.len(), 150);
    let problem = TransferProblem::new(&horse, camel.clone(), &few, Weights::Plain).expect("usable");
    let mut transfer = frames_of(&problem);
    let mut moved = vec![[f64::NAN; 3]; camel.positions().len()];
    transfer.frame(horse.positions(), &mut moved).expect("solvable");
    let still =
        moved.iter().zip(camel.positions()).map(|(&a, &b)| distance_squared(a, b).sqrt()).fold(0.0, f64::max);
    assert!(still < 1e-9 * camel.diagonal(), "the reference pose moves the camel by {still}");
    let poses = npy::read(&data.join("sequences/horse_poses.npy")).expect("an array");
    let published = npy::read(&data.join("sequences/camel_poses.npy")).expect("an array");
    for k in 0..10 {
        transfer.frame(&pose(&poses, horse.positions().len(), k), &mut moved).expect("solvable");
        let theirs = pose(&published, moved.len(), k);
        // Another method with every triangle marked; what both agree on is the shape, up to a translation.
        let mean =
            |points: &[[f64; 3]], i: usize| points.iter().map(|p| p[i]).sum::<f64>() / points.len() as f64;
        let shift = [0, 1, 2].map(|i| mean(&theirs, i) - mean(&moved, i));
        let square =
            |(a, b): (&[f64; 3], &[f64; 3])| (0..3).map(|i| (a[i] + shift[i] - b[i]).powi(2)).sum::<f64>();
        let off = (moved.iter().zip(&theirs).map(square).sum::<f64>() / moved.len() as f64).sqrt();
        println!("pose {k}: {:.4} diagonals", off / camel.diagonal());
        assert!(
            off < 0.1 * camel.diagonal(),
            "pose {k} is {} diagonals off the published one",
            off / camel.diagonal()
        );
    }
}
