//! Deforms a cylinder by two handles: one end stays, the other is bent up. `cargo run --release -p lapsolve --example arap`
use lapsolve::laplacian::Weights;
use lapsolve::mesh::TriangleMesh;
use lapsolve::registry::{self, OpenOptions};
use lapsolve::vector::distance_squared;
use lapsolve::workload::arap::{Arap, ArapProblem};
use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    let mesh = cylinder(60, 24)?;
    let handles: Vec<u32> =
        (0..mesh.positions().len() as u32).filter(|v| v / 24 == 0 || v / 24 == 60).collect();
    let backend = (registry::find("framechol-f64").ok_or("built in")?.open)(&OpenOptions::default())?;
    let problem = ArapProblem::new(&mesh, &handles, Weights::ClampedPerEdge)?;
    let mut arap = Arap::prepare(&*backend, &problem, &mut |_| {})?; // factors once

    // Every frame: new places for the handles, here the far end turned up by 90 degrees.
    let bend = |[x, y, z]: [f64; 3]| if x > 3.0 { [4.0 - y, x - 2.0, z] } else { [x, y, z] };
    let targets: Vec<_> = problem.handles().iter().map(|&v| bend(mesh.positions()[v as usize])).collect();
    let mut positions = mesh.positions().to_vec();
    arap.solve(&targets, 200, &mut positions)?;

    let strain = mean_strain(&mesh, &positions);
    println!("energy {:.4}, edges change by {:.1} % on average", arap.energy(), 100.0 * strain);
    assert!(strain < 0.1, "as rigid as possible");
    Ok(())
}

/// A tube of radius 0.5 and length 6 along x, open at its ends.
fn cylinder(rings: u32, around: u32) -> Result<TriangleMesh, Box<dyn Error>> {
    let point = |v: u32| {
        let angle = f64::from(v % around) * std::f64::consts::TAU / f64::from(around);
        [6.0 * f64::from(v / around) / f64::from(rings), 0.5 * angle.cos(), 0.5 * angle.sin()]
    };
    let at = |r: u32, c: u32| r * around + c % around;
    let squares = (0..rings).flat_map(|r| (0..around).map(move |c| (r, c)));
    let triangles = squares.flat_map(|(r, c)| {
        [[at(r, c), at(r, c + 1), at(r + 1, c)], [at(r + 1, c), at(r, c + 1), at(r + 1, c + 1)]]
    });
    Ok(TriangleMesh::new((0..(rings + 1) * around).map(point).collect(), triangles.collect())?)
}

/// Mean relative change of the edges' lengths.
fn mean_strain(mesh: &TriangleMesh, positions: &[[f64; 3]]) -> f64 {
    let edges: Vec<[u32; 2]> =
        mesh.triangles().iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]).collect();
    let length = |x: &[[f64; 3]], [a, b]: [u32; 2]| distance_squared(x[a as usize], x[b as usize]).sqrt();
    let strain = |&edge: &[u32; 2]| (length(positions, edge) / length(mesh.positions(), edge) - 1.0).abs();
    edges.iter().map(strain).sum::<f64>() / edges.len() as f64
}

#[test]
fn runs() {
    main().expect("the example");
}
