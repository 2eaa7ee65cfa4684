//! What a handle says it holds is what the allocator says: counted over all threads of a process of its own.

use lapbench::engine::allocation::{CountingAllocator, held, is_counting};
use lapsolve::backend::{Footprint, PrepareOptions};
use lapsolve::dirichlet::Dirichlet;
use lapsolve::laplacian::{Laplacian, Weights};
use lapsolve::registry::{BACKENDS, OpenOptions};
use lapsolve::system::System;
use tests::sheet::sheet;

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

/// Vertices along one side of the sheet: enough that the numbers outweigh everything that is not counted one by one.
const SIDE: u32 = 120;

/// Shares of what is held by which a handle may be off: headers, names, and vectors of one entry per thread.
const TOLERANCE: f64 = 0.003;

/// Rows whose footprint is exact.
const EXACT: [&str; 3] = ["framechol-f64", "framechol-f32", "framechol-mixed"];

/// Compares what `prepare` leaves behind with what its handle says of the host.
fn compare<H>(what: &str, prepare: impl Fn() -> H, footprint: impl Fn(&H) -> Footprint) {
    drop(prepare()); // what libraries set up once
    let before = held();
    let handle = prepare();
    let kept = (held() - before) as f64;
    let said = footprint(&handle).host_bytes.expect("a row that knows its bytes") as f64;
    println!("{what}: holds {kept} bytes, says {said}");
    assert!((kept - said).abs() <= TOLERANCE * kept, "{what}: holds {kept} bytes, says {said}");
}

#[test]
fn handles_hold_what_they_say() {
    assert!(is_counting(), "this test needs the counting allocator");
    let mesh = sheet(SIDE);
    let laplacian = Laplacian::assemble(&mesh, Weights::Plain).into_matrix();
    let places = Some(mesh.positions().to_vec());
    let mut shifted = laplacian.clone();
    shifted.add_diagonal(&vec![0.01; laplacian.n()]);
    let system = System::new(shifted, places.clone()).expect("finite, positive diagonal");
    let fixed: Vec<u32> = (0..SIDE * SIDE).step_by(997).collect();
    let problem = Dirichlet::new(laplacian, places.as_deref(), &fixed).expect("valid constraints");
    let options = PrepareOptions::columns(3);
    for entry in BACKENDS.iter().filter(|entry| EXACT.contains(&entry.id)) {
        for threads in [1, 2] {
            let backend =
                (entry.open)(&OpenOptions { threads, ..OpenOptions::default() }).expect("needs no device");
            compare(
                &format!("{}, {threads} thread(s), poisson", entry.id),
                || backend.prepare(&system, &options, &mut |_| {}).expect("prepared"),
                |factor| factor.footprint(),
            );
            compare(
                &format!("{}, {threads} thread(s), harmonic", entry.id),
                || backend.prepare_harmonic(&problem, &options, &mut |_| {}).expect("prepared"),
                |harmonic| harmonic.footprint(),
            );
        }
    }
}
