//! lapsolve against libigl and Open3D, run now on the same meshes: every entry, every vertex.

use std::fs;
use std::path::{Path, PathBuf};

use lapbench::mesh_io;
use lapbench::reference::igl::{self, IglValues};
use lapbench::reference::pipelines::{self, Question};
use lapbench::reference::{Agreement, Python, open3d};
use lapsolve::backend::Backend;
use lapsolve::laplacian::{Laplacian, Weights};
use lapsolve::limits::{DEFAULT_TOLERANCE, Limits};
use lapsolve::mesh::TriangleMesh;
use lapsolve::registry::{self, OpenOptions};
use lapsolve::sparse::SymmetricCsr;
use tests::needs;

/// Every mesh of these folders of the data.
const FOLDERS: [&str; 3] = ["meshes", "bad", "sequences"];

/// The PLY files of the data folder, in order.
fn real_meshes(data: &Path) -> Vec<PathBuf> {
    let files =
        FOLDERS.iter().flat_map(|folder| fs::read_dir(data.join(folder)).expect("a folder of the data"));
    let mut files: Vec<PathBuf> = files.map(|file| file.expect("readable folder").path()).collect();
    files.retain(|file| file.extension().is_some_and(|extension| extension == "ply"));
    files.sort();
    assert!(!files.is_empty(), "no meshes in {}", data.display());
    files
}

fn committed(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../reference/golden/meshes").join(name)
}

fn mesh(path: &Path) -> TriangleMesh {
    mesh_io::read_mesh(path).unwrap_or_else(|error| panic!("{error}")).mesh
}

/// A direct solver, and the error that its harmonic fields may have.
fn solver() -> (Box<dyn Backend>, f64) {
    let entry = registry::find("faer-llt").expect("a built-in backend");
    let opened = (entry.open)(&OpenOptions::default()).expect("faer is a default feature");
    (opened, Limits::of(entry.precision, entry.accuracy, DEFAULT_TOLERANCE).harmonic)
}

/// Prints one line per quantity, and fails where one is beyond its limit.
fn assert_agreement(path: &Path, agreements: &[Agreement]) {
    let name = path.file_stem().unwrap_or_default().display();
    for Agreement { quantity, compared, worst, limit, .. } in agreements {
        println!("{name:24} {quantity:36} {compared:8} compared, off by {worst:.1e} of {limit:.0e}");
    }
    assert!(!agreements.is_empty() && agreements.iter().all(|agreement| agreement.compared > 0));
    let wrong: Vec<_> = agreements.iter().filter(|agreement| !agreement.holds()).collect();
    assert!(wrong.is_empty(), "{}: {wrong:#?}", path.display());
}

fn assert_agrees_with_igl(python: &Python, path: &Path) {
    let mesh = mesh(path);
    let theirs =
        IglValues::compute(python, &mesh).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let (backend, limit) = solver();
    let agreements = igl::compare(&mesh, &theirs, backend.as_ref(), limit);
    assert_agreement(path, &agreements.unwrap_or_else(|error| panic!("{}: {error}", path.display())));
}

#[test]
fn committed_meshes_agree_with_igl() {
    let Some(python) = needs::reference().map(Python::at) else { return };
    for name in ["sphere_2.obj", "grid_12.obj", "hills_12.obj", "blob_2.obj", "pieces.obj"] {
        assert_agrees_with_igl(&python, &committed(name));
    }
}

#[test]
fn real_meshes_agree_with_igl() {
    let (Some(python), Some(data)) = (needs::reference().map(Python::at), needs::data()) else { return };
    for file in real_meshes(&data) {
        assert_agrees_with_igl(&python, &file);
    }
}

#[test]
fn wrong_matrices_and_fields_disagree_with_igl() {
    let Some(python) = needs::reference().map(Python::at) else { return };
    let mesh = mesh(&committed("hills_12.obj"));
    let theirs = IglValues::compute(&python, &mesh).expect("libigl takes this mesh");
    let laplacian = Laplacian::assemble(&mesh, Weights::Plain);
    let l = laplacian.matrix();
    let notices = |l: &SymmetricCsr| {
        igl::compare_laplacian(&mesh, &laplacian, l, &theirs).iter().any(|agreement| !agreement.holds())
    };
    assert!(!notices(l));
    for (what, factor) in [("sign", -1.0), ("full cotangents", 2.0), ("rounding to f32", 1.0 + 6e-8)] {
        let values = l.values().iter().map(|value| factor * value).collect();
        let wrong = SymmetricCsr::new(l.row_starts().to_vec(), l.columns().to_vec(), values)
            .expect("the same pattern");
        assert!(notices(&wrong), "{what} went unnoticed");
    }
    let mut field = theirs.field.clone();
    assert!(igl::compare_fields(&field, &theirs, 1e-9).holds());
    *field.last_mut().expect("not empty") += 1e-8;
    assert!(!igl::compare_fields(&field, &theirs, 1e-9).holds(), "one wrong value went unnoticed");
}

#[test]
fn open3d_reads_the_same_mesh_and_area() {
    let (Some(python), Some(data)) = (needs::reference().map(Python::at), needs::data()) else { return };
    for path in real_meshes(&data) {
        let agreements = open3d::compare_reading(&python, &path, &mesh(&path));
        assert_agreement(&path, &agreements.unwrap_or_else(|error| panic!("{}: {error}", path.display())));
    }
}

#[test]
fn open3d_deforms_a_closed_mesh_in_the_same_way() {
    let Some(python) = needs::reference().map(Python::at) else { return };
    let mesh = mesh(&committed("blob_2.obj"));
    let (backend, _) = solver();
    let handles = [0, 40, 80, 120, 161];
    let x = mesh.positions();
    let targets = handles.map(|v: u32| [x[v as usize][0], 1.1 * x[v as usize][1], x[v as usize][2] + 0.05]);
    let agreement = open3d::compare_deformation(&python, &mesh, &handles, &targets, backend.as_ref());
    let agreement = agreement.unwrap_or_else(|error| panic!("{error}"));
    assert!(agreement.holds() && agreement.compared == 3 * x.len(), "{agreement:?}");
}

/// Deformation and distances on closed, well-shaped meshes: Open3D, libigl, and potpourri3d where it is installed.
fn assert_pipelines_agree(python: &Python, path: &Path) {
    let mesh = mesh(path);
    let (backend, _) = solver();
    let (handles, targets) = lapsolve::workload::arap::defaults::handles(&mesh);
    let question = Question { handles: &handles, targets: &targets, iterations: 5, source: 7 };
    let agreements = pipelines::compare(python, &mesh, question, backend.as_ref());
    let agreements = agreements.unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    assert!(agreements.len() >= 3);
    assert_agreement(path, &agreements);
}

#[test]
fn committed_meshes_deform_and_measure_as_elsewhere() {
    let Some(python) = needs::reference().map(Python::at) else { return };
    assert_pipelines_agree(&python, &committed("sphere_2.obj"));
}

#[test]
fn real_meshes_deform_and_measure_as_elsewhere() {
    let (Some(python), Some(data)) = (needs::reference().map(Python::at), needs::data()) else { return };
    for name in ["meshes/femur_8k.ply", "meshes/smpl_woman_14k.ply"] {
        assert_pipelines_agree(&python, &data.join(name));
    }
}

#[test]
fn a_missing_or_broken_interpreter_is_an_error_with_a_reason() {
    let mesh = mesh(&committed("sphere_2.obj"));
    let absent = IglValues::compute(&Python::at("/nowhere/python".into()), &mesh);
    assert!(absent.is_err());
    let silent = IglValues::compute(&Python::at("/bin/true".into()), &mesh).map(|_| ()).unwrap_err();
    assert!(silent.to_string().contains("printed no JSON"), "{silent}");
    let failing = IglValues::compute(&Python::at("/bin/false".into()), &mesh).map(|_| ()).unwrap_err();
    assert!(failing.to_string().contains("igl_reference.py"), "{failing}");
}
