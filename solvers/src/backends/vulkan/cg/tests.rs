//! The backends on whatever device there is, with the validation layer on.

use super::super::tests::{device, skip};
use super::super::{Access, Device, Settings};
use super::VulkanCg;
use super::factor::CgOnDevice;
use super::kernels::Number;
use super::precondition::Method;
use crate::backend::{Backend, Factor, PrepareOptions};
use crate::backends::cg::operator::{FullCsr, Operator};
use crate::backends::cg::test_systems::{dirichlet, slivers, sphere, wave};
use crate::backends::cg::workers::Workers;
use crate::columns::Columns;
use crate::conformance;
use crate::error::SolveError;
use crate::registry::find;
use crate::residual::Residual;
use crate::sparse::SymmetricCsr;
use crate::system::System;
use std::sync::Arc;

const ALL: [Method; 3] = [Method::Jacobi, Method::Fsai, Method::Multigrid];

#[test]
fn conforms() {
    for id in ["vulkan-cg-jacobi", "vulkan-cg-fsai", "vulkan-cg-multigrid"] {
        match conformance::check(find(id).expect("a row")) {
            Ok(violations) => assert_eq!(violations, [], "{id}"),
            Err(reason) => return skip(&reason.to_string()),
        }
    }
}

/// A handle with the numbers T, on a device with f64 or without.
fn handle<T: Number>(device: &Arc<Device>, system: &System, method: Method, tolerance: f64) -> CgOnDevice<T> {
    let mut workers = Workers::one();
    let matrix = FullCsr::new(&mut workers, system.matrix());
    let points = matrix.rows().iter().map(|&r| system.positions().map(|p| p[r as usize])).collect();
    CgOnDevice::new(device, workers, matrix, points, method, tolerance, &mut |_| {}).expect("prepares")
}

/// Iterations for `columns` columns; the residual is checked.
fn iterations(factor: &mut dyn Factor, matrix: &SymmetricCsr, columns: usize, tolerance: f64) -> u32 {
    let n = matrix.n();
    let (b, mut x) = (wave(n, columns), vec![0.0; n * columns]);
    let b = Columns::new(&b[..], n, columns);
    let solved = factor.solve(b, Columns::new(&mut x[..], n, columns)).expect("converges");
    let relative = Residual::measure(matrix, Columns::new(&x[..], n, columns), b).relative;
    assert!(relative <= 1.1 * tolerance, "residual {relative:e}");
    solved.iterations.expect("counted")
}

/// Both ways of reading, staged and not, f64 and f32 with refinement: all reach 1e-10, and nothing is left behind.
#[test]
fn every_number_and_way_of_reading_reaches_the_tolerance() {
    let system = dirichlet(&sphere(12, 1.0), 40);
    for access in [Access::Texel, Access::Storage] {
        for force_staging in [false, true] {
            let settings = Settings { access: Some(access), force_staging, ..Settings::default() };
            let Some(device) = device(&settings) else { return };
            for method in ALL {
                let mut narrow = handle::<f32>(&device, &system, method, 1e-10);
                iterations(&mut narrow, system.matrix(), 5, 1e-10);
                if device.traits().f64 {
                    let mut wide = handle::<f64>(&device, &system, method, 1e-10);
                    iterations(&mut wide, system.matrix(), 5, 1e-10);
                }
            }
            assert_eq!(device.used(), 0, "everything is released");
        }
    }
}

/// The better the preconditioner, the fewer iterations; the V-cycle's hardly grow with the mesh.
#[test]
fn preconditioners_are_worth_it() {
    let Some(device) = device(&Settings::default()) else { return };
    let count = |f: u32, method| {
        let system = dirichlet(&sphere(f, 1.0), (f * f) as usize);
        iterations(&mut handle::<f32>(&device, &system, method, 1e-8), system.matrix(), 3, 1e-8)
    };
    let (jacobi, fsai, multigrid) =
        (count(30, Method::Jacobi), count(30, Method::Fsai), count(30, Method::Multigrid));
    assert!(2 * fsai < jacobi + 40 && 5 * multigrid < jacobi, "{jacobi}, {fsai}, {multigrid}");
    assert!(multigrid <= 30 && count(60, Method::Multigrid) <= 36, "{multigrid}");
    let system = dirichlet(&slivers(30, 1e-3), 300);
    for method in [Method::Fsai, Method::Multigrid] {
        iterations(&mut handle::<f32>(&device, &system, method, 1e-8), system.matrix(), 3, 1e-8);
    }
}

/// Out of reach or not positive definite: an honest report with the residual reached, in bounded time.
#[test]
fn failures_are_reported() {
    let Some(device) = device(&Settings::default()) else { return };
    let backend = |method, tolerance| VulkanCg { device: Arc::clone(&device), method, tolerance, threads: 1 };
    let system = dirichlet(&sphere(8, 1.0), 40);
    let mut triplets: Vec<_> = (0..50u32).map(|i| (i, i, 1.0)).collect();
    triplets.extend((0..49u32).map(|i| (i, i + 1, -0.6)));
    let indefinite = SymmetricCsr::from_triplets(50, &triplets).expect("an upper triangle");
    let indefinite = System::new(indefinite, None).expect("a positive diagonal");
    for (system, tolerance) in [(&system, 1e-30), (&indefinite, 1e-8)] {
        let n = system.n();
        let (b, mut x) = (wave(n, 1), vec![0.0; n]);
        let mut factor = backend(Method::Jacobi, tolerance)
            .prepare(system, &PrepareOptions::columns(1), &mut |_| {})
            .expect("prepares");
        let b = Columns::new(&b[..], n, 1);
        let outcome = factor.solve(b, Columns::new(&mut x[..], n, 1));
        let Err(SolveError::NotConverged { iterations, residual }) = outcome else { panic!("{outcome:?}") };
        let relative = Residual::measure(system.matrix(), Columns::new(&x[..], n, 1), b).relative;
        // What is claimed is the larger of two norms; on these systems they are not far apart.
        let honest = residual >= 0.9 * relative && residual <= 10.0 * relative + 1e-15;
        assert!(honest, "claims {residual:e}, has {relative:e}");
        assert!(iterations < 25_000, "{iterations}");
    }
}
