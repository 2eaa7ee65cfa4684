//! Edited constraints against fresh handles.
use super::*;
use crate::error::EditError;

#[test]
fn edited_constraints_give_the_field_of_a_fresh_handle() {
    let (n, edges) = mesh(40);
    let mut laplacian = matrix(n, &edges);
    let starts = laplacian.row_starts().to_vec();
    starts[..n].iter().for_each(|&s| laplacian.values_mut()[s as usize] -= 0.1);
    let (options, k) = (PrepareOptions::columns(3), 3);
    for (id, backend) in backends(2) {
        let entry = registry::find(id).expect("a row");
        let fresh = |fixed: &[u32]| {
            let problem = Dirichlet::new(laplacian.clone(), None, fixed).expect("a constrained component");
            backend.prepare_harmonic(&problem, &options, &mut |_| {}).expect("definite")
        };
        let field = |handle: &mut dyn Harmonic, fixed: &[u32]| {
            let mut field = vec![f64::NAN; n * k];
            let g = right_hand_side(fixed.len(), k);
            let out = Columns::new(&mut field[..], n, k);
            handle.solve(Columns::new(&g, fixed.len(), k), out).expect("finite");
            field
        };
        let mut edited = fresh(&[3, 90, 777, 1555]);
        assert_eq!(edited.edit_constraints(&[3], &[]), Err(EditError::Vertex { vertex: 3, action: "added" }));
        assert_eq!(
            edited.edit_constraints(&[], &[3, 4]),
            Err(EditError::Vertex { vertex: 4, action: "removed" })
        );
        assert!(matches!(
            edited.edit_constraints(&[], &[3, 90, 777, 1555]),
            Err(EditError::Unconstrained { .. })
        ));
        for (add, remove, set) in [
            (&[800, 801][..], &[777][..], &[3, 90, 800, 801, 1555][..]),
            (&[777, 5], &[3, 90, 800, 801, 1555], &[5, 777]),
        ] {
            edited.edit_constraints(add, remove).expect("a legal edit");
            let (got, expected) = (field(&mut *edited, set), field(&mut *fresh(set), set));
            let apart = got.iter().zip(&expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(apart < Limits::of(entry.precision, entry.accuracy, 0.0).harmonic, "{id}: {apart:e}");
        }
    }
}

/// A pure Laplacian with the pattern of [`mesh`].
fn laplacian(side: u32) -> SymmetricCsr {
    let (n, edges) = mesh(side);
    let mut laplacian = matrix(n, &edges);
    let starts = laplacian.row_starts().to_vec();
    starts[..n].iter().for_each(|&s| laplacian.values_mut()[s as usize] -= 0.1);
    laplacian
}

/// Holds the field of `handle` with the constraints `set` against that of a fresh one and against the equations.
fn assert_edited(
    id: &str,
    backend: &dyn Backend,
    handle: &mut dyn Harmonic,
    laplacian: &SymmetricCsr,
    set: &[u32],
    k: usize,
) {
    let (n, entry) = (laplacian.n(), registry::find(id).expect("a row"));
    let limits = Limits::of(entry.precision, entry.accuracy, 0.0);
    let problem = Dirichlet::new(laplacian.clone(), None, set).expect("a constrained component");
    let mut fresh =
        backend.prepare_harmonic(&problem, &PrepareOptions::columns(k), &mut |_| {}).expect("definite");
    let g = right_hand_side(set.len(), k);
    let g = Columns::new(&g[..], set.len(), k);
    let mut fields = [vec![f64::NAN; n * k], vec![f64::NAN; n * k]];
    for (handle, field) in [handle, &mut *fresh].into_iter().zip(&mut fields) {
        handle.solve(g, Columns::new(&mut field[..], n, k)).expect("finite");
    }
    let apart = fields[0].iter().zip(&fields[1]).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(apart < limits.harmonic, "{id}: {apart:e} with {set:?}");
    for (row, &v) in set.iter().enumerate() {
        assert_eq!(fields[0][v as usize * k..(v as usize + 1) * k], *g.row(row), "{id}: vertex {v}");
    }
    let Some(system) = problem.system() else { return };
    let (mut b, mut x) = (vec![0.0; system.n() * k], vec![0.0; system.n() * k]);
    problem.right_hand_side(g, Columns::new(&mut b, system.n(), k));
    problem.gather(Columns::new(&fields[0][..], n, k), Columns::new(&mut x, system.n(), k));
    let (x, b) = (Columns::new(&x[..], system.n(), k), Columns::new(&b[..], system.n(), k));
    let residual = Residual::measure(system.matrix(), x, b);
    assert!(limits.accepts(&residual), "{id}: {residual:?} with {set:?}");
}

#[test]
fn long_sequences_of_edits_stay_as_accurate_as_fresh_handles() {
    let laplacian = laplacian(25);
    let mut random = 0x9e37_79b9_u64;
    let mut below = |n: usize| {
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (random >> 33) as usize % n
    };
    for (id, backend) in backends(2).into_iter().chain(backends(1)) {
        let mut set: Vec<u32> = (0..12).map(|i| 50 * i + 7).collect();
        let problem = Dirichlet::new(laplacian.clone(), None, &set).expect("a constrained component");
        let k = 1 + below(5);
        let mut handle =
            backend.prepare_harmonic(&problem, &PrepareOptions::columns(k), &mut |_| {}).expect("definite");
        for _ in 0..25 {
            let mut remove: Vec<u32> = (0..below(7)).map(|_| set[below(set.len())]).collect();
            remove.sort_unstable();
            remove.dedup();
            // Neighbours of each other too: the hardest case for the small system.
            let from = below(laplacian.n()) as u32;
            let mut add: Vec<u32> = (from..from + below(7) as u32).map(|v| v % 625).collect();
            add.retain(|v| !set.contains(v));
            add.sort_unstable();
            let mut next: Vec<u32> = set.iter().copied().filter(|v| !remove.contains(v)).collect();
            next.extend(&add);
            next.sort_unstable();
            if next.is_empty() {
                continue;
            }
            handle.edit_constraints(&add, &remove).expect("a legal edit");
            set = next;
            assert_edited(id, &*backend, &mut *handle, &laplacian, &set, k);
        }
    }
}

#[test]
fn every_constraint_may_move_and_values_may_follow() {
    let mut laplacian = laplacian(25);
    for (id, backend) in backends(2) {
        let (from, to) = ([3, 200, 413, 600], [10, 11, 301, 512]);
        let problem = Dirichlet::new(laplacian.clone(), None, &from).expect("a constrained component");
        let mut handle =
            backend.prepare_harmonic(&problem, &PrepareOptions::columns(4), &mut |_| {}).expect("definite");
        let before = handle.footprint();
        handle.edit_constraints(&to, &from).expect("a legal edit");
        let edited = handle.footprint();
        assert!(edited.host_bytes > before.host_bytes, "{id}: the border is held");
        assert_edited(id, &*backend, &mut *handle, &laplacian, &to, 4);
        handle.edit_constraints(&from, &to).expect("a legal edit");
        assert_eq!(handle.footprint(), before, "{id}: edits that are taken back leave nothing behind");
        handle.edit_constraints(&to, &from).expect("a legal edit");
        laplacian.values_mut().iter_mut().for_each(|v| *v *= 3.0);
        handle.update_values(laplacian.values(), &mut |_| {}).expect("definite");
        assert_edited(id, &*backend, &mut *handle, &laplacian, &to, 4);
    }
}
