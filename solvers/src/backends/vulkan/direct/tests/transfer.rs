//! Whole frames on the device against frames put together on the CPU.
use super::*;
use crate::backends::vulkan::buffer::{Buffer, Input, Place, constant, read};
use crate::backends::vulkan::plan::Plan;
use crate::laplacian::Weights;
use crate::mesh::TriangleMesh;
use crate::registry::find;
use crate::rotation::{about_axis, product};
use crate::vector::Vector;
use crate::workload::transfer::defaults::{default_marks, default_problem};
use crate::workload::transfer::fragments::Fragments;
use crate::workload::transfer::tests::{error, together, tube};
use crate::workload::transfer::{Transfer, TransferProblem};
use crate::workload::twist::Twist;

/// Two tubes with marks, one without, and a vertex that no triangle uses.
fn pieces() -> (TriangleMesh, TransferProblem) {
    let (a, b) = (tube(10, 0.2, [0.0; 3]), tube(11, 0.1, [1.0, 20.0, 0.0]));
    let template = together(&a, &b);
    let all = together(&template, &tube(6, 0.0, [1.0, 3.0, 0.0]));
    let mut positions = all.positions().to_vec();
    positions.push([100.0; 3]);
    let target = TriangleMesh::new(positions, all.triangles().to_vec()).expect("valid");
    let first = a.triangles().len() as u32;
    let pairs: Vec<_> =
        (0..20).map(|i| (7 * i, 7 * i)).chain((0..20).map(|i| (first + 8 * i, first + 8 * i))).collect();
    let problem = TransferProblem::new(&template, target, &pairs, Weights::Plain).expect("usable");
    (template, problem)
}

fn whole() -> (TriangleMesh, TransferProblem) {
    let mesh = tube(23, 0.3, [3.0, 4.0, 5.0]);
    let problem = default_problem(&mesh).expect("usable");
    (mesh, problem)
}

fn poses(template: &TriangleMesh) -> Vec<Vec<Vector>> {
    let twist = Twist::of(template);
    let at = |k| {
        let mut pose = template.positions().to_vec();
        twist.frame(k, &mut pose);
        pose
    };
    vec![template.positions().to_vec(), at(39), at(117)]
}

/// A device that is the CPU leaves frames to the CPU.
#[test]
fn a_software_device_has_no_frames_of_its_own() {
    let Some(backend) =
        opened::<f64, Single<f64>>(&Settings { access: Some(Access::Texel), ..Settings::default() })
    else {
        return;
    };
    let frames = backend.prepare_transfer(&whole().1, &PrepareOptions::columns(4), &mut |_| {});
    assert!(matches!(frames, Ok(None)));
}

/// Frames of both problems agree with those around a dense factor, to `limit` of the diagonal; so do their traces.
fn agree<T: Number, M: Method<T>>(settings: &Settings, limit: f64) {
    let Some(backend) = opened::<T, M>(settings) else { return };
    let dense = (find("dense").expect("built in").open)(&OpenOptions::default()).expect("always there");
    for (template, problem) in [whole(), pieces()] {
        let target = problem.target();
        let mut expected = Transfer::prepare(&*dense, &problem, &mut |_| {}).expect("definite");
        let frames = backend.prepare_transfer(&problem, &PrepareOptions::columns(4), &mut |_| {});
        let mut frames = frames.expect("definite").expect("on the device");
        for pose in poses(&template) {
            let mut moved =
                [vec![[0.0; 3]; target.positions().len()], vec![[f64::NAN; 3]; target.positions().len()]];
            expected.frame(&pose, &mut moved[0]).expect("solvable");
            let solved = frames.frame(&pose, &mut moved[1]).expect("solvable");
            assert!(solved.iterations.is_none_or(|pairs| pairs == 2), "{solved:?}");
            let off = error(target, &moved[0], &moved[1]);
            assert!(off < limit, "{settings:?}: {off:e}");
            assert_eq!(expected.replaced(), frames.replaced(), "{settings:?}");
            let (host, device) = (expected.trace().expect("kept"), frames.trace().expect("read back"));
            assert_eq!(host.constraints, device.constraints);
            for (name, a, b) in [("field", host.field, device.field), ("U", host.rhs, device.rhs)] {
                assert_eq!(a.len(), b.len());
                let size = a.iter().fold(0.0_f64, |most, a| most.max(a.abs()));
                let off = a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                assert!(off < limit * size, "{settings:?}, {name}: {off:e} of {size:e}");
            }
        }
        if backend.device.traits().tick_ns.is_some() {
            let phases = frames.device_phases().expect("runs");
            // A refined solve has two pairs of sweeps.
            let seen = |name| (1..=2).contains(&phases.iter().filter(|phase| phase.0 == name).count());
            for name in ["field couple", "normalise", "turn", "divergence", "space forward 00"] {
                assert!(seen(name), "{name}: {phases:?}");
            }
        }
    }
}

#[test]
fn frames_agree_with_those_of_the_cpu() {
    for settings in apart() {
        agree::<f64, Single<f64>>(&settings, 1e-12);
        agree::<f32, Single<f32>>(&settings, 2e-6);
        agree::<f32, Mixed>(&settings, 1e-9);
    }
    let access = Some(Access::Storage);
    agree::<f32, Single<f32>>(&Settings { without_f64: true, access, ..Settings::default() }, 2e-6);
}

/// Target positions of a twisted pose.
pub(super) fn frame(backend: &Direct<f64, Single<f64>>) -> Vec<Vector> {
    let (template, problem) = whole();
    let frames = backend.prepare_transfer(&problem, &PrepareOptions::columns(4), &mut |_| {});
    let mut target = vec![[0.0; 3]; problem.target().positions().len()];
    let mut frames = frames.expect("definite").expect("on the device");
    frames.frame(&poses(&template)[1], &mut target).expect("solvable");
    target
}

/// From a field to U, with rows where it vanishes, on a mesh whose sizes are no multiple of a workgroup.
fn breaks_apart<T: Number>(settings: &Settings, limit: f64) {
    let Some(backend) = opened::<T, Single<T>>(settings) else { return };
    let (device, (_, problem)) = (&backend.device, pieces());
    let (target, marks) = (problem.target(), problem.marks());
    let n = target.positions().len();
    let host = Fragments::new(problem.laplacian(), target.positions());
    let mut field = wave(4 * n);
    let vanished = [0, 64, 130, n - 1]; // the last one is on no triangle
    vanished.iter().for_each(|&v| field[4 * v..4 * v + 4].fill(4e-4));
    let rotations: Vec<[f64; 4]> =
        (0..marks.all().len()).map(|m| product(about_axis(0, 0.1 * m as f64), about_axis(1, 1.0))).collect();

    let mut quaternions = vec![[0.0; 4]; n];
    host.normalise(&field, 0..n, &mut quaternions);
    for &v in &vanished[..3] {
        quaternions[v] = rotations[marks.nearest(target.positions()[v])];
    }
    let detached: Vec<usize> =
        (0..n).filter(|&v| problem.laplacian().incidence().at(v).is_empty() && v < n - 1).collect();
    assert!(!detached.is_empty());
    let (mut turns, mut u) = (vec![[0.0; 4]; host.triangles()], vec![0.0; 3 * n]);
    host.turn(&quaternions, 0..turns.len(), &mut turns);
    host.gather(&turns, 0..n, &mut u);

    let fragments = Fragmentation::<T>::new(device, &problem).expect("room");
    let rows: Vec<[T; PLANE]> =
        field.as_chunks().0.iter().map(|row: &[f64; 4]| row.map(T::from_f64)).collect();
    let field = constant(device, &rows).expect("room");
    let mut input = Input::new(device, 3 + rotations.len()).expect("room");
    input.host()[3..].iter_mut().zip(&rotations).for_each(|(to, q)| *to = q.map(T::from_f64));
    let out = Buffer::new(device, Place::Device, (n * PLANE * size_of::<T>()) as u64).expect("room");
    let mut plan = Plan::new(device);
    input.upload(&mut plan);
    plan.barrier();
    fragments.list(&mut plan, &field, (&input, 3), &out);
    let mut recorded = plan.record().expect("recorded");
    for _ in 0..2 {
        recorded.run().expect("runs");
    }
    assert_eq!(read::<u32>(device, fragments.replaced.buffer(), 1).expect("room"), [3]);
    let seen: Vec<[T; PLANE]> = read(device, &fragments.quaternions, n).expect("room");
    for (v, (seen, expected)) in seen.iter().zip(&quaternions).enumerate() {
        assert!((0..4).all(|c| (seen[c].to_f64() - expected[c]).abs() < limit), "{v}: {expected:?}");
    }
    let seen: Vec<[T; PLANE]> = read(device, &out, n).expect("room");
    let size = u.iter().fold(0.0_f64, |most, u| most.max(u.abs()));
    for (v, (seen, expected)) in seen.iter().zip(u.chunks(3)).enumerate() {
        let off = |c: usize| (seen[c].to_f64() / fragments.scale - expected[c]).abs();
        assert!((0..3).all(|c| off(c) < limit * size), "{v}: {expected:?}");
    }
}

#[test]
fn a_field_becomes_differential_coordinates() {
    for settings in apart() {
        breaks_apart::<f64>(&settings, 1e-14);
        breaks_apart::<f32>(&settings, 2e-6);
    }
}

/// Quaternions that cancel in a triangle leave the first one.
#[test]
fn opposite_rotations_in_a_triangle_leave_the_first() {
    let corners = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let mesh = TriangleMesh::new(corners, vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]).expect("valid");
    let problem = TransferProblem::new(&mesh, mesh.clone(), &default_marks(&mesh), Weights::Plain);
    let problem = problem.expect("usable");
    let Some(backend) =
        opened::<f64, Single<f64>>(&Settings { access: Some(Access::Storage), ..Settings::default() })
    else {
        return;
    };
    let device = &backend.device;
    let third = 0.75_f64.sqrt();
    // Three quaternions of vertices 0, 1, 2 at 120 degrees in the plane of w and x.
    let field =
        [[1.0, 0.0, 0.0, 0.0], [-0.5, third, 0.0, 0.0], [-0.5, -third, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];
    let host = Fragments::new(problem.laplacian(), mesh.positions());
    let (mut turns, mut u) = (vec![[0.0; 4]; 4], vec![0.0; 12]);
    host.turn(&field, 0..4, &mut turns);
    host.gather(&turns, 0..4, &mut u);
    let fragments = Fragmentation::<f64>::new(device, &problem).expect("room");
    let input = Input::new(device, 4).expect("room");
    let out = Buffer::new(device, Place::Device, 16 * 8).expect("room");
    let mut plan = Plan::new(device);
    fragments.list(&mut plan, &constant(device, &field).expect("room"), (&input, 0), &out);
    plan.record().expect("recorded").run().expect("runs");
    let seen: Vec<[f64; PLANE]> = read(device, &out, 4).expect("room");
    for (seen, expected) in seen.iter().zip(u.chunks(3)) {
        assert!(
            (0..3).all(|c| (seen[c] / fragments.scale - expected[c]).abs() < 1e-14),
            "{seen:?} {expected:?}"
        );
    }
}

#[test]
fn failures_of_frames_reach_the_caller_and_release_everything() {
    for settings in apart() {
        let Some(backend) = opened::<f64, Single<f64>>(&settings) else { return };
        let (template, problem) = pieces();
        let mut failed = 0;
        let prepare = || backend.prepare_transfer(&problem, &PrepareOptions::columns(4), &mut |_| {});
        for allowed in (0..110).step_by(3) {
            backend.device.faults.fail_allocations_after(allowed);
            let frames = prepare();
            backend.device.faults.fail_allocations_after(-1);
            failed += u32::from(frames.is_err());
            drop(frames);
            assert_eq!(backend.device.used(), 0, "{allowed} allocations succeeded");
        }
        assert!((5..37).contains(&failed), "{failed} of 37 failed");

        let mut frames = prepare().expect("definite").expect("on the device");
        let mut frame = |pose: &[Vector]| {
            let mut target = vec![[0.0; 3]; problem.target().positions().len()];
            frames.frame(pose, &mut target).map(|_| target)
        };
        let pose = &poses(&template)[1];
        let expected = frame(pose).expect("solvable");
        let mut bad = pose.clone();
        bad[template.triangles()[0][1] as usize][2] = f64::NAN;
        assert!(matches!(frame(&bad), Err(SolveError::NonFinite { .. })));
        let far = vec![[1.7e308; 3]; pose.len()]; // finite, but the sum of three corners is not
        assert!(matches!(frame(&far), Err(SolveError::NonFinite { .. })), "overflows");
        assert_eq!(frame(pose).as_ref(), Ok(&expected), "nothing of it is left");
        backend.device.faults.lose_device_after(0);
        assert!(matches!(frame(pose), Err(SolveError::DeviceLost { .. })));
        backend.device.faults.lose_device_after(-1);
    }
}
