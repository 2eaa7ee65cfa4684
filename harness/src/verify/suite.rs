//! Which checks run on what.

use super::behaviour::Field;
use super::equations;
use super::finding::Findings;
use super::subject::{Discretisation, Subject};
use super::{analytic, arap, geodesic, matrix, motion, skinning, smoothing};
use crate::shapes;
use lapsolve::mesh::TriangleMesh;
use lapsolve::registry::Entry;

/// Everything with an answer on paper (sine modes on n x n `grids`), and the behaviour on a small sphere, torus and two
/// pieces. Iterative backends must converge.
pub fn analytic(
    subjects: &[Subject],
    discretisation: &Discretisation,
    trusted: &[Entry],
    grids: &[usize],
) -> Findings {
    let mut findings = Findings::default();
    for &n in grids {
        analytic::sine_modes(n, subjects, discretisation, trusted, &mut findings);
    }
    analytic::linear_precision(33, subjects, discretisation, &mut findings);
    analytic::convergence(subjects, &mut findings);
    smoothing::check(subjects, &mut findings);
    geodesic::check(subjects, &mut findings);
    for name in ["sphere:3", "torus:16"] {
        let mesh = shapes::generate(name).and_then(Result::ok).expect("a generated shape");
        on_mesh(name, &mesh, subjects, discretisation, trusted, true, &mut findings);
    }
    on_mesh(
        "two spheres and an unused vertex",
        &pieces(),
        subjects,
        discretisation,
        trusted,
        true,
        &mut findings,
    );
    findings
}

/// Everything that holds on any mesh.
pub fn of_mesh(
    name: &str,
    mesh: &TriangleMesh,
    subjects: &[Subject],
    discretisation: &Discretisation,
    trusted: &[Entry],
) -> Findings {
    let mut findings = Findings::default();
    on_mesh(name, mesh, subjects, discretisation, trusted, false, &mut findings);
    findings
}

fn on_mesh(
    name: &str,
    mesh: &TriangleMesh,
    subjects: &[Subject],
    discretisation: &Discretisation,
    trusted: &[Entry],
    must_converge: bool,
    findings: &mut Findings,
) {
    findings.about(name, None);
    matrix::check(mesh, discretisation, findings);
    for equations in equations::of_mesh(mesh, discretisation, trusted, findings) {
        equations.ask(name, subjects, must_converge, findings);
    }
    for subject in subjects {
        findings.about(name, Some(&subject.id));
        Field::of(mesh, subject).check(subject, must_converge, findings);
    }
    motion::check(name, mesh, subjects, must_converge, findings);
    skinning::check(name, mesh, subjects, trusted, must_converge, findings);
    arap::check(name, mesh, subjects, must_converge, findings);
}

/// Two spheres of different size, apart, and a vertex that no triangle uses.
fn pieces() -> TriangleMesh {
    let sphere = shapes::generate("sphere:2").and_then(Result::ok).expect("a generated shape");
    let n = sphere.positions().len() as u32;
    let second = sphere.positions().iter().map(|&[x, y, z]| [3.0 + 0.5 * x, 0.5 * y, 0.7 * z]);
    let positions = sphere.positions().iter().copied().chain(second).chain([[9.0, 9.0, 9.0]]).collect();
    let triangles =
        sphere.triangles().iter().copied().chain(sphere.triangles().iter().map(|t| t.map(|v| v + n)));
    TriangleMesh::new(positions, triangles.collect()).expect("two meshes are a mesh")
}
