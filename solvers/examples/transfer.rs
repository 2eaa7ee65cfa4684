//! Video-driven animation in one page: a coarse tube bends, and a tube of other proportions with 60 times the triangles
//! bends with it.
//!
//! `cargo run --release -p lapsolve --example transfer`

use lapsolve::backend::TransferFrame;
use lapsolve::mesh::TriangleMesh;
use lapsolve::registry::{self, OpenOptions};
use lapsolve::workload::transfer::Transfer;
use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    let (template, target) = (tube(41, 12, 0.6)?, tube(401, 72, 0.9)?);
    // Triangles at the same place of both: two on opposite sides of every ring.
    let pairs: Vec<(u32, u32)> = (0..40)
        .flat_map(|ring| [0, 6].map(|i| (2 * (12 * ring + i), 2 * (72 * 10 * ring + 6 * i))))
        .collect();
    let backend = (registry::find("framechol-f64").ok_or("not built in")?.open)(&OpenOptions::default())?;
    let mut transfer = Transfer::new(&*backend, &template, target.clone(), &pairs)?; // once

    let mut moved = target.positions().to_vec();
    for degrees in [0.0, 30.0, 60.0, 90.0] {
        let pose: Vec<[f64; 3]> = template.positions().iter().map(|&p| bend(p, degrees)).collect();
        transfer.frame(&pose, &mut moved)?; // every frame
        let expected = target.positions().iter().map(|&p| bend(p, degrees));
        let off = moved.iter().zip(expected).map(|(a, b)| (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>());
        println!("bent by {degrees:>2} degrees: {:.3} from the ideal bend", off.fold(0.0, f64::max).sqrt());
    }
    Ok(())
}

/// A tube of length 10 along x: `rings` rings of `around` vertices.
fn tube(rings: u32, around: u32, radius: f64) -> Result<TriangleMesh, lapsolve::mesh::MeshError> {
    let point = |v: u32| {
        let angle = f64::from(v % around) * std::f64::consts::TAU / f64::from(around);
        let along = 10.0 * f64::from(v / around) / f64::from(rings - 1);
        [along, radius * angle.cos(), radius * angle.sin()]
    };
    let at = |ring: u32, i: u32| ring * around + i % around;
    let cell = |c: u32| {
        let (ring, i) = (c / around, c % around);
        let [a, b, c, d] = [at(ring, i), at(ring, i + 1), at(ring + 1, i), at(ring + 1, i + 1)];
        [[a, b, c], [b, d, c]]
    };
    let cells = 0..(rings - 1) * around;
    TriangleMesh::new((0..rings * around).map(point).collect(), cells.flat_map(cell).collect())
}

/// Bends the x axis into an arc of so many degrees, towards +y.
fn bend([x, y, z]: [f64; 3], degrees: f64) -> [f64; 3] {
    let curvature = degrees.to_radians() / 10.0;
    if curvature == 0.0 {
        return [x, y, z];
    }
    let (radius, (sin, cos)) = (1.0 / curvature, (curvature * x).sin_cos());
    [(radius - y) * sin, radius - (radius - y) * cos, z]
}
