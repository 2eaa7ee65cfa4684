//! A warm solve allocates nothing: counted over all threads of a process of its own.

use lapbench::engine::allocation::{CountingAllocator, count, is_counting};
use lapsolve::backend::PrepareOptions;
use lapsolve::columns::Columns;
use lapsolve::dirichlet::Dirichlet;
use lapsolve::registry::{BACKENDS, OpenOptions};
use lapsolve::sparse::SymmetricCsr;
use lapsolve::system::System;
use lapsolve::workload::transfer;
use lapsolve::workload::transfer::defaults::default_problem;
use lapsolve::workload::volume::Inflation;
use tests::sheet::sheet;

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

const SIDE: u32 = 25;
const MAX_COLUMNS: usize = 8;

/// The five-point stencil on a SIDE x SIDE grid plus `shift` on the diagonal.
fn grid(shift: f64) -> SymmetricCsr {
    let mut triplets = Vec::new();
    for i in 0..SIDE * SIDE {
        triplets.push((i, i, 4.0 + shift));
        if i % SIDE + 1 < SIDE {
            triplets.push((i, i + 1, -1.0));
        }
        if i / SIDE + 1 < SIDE {
            triplets.push((i, i + SIDE, -1.0));
        }
    }
    SymmetricCsr::from_triplets((SIDE * SIDE) as usize, &triplets).expect("an upper triangle")
}

fn wave(length: usize) -> Vec<f64> {
    (0..length).map(|i| (i as f64).sin()).collect()
}

/// Allocations of `work` once it has run twice: libraries may set something up in their first calls.
fn allocations_of(mut work: impl FnMut()) -> u64 {
    work();
    work();
    let before = count();
    work();
    count() - before
}

/// One test: others beside it would be counted too.
#[test]
fn nothing_is_allocated_once_warm() {
    assert!(is_counting(), "this test needs the counting allocator");
    solves_and_frames();
    kept_volumes();
}

fn solves_and_frames() {
    let system = System::new(grid(0.1), None).expect("finite, positive diagonal");
    let problem = Dirichlet::new(grid(0.1), None, &[0, 77, 600]).expect("valid constraints");
    let sheet = sheet(SIDE);
    let motion = default_problem(&sheet).expect("marks everywhere");
    let n = system.n();
    let (rhs, mut x) = (wave(n * MAX_COLUMNS), vec![0.0; n * MAX_COLUMNS]);
    for entry in BACKENDS {
        for threads in [1, 2] {
            let backend = match (entry.open)(&OpenOptions { threads, ..OpenOptions::default() }) {
                Ok(backend) => backend,
                Err(unavailable) => {
                    println!("SKIPPED {}: {unavailable}", entry.id);
                    continue;
                }
            };
            let options = PrepareOptions::columns(MAX_COLUMNS);
            let mut factor = backend.prepare(&system, &options, &mut |_| {}).expect(entry.id);
            let mut harmonic = backend.prepare_harmonic(&problem, &options, &mut |_| {}).expect(entry.id);
            for k in [1, 3, 4, MAX_COLUMNS] {
                let solve = allocations_of(|| {
                    x[..n * k].fill(0.0);
                    factor
                        .solve(Columns::new(&rhs[..n * k], n, k), Columns::new(&mut x[..n * k], n, k))
                        .expect(entry.id);
                });
                assert_eq!(solve, 0, "{}: solve of {k} columns, {threads} thread(s)", entry.id);
                let field = allocations_of(|| {
                    x[..n * k].fill(0.0);
                    harmonic
                        .solve(Columns::new(&rhs[..3 * k], 3, k), Columns::new(&mut x[..n * k], n, k))
                        .expect(entry.id);
                });
                assert_eq!(field, 0, "{}: harmonic of {k} columns, {threads} thread(s)", entry.id);
            }
            let mut frames = transfer::prepare(&*backend, &motion, &options, &mut |_| {}).expect(entry.id);
            let mut target = vec![[0.0; 3]; sheet.positions().len()];
            let frame = allocations_of(|| {
                frames.frame(sheet.positions(), &mut target).expect(entry.id);
            });
            assert_eq!(frame, 0, "{}: transfer, {threads} thread(s)", entry.id);
        }
    }
}

fn kept_volumes() {
    let ball = lapbench::mesh_source::load("sphere:3").expect("generated").mesh;
    let backend = lapsolve::registry::find("framechol-f64").expect("built in");
    for threads in [1, 2] {
        let backend =
            (backend.open)(&OpenOptions { threads, ..OpenOptions::default() }).expect("needs no device");
        let mut inflation = Inflation::new(&*backend, &ball, threads).expect("closed");
        let rotations = vec![[1.0, 0.0, 0.0, 0.0]; ball.positions().len()];
        let mut positions = ball.positions().to_vec();
        let allocations = allocations_of(|| {
            positions.copy_from_slice(ball.positions());
            let step = inflation.restore(1.1, &rotations, &mut positions).expect("in reach");
            assert!(step > 0.0);
        });
        assert_eq!(allocations, 0, "{threads} thread(s)");
    }
}
