//! lapsolve against the committed samples of what libigl and Open3D compute (`reference/golden`, made by `reference/generate.py`).

use std::fs;
use std::path::{Path, PathBuf};

use lapbench::mesh_io;
use lapsolve::backend::PrepareOptions;
use lapsolve::columns::Columns;
use lapsolve::dirichlet::Dirichlet;
use lapsolve::laplacian::{Laplacian, Weights};
use lapsolve::limits::{DEFAULT_TOLERANCE, Limits};
use lapsolve::mass::{self, Mass};
use lapsolve::mesh::TriangleMesh;
use lapsolve::registry::{self, Entry, OpenOptions};
use lapsolve::sparse::SymmetricCsr;
use lapsolve::workload::arap::{Arap, ArapProblem};
use lapsolve::workload::geodesic::{Geodesic, GeodesicProblem};
use lapsolve::workload::harmonic::{COLUMNS, Constraints, DEFAULT_CONSTRAINTS, default_values};
use serde_json::Value;
use tests::needs;

/// The largest golden mesh on which every backend is tried; beyond it `faer-llt` stands for all.
const EVERY_BACKEND_UP_TO: usize = 1_000;
/// Relative difference of two sums of triangle areas; the worst seen is on the needles of the bad meshes.
const AREA_LIMIT: f64 = 1e-10;
/// Difference between two solutions of the same deformation, in diagonals.
const ARAP_LIMIT: f64 = 1e-9;
/// The same to libigl, which fits rotations in f32; most of these meshes have negative weights, which make some hard to tell.
const IGL_ARAP_LIMIT: f64 = 1e-3;
/// Difference of distances, in diagonals.
const DISTANCE_LIMIT: f64 = 1e-9;
/// What potpourri3d adds to the diagonal of the singular system.
const POTPOURRI_SHIFT: f64 = 1e-6;
/// Difference between two unit quaternions of the same formula: a few roundings of sines and products.
const VALUE_LIMIT: f64 = 1e-14;

fn golden_folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../reference/golden")
}

/// Every golden file whose mesh lies below `golden/` (`committed`), or below the data folder.
fn golden_files(committed: bool) -> Vec<Value> {
    let files = fs::read_dir(golden_folder()).expect("reference/golden is part of the tree");
    let mut paths: Vec<PathBuf> = files.map(|file| file.expect("readable folder").path()).collect();
    paths.retain(|path| path.extension().is_some_and(|e| e == "json") && !path.ends_with("manifest.json"));
    paths.sort();
    let values = paths.iter().map(|path| {
        serde_json::from_slice(&fs::read(path).expect("readable file")).expect("golden files are JSON")
    });
    values.filter(|golden| mesh_file(golden).starts_with("golden/") == committed).collect()
}

fn mesh_file(golden: &Value) -> &str {
    golden["mesh"]["file"].as_str().expect("golden files name their mesh")
}

/// The rows of one of the tables, as numbers.
fn rows(table: &Value) -> Vec<Vec<f64>> {
    let row = |row: &Value| row.as_array().expect("a row").iter().map(number).collect();
    table.as_array().expect("a table").iter().map(row).collect()
}

fn number(value: &Value) -> f64 {
    value.as_f64().expect("a number")
}

/// Adds a line to `wrong` unless |ours - theirs| <= limit * scale; a NaN is always wrong.
fn compare(wrong: &mut Vec<String>, what: String, ours: f64, theirs: f64, limit: f64, scale: f64) {
    let difference = (ours - theirs).abs();
    if difference.is_nan() || difference > limit * scale {
        wrong.push(format!(
            "{what}: {ours:e}, the reference has {theirs:e}, off by {:e} of {limit:e}",
            difference / scale
        ));
    }
}

/// L_ij, zero where nothing is stored.
fn entry(l: &SymmetricCsr, i: usize, j: usize) -> f64 {
    let (row, column) = (i.min(j), i.max(j) as u32);
    let (start, end) = (l.row_starts()[row] as usize, l.row_starts()[row + 1] as usize);
    l.columns()[start..end].binary_search(&column).map_or(0.0, |at| l.values()[start + at])
}

/// x' L x.
fn quadratic(l: &SymmetricCsr, x: &[f64]) -> f64 {
    let row = |i: usize| {
        let (start, end) = (l.row_starts()[i] as usize, l.row_starts()[i + 1] as usize);
        let off: f64 = (start + 1..end).map(|e| l.values()[e] * x[l.columns()[e] as usize]).sum();
        x[i] * (l.values()[start] * x[i] + 2.0 * off)
    };
    (0..l.n()).map(row).sum()
}

/// What differs between `l` and the golden rows, trace and quadratic form.
fn compare_laplacian(golden: &Value, l: &SymmetricCsr) -> Vec<String> {
    let mut wrong = Vec::new();
    for row in rows(&golden["laplacian"]) {
        let (i, j) = (row[0] as usize, row[1] as usize);
        let scale = entry(l, i, i).max(entry(l, j, j));
        compare(&mut wrong, format!("L[{i}][{j}]"), entry(l, i, j), row[2], row[3], scale);
    }
    let limit = number(&golden["limit"]);
    let trace: f64 = (0..l.n()).map(|i| entry(l, i, i)).sum();
    compare(&mut wrong, "trace".into(), trace, number(&golden["trace"]), limit, trace);
    let wave: Vec<f64> = (0..l.n()).map(|i| (i as f64 + 1.0).sin()).collect();
    compare(&mut wrong, "x'Lx".into(), quadratic(l, &wave), number(&golden["quadratic"]), limit, trace);
    wrong
}

fn compare_mass(golden: &Value, barycentric: &[f64], voronoi: &[f64]) -> Vec<String> {
    let mut wrong = Vec::new();
    for row in rows(&golden["mass"]) {
        let i = row[0] as usize;
        for (kind, ours, theirs) in [("barycentric", barycentric[i], row[1]), ("Voronoi", voronoi[i], row[2])]
        {
            compare(&mut wrong, format!("{kind} mass of vertex {i}"), ours, theirs, row[3], theirs);
        }
    }
    let area = number(&golden["total_area"]);
    for (kind, masses) in [("barycentric", barycentric), ("Voronoi", voronoi)] {
        compare(&mut wrong, format!("sum of {kind} masses"), masses.iter().sum(), area, 1e-12, area);
    }
    wrong
}

/// Solves the golden constraints with `backend` and compares the sampled values.
fn compare_harmonic(golden: &Value, mesh: &TriangleMesh, l: &SymmetricCsr, backend: &Entry) -> Vec<String> {
    let constraints = rows(&golden["harmonic"]["constraints"]);
    let k = constraints[0].len() - 1;
    let vertices: Vec<u32> = constraints.iter().map(|row| row[0] as u32).collect();
    let values: Vec<f64> = constraints.iter().flat_map(|row| row[1..].to_vec()).collect();
    let Some(field) = harmonic(mesh, l.clone(), &vertices, &values, backend) else { return Vec::new() };
    let limit = Limits::of(backend.precision, backend.accuracy, DEFAULT_TOLERANCE).harmonic;
    let limit = limit.max(number(&golden["harmonic"]["limit"]));
    let scale = values.iter().fold(0.0, |most: f64, g| most.max(g.abs()));
    let mut wrong = Vec::new();
    for row in rows(&golden["harmonic"]["samples"]) {
        let v = row[0] as usize;
        for (column, &theirs) in row[1..].iter().enumerate() {
            let what = format!("{}: u[{v}][{column}]", backend.id);
            compare(&mut wrong, what, field[v * k + column], theirs, limit, scale);
        }
    }
    wrong
}

/// The default constraints of the `harmonic` workload: the vertices exactly, their values to rounding.
fn compare_default_constraints(golden: &Value, mesh: &TriangleMesh, l: &SymmetricCsr) -> Vec<String> {
    let theirs = rows(&golden["harmonic"]["constraints"]);
    let vertices = Constraints::sample(mesh, l, DEFAULT_CONSTRAINTS).default_set();
    if !vertices.iter().map(|&v| f64::from(v)).eq(theirs.iter().map(|row| row[0])) {
        return vec![format!("other default constraints: {vertices:?}")];
    }
    let mut wrong = Vec::new();
    let values = default_values(mesh, &vertices);
    for (ours, row) in values.chunks_exact(COLUMNS).zip(&theirs) {
        for (column, (&ours, &theirs)) in ours.iter().zip(&row[1..]).enumerate() {
            let what = format!("default value of vertex {} column {column}", row[0]);
            compare(&mut wrong, what, ours, theirs, VALUE_LIMIT, 1.0);
        }
    }
    wrong
}

/// The surface area, and as-rigid-as-possible deformation after one and after five iterations.
fn compare_open3d(golden: &Value, mesh: &TriangleMesh) -> Vec<String> {
    let mut wrong = Vec::new();
    let area = number(&golden["open3d"]["area"]);
    let ours = mass::lumped(mesh, Mass::Barycentric).iter().sum();
    compare(&mut wrong, "area".into(), ours, area, AREA_LIMIT, area);
    if golden["open3d"]["handles"].is_array() {
        let handles = rows(&golden["open3d"]["handles"]);
        // Open3D's first iteration is the step that comes before all of ours.
        for (after, iterations) in [("after_1", 0), ("after_5", 4)] {
            let moved = deformed(mesh, &handles, Weights::ClampedPerEdge, iterations);
            for row in rows(&golden["open3d"][after]) {
                for axis in 0..3 {
                    let what = format!("position {} axis {axis}, {after}", row[0]);
                    let ours = moved[row[0] as usize][axis];
                    compare(&mut wrong, what, ours, row[1 + axis], ARAP_LIMIT, mesh.diagonal());
                }
            }
        }
    }
    wrong
}

/// libigl's deformation by the same handles, and the distances of libigl and potpourri3d from one vertex.
fn compare_pipelines(golden: &Value, mesh: &TriangleMesh) -> Vec<String> {
    let mut wrong = Vec::new();
    let pipelines = &golden["pipelines"];
    if !pipelines.is_object() {
        return wrong;
    }
    let moved = deformed(mesh, &rows(&golden["open3d"]["handles"]), Weights::Plain, 5);
    for row in rows(&pipelines["igl_arap"]) {
        for axis in 0..3 {
            let what = format!("position {} axis {axis} of libigl", row[0]);
            let ours = moved[row[0] as usize][axis];
            compare(&mut wrong, what, ours, row[1 + axis], IGL_ARAP_LIMIT, mesh.diagonal());
        }
    }
    let source = number(&pipelines["source"]) as u32;
    let of = |mass| GeodesicProblem::new(mesh, mass).expect("usable");
    let libigl = distances(&of(Mass::Voronoi), source);
    let potpourri = distances(&of(Mass::Barycentric).shifted(POTPOURRI_SHIFT), source);
    for row in rows(&pipelines["distances"]) {
        for (name, ours, theirs) in [("libigl", &libigl, row[1]), ("potpourri3d", &potpourri, row[2])] {
            let what = format!("distance of {} by {name}", row[0]);
            compare(&mut wrong, what, ours[row[0] as usize], theirs, DISTANCE_LIMIT, mesh.diagonal());
        }
    }
    wrong
}

/// Distances from `source` by the heat method.
fn distances(problem: &GeodesicProblem, source: u32) -> Vec<f64> {
    let entry = registry::find("framechol-f64").expect("a built-in backend");
    let backend = (entry.open)(&OpenOptions::default()).expect("always there");
    let mut geodesic = Geodesic::prepare(&*backend, problem, &mut |_| {}).expect("positive definite");
    let mut distances = vec![0.0; problem.vertices()];
    geodesic.solve(&[source], &mut distances).expect("finite");
    distances
}

/// As-rigid-as-possible deformation of a closed mesh; clamped per edge the weights are those of Open3D.
fn deformed(mesh: &TriangleMesh, handles: &[Vec<f64>], weights: Weights, iterations: u32) -> Vec<[f64; 3]> {
    let mut sorted = handles.to_vec();
    sorted.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let vertices: Vec<u32> = sorted.iter().map(|row| row[0] as u32).collect();
    let targets: Vec<[f64; 3]> = sorted.iter().map(|row| [row[1], row[2], row[3]]).collect();
    let problem = ArapProblem::new(mesh, &vertices, weights).expect("golden handles are valid");
    let entry = registry::find("framechol-f64").expect("a built-in backend");
    let backend = (entry.open)(&OpenOptions::default()).expect("always there");
    let mut arap = Arap::prepare(&*backend, &problem, &mut |_| {}).expect("positive definite");
    let mut positions = mesh.positions().to_vec();
    arap.solve(&targets, iterations, &mut positions).expect("finite");
    positions
}

/// The field that is harmonic for `l` off `vertices`; `None`, with a line that says why, where the backend is not built in.
fn harmonic(
    mesh: &TriangleMesh,
    l: SymmetricCsr,
    vertices: &[u32],
    values: &[f64],
    backend: &Entry,
) -> Option<Vec<f64>> {
    let opened = match (backend.open)(&OpenOptions::default()) {
        Ok(opened) => opened,
        Err(unavailable) => {
            println!("{}: {unavailable}", backend.id);
            return None;
        }
    };
    let (n, k) = (l.n(), values.len() / vertices.len());
    let problem = Dirichlet::new(l, Some(mesh.positions()), vertices).expect("golden constraints are valid");
    let prepared = opened.prepare_harmonic(&problem, &PrepareOptions::columns(k), &mut |_| {});
    let mut handle = prepared.unwrap_or_else(|error| panic!("{}: {error}", backend.id));
    let mut field = vec![0.0; n * k];
    let solved = handle.solve(Columns::new(values, vertices.len(), k), Columns::new(&mut field, n, k));
    solved.unwrap_or_else(|error| panic!("{}: {error}", backend.id));
    Some(field)
}

/// Everything that differs on the mesh at `path`.
fn compare_mesh(golden: &Value, path: &Path) -> Vec<String> {
    let loaded = mesh_io::read_mesh(path).unwrap_or_else(|error| panic!("{error}"));
    let sum: String = loaded.sha256.iter().map(|byte| format!("{byte:02x}")).collect();
    if Some(sum.as_str()) != golden["mesh"]["sha256"].as_str() {
        return vec![format!("was read as another mesh: sha256 {sum}")];
    }
    let mesh = &loaded.mesh;
    let l = Laplacian::assemble(mesh, Weights::Plain).into_matrix();
    let mut wrong = compare_laplacian(golden, &l);
    wrong.extend(compare_mass(
        golden,
        &mass::lumped(mesh, Mass::Barycentric),
        &mass::lumped(mesh, Mass::Voronoi),
    ));
    wrong.extend(compare_default_constraints(golden, mesh, &l));
    wrong.extend(compare_open3d(golden, mesh));
    wrong.extend(compare_pipelines(golden, mesh));
    let small = l.n() <= EVERY_BACKEND_UP_TO;
    for backend in registry::BACKENDS.iter().filter(|backend| small || backend.id == "faer-llt") {
        wrong.extend(compare_harmonic(golden, mesh, &l, backend));
    }
    wrong
}

/// Compares every mesh before it fails, so that one run shows all.
fn assert_agreement(files: &[Value], root: &Path) {
    assert!(!files.is_empty(), "no golden values");
    let mut failures = Vec::new();
    for golden in files {
        let wrong = compare_mesh(golden, &root.join(mesh_file(golden)));
        failures.extend(wrong.into_iter().map(|line| format!("{}: {line}", mesh_file(golden))));
    }
    let shown = failures.iter().take(40).map(String::as_str).collect::<Vec<_>>().join("\n");
    assert!(failures.is_empty(), "{} differences:\n{shown}", failures.len());
}

#[test]
fn committed_meshes_agree() {
    assert_agreement(&golden_files(true), golden_folder().parent().expect("below reference"));
}

#[test]
fn real_meshes_agree() {
    let Some(data) = needs::data() else { return };
    assert_agreement(&golden_files(false), &data);
}

#[test]
fn a_wrong_laplacian_or_mass_is_noticed() {
    let golden =
        &golden_files(true).into_iter().find(|g| mesh_file(g).contains("hills")).expect("hills is committed");
    let path = golden_folder().parent().expect("below reference").join(mesh_file(golden));
    let mesh = mesh_io::read_mesh(&path).expect("committed mesh").mesh;
    let l = Laplacian::assemble(&mesh, Weights::Plain).into_matrix();
    assert_eq!(compare_laplacian(golden, &l), Vec::<String>::new());

    let changed = |change: &dyn Fn(usize, f64) -> f64| {
        let values = l.values().iter().enumerate().map(|(at, &value)| change(at, value)).collect();
        SymmetricCsr::new(l.row_starts().to_vec(), l.columns().to_vec(), values).expect("the same pattern")
    };
    let last = l.stored() - 2; // an entry that no sampled row holds: only the two sums see it
    for (what, wrong) in [
        ("sign", changed(&|_, value| -value)),
        ("full cotangents", changed(&|_, value| 2.0 * value)),
        ("f32", changed(&|_, value| f64::from(value as f32))),
        ("one entry", changed(&|at, value| if at == last { 0.0 } else { value })),
        ("clamped", Laplacian::assemble(&mesh, Weights::ClampedPerCorner).into_matrix()),
    ] {
        assert!(!compare_laplacian(golden, &wrong).is_empty(), "{what} went unnoticed");
    }
    let (barycentric, voronoi) = (mass::lumped(&mesh, Mass::Barycentric), mass::lumped(&mesh, Mass::Voronoi));
    assert_eq!(compare_mass(golden, &barycentric, &voronoi), Vec::<String>::new());
    assert!(!compare_mass(golden, &voronoi, &barycentric).is_empty(), "swapped masses went unnoticed");
}
