//! Kernels one by one, at 30K, 100K and 300K triangles of the embedded human: assembly, sparse product, factorisation,
//! solve of three columns, harmonic field of four.
//!
//! `cargo bench -p lapbench` (or with a filter: `cargo bench -p lapbench -- solve/100000`). For comparisons between
//! backends use `lapbench run`: it interleaves them, checks every answer, and gives each a process of its own.

use criterion::{BenchmarkId, Criterion, SamplingMode, criterion_group, criterion_main};
use lapbench::shapes;
use lapsolve::backend::{Backend, PrepareOptions};
use lapsolve::columns::Columns;
use lapsolve::dirichlet::Dirichlet;
use lapsolve::laplacian::{Laplacian, Weights};
use lapsolve::mesh::TriangleMesh;
use lapsolve::registry::{self, BACKENDS, Entry, Family, OpenOptions};
use std::hint::black_box;

const SIZES: [usize; 3] = [30_000, 100_000, 300_000];
/// Constrained vertices of the harmonic field, spread evenly over the vertex order.
const CONSTRAINTS: usize = 50;

fn body(triangles: usize) -> TriangleMesh {
    shapes::generate(&format!("body:{triangles}")).expect("a generated name").expect("an allowed size")
}

/// Direct backends on the CPU that take systems of this size: they are fast enough for a statistics of repeats.
fn direct() -> impl Iterator<Item = (&'static Entry, Box<dyn Backend>)> {
    BACKENDS
        .iter()
        .filter(|entry| entry.family == Family::Direct && entry.max_unknowns.is_none())
        .filter_map(|entry| Some((entry, (entry.open)(&OpenOptions::default()).ok()?)))
}

fn assembly(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("assembly");
    for triangles in SIZES {
        let mesh = body(triangles);
        group.bench_function(BenchmarkId::new("assemble", triangles), |b| {
            b.iter(|| Laplacian::assemble(black_box(&mesh), Weights::Plain));
        });
        let mut laplacian = Laplacian::assemble(&mesh, Weights::Plain);
        group.bench_function(BenchmarkId::new("values-only", triangles), |b| {
            b.iter(|| laplacian.update(black_box(mesh.positions())));
        });
    }
}

fn product(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("sparse-product");
    for triangles in SIZES {
        let mesh = body(triangles);
        let matrix = Laplacian::assemble(&mesh, Weights::Plain).into_matrix();
        let (n, x) = (matrix.n(), mesh.positions().as_flattened());
        let mut y = vec![0.0; 3 * n];
        group.bench_function(BenchmarkId::new("3-columns", triangles), |b| {
            b.iter(|| matrix.multiply(Columns::new(black_box(x), n, 3), Columns::new(&mut y[..], n, 3)));
        });
    }
}

fn factor_and_solve(criterion: &mut Criterion) {
    for triangles in SIZES {
        let mesh = body(triangles);
        let laplacian = Laplacian::assemble(&mesh, Weights::Plain).into_matrix();
        let problem = Dirichlet::grounded(laplacian, Some(mesh.positions())).expect("a valid mesh");
        let system = problem.system().expect("free vertices");
        let n = system.n();
        let x = &mesh.positions().as_flattened()[..3 * n];
        let (mut rhs, mut y) = (vec![0.0; 3 * n], vec![0.0; 3 * n]);
        system.matrix().multiply(Columns::new(x, n, 3), Columns::new(&mut rhs[..], n, 3));
        for (entry, backend) in direct() {
            let options = PrepareOptions::columns(4);
            let mut group = criterion.benchmark_group("factorisation");
            group.sampling_mode(SamplingMode::Flat).sample_size(10);
            group.bench_function(BenchmarkId::new(entry.id, triangles), |b| {
                b.iter(|| backend.prepare(system, &options, &mut |_| {}).map(drop));
            });
            group.finish();
            let mut factor = backend.prepare(system, &options, &mut |_| {}).expect(entry.id);
            criterion.benchmark_group("solve-3-columns").bench_function(
                BenchmarkId::new(entry.id, triangles),
                |b| {
                    b.iter(|| factor.solve(Columns::new(&rhs[..], n, 3), Columns::new(&mut y[..], n, 3)));
                },
            );
        }
    }
}

fn harmonic(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("harmonic-4-columns");
    let backend = registry::find("framechol-f64").or(registry::find("faer-llt")).expect("built in");
    let backend = (backend.open)(&OpenOptions::default()).expect("available");
    for triangles in SIZES {
        let mesh = body(triangles);
        let laplacian = Laplacian::assemble(&mesh, Weights::Plain).into_matrix();
        let n = laplacian.n();
        let fixed: Vec<u32> = (0..CONSTRAINTS).map(|i| (i * n / CONSTRAINTS) as u32).collect();
        let problem = Dirichlet::new(laplacian, Some(mesh.positions()), &fixed).expect("valid constraints");
        let mut handle =
            backend.prepare_harmonic(&problem, &PrepareOptions::columns(4), &mut |_| {}).expect("definite");
        let values: Vec<f64> = (0..4 * CONSTRAINTS).map(|i| (i as f64).sin()).collect();
        let mut field = vec![0.0; 4 * n];
        group.bench_function(BenchmarkId::new("solve", triangles), |b| {
            b.iter(|| {
                let g = Columns::new(black_box(&values[..]), CONSTRAINTS, 4);
                handle.solve(g, Columns::new(&mut field[..], n, 4))
            });
        });
    }
}

criterion_group!(kernels, assembly, product, factor_and_solve, harmonic);
criterion_main!(kernels);
