//! Iterative backends on real surfaces: they converge, in a number of iterations that the triangles hardly change.

use lapbench::mesh_io;
use lapsolve::backend::PrepareOptions;
use lapsolve::columns::Columns;
use lapsolve::dirichlet::Dirichlet;
use lapsolve::laplacian::{Laplacian, Weights};
use lapsolve::registry::{self, OpenOptions};
use lapsolve::residual::Residual;
use lapsolve::workload::harmonic::{COLUMNS, Constraints, DEFAULT_CONSTRAINTS, default_values};
use tests::needs;

const TOLERANCE: f64 = 1e-8;

/// Meshes, and the most iterations that `cg-amg` and `cg-multigrid` may take on them for four columns: a third above what
/// they take. A displaced sphere of 328,000 triangles takes 12.
const MOST_ITERATIONS: [(&str, u32); 5] = [
    ("armadillo_29k", 16),
    ("man_35k", 30),
    ("igea_269k", 20),
    ("discobolus_202k", 26),
    ("cortex_pial_lh_306k", 32),
];

#[test]
fn iterations_on_real_surfaces_are_bounded() {
    let Some(data) = needs::data() else { return };
    let mut wrong = Vec::new();
    for (name, most) in MOST_ITERATIONS {
        let path = data.join(format!("meshes/{name}.ply"));
        let mesh = mesh_io::read_mesh(&path).unwrap_or_else(|error| panic!("{error}")).mesh;
        let l = Laplacian::assemble(&mesh, Weights::Plain).into_matrix();
        let vertices = Constraints::sample(&mesh, &l, DEFAULT_CONSTRAINTS).default_set();
        let problem = Dirichlet::new(l, Some(mesh.positions()), &vertices).expect("default constraints");
        let (system, values) = (problem.system().expect("free vertices"), default_values(&mesh, &vertices));
        let n = system.n();
        let mut b = vec![0.0; n * COLUMNS];
        let values = Columns::new(&values[..], vertices.len(), COLUMNS);
        problem.right_hand_side(values, Columns::new(&mut b[..], n, COLUMNS));
        let b = Columns::new(&b[..], n, COLUMNS);
        for id in ["cg-amg", "cg-multigrid"] {
            let options = OpenOptions { tolerance: TOLERANCE, ..OpenOptions::default() };
            let backend = (registry::find(id).expect("a row").open)(&options).expect("always there");
            let mut factor = backend
                .prepare(system, &PrepareOptions::columns(COLUMNS), &mut |_| {})
                .unwrap_or_else(|error| panic!("{id} on {name}: {error}"));
            let mut x = vec![0.0; n * COLUMNS];
            let outcome = factor.solve(b, Columns::new(&mut x[..], n, COLUMNS));
            let relative = Residual::measure(system.matrix(), Columns::new(&x[..], n, COLUMNS), b).relative;
            let iterations = outcome.as_ref().ok().and_then(|solved| solved.iterations);
            if relative > 1.1 * TOLERANCE || iterations.is_none_or(|count| count > most) {
                wrong.push(format!("{id} on {name}: {outcome:?}, true residual {relative:e}"));
            }
        }
    }
    assert_eq!(wrong, Vec::<String>::new());
}
