//! Skins a tube to a skeleton of two bones and bends its elbow. `cargo run --release -p lapsolve --example skinning`
use lapsolve::columns::Columns;
use lapsolve::mesh::TriangleMesh;
use lapsolve::registry::{self, OpenOptions};
use lapsolve::rigid::Rigid;
use lapsolve::rotation::about_axis;
use lapsolve::workload::skinning::{HEAT, Joint, Skeleton, Skin, SkinningProblem};
use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    let mesh = tube(60, 24)?;
    let joint = |name: &str, parent, offset, tip| {
        let rest = Rigid::translation(offset);
        Joint { name: name.to_owned(), parent, rest, tip }
    };
    let skeleton = Skeleton::new(vec![
        joint("upper arm", None, [0.0; 3], None),
        joint("forearm", Some(0), [3.0, 0.0, 0.0], Some([3.0, 0.0, 0.0])),
    ])?;
    let backend = (registry::find("framechol-f64").ok_or("built in")?.open)(&OpenOptions::default())?;
    let problem = SkinningProblem::new(&mesh, &skeleton.bones(), HEAT)?;
    let weights = problem.weights(&*backend)?; // n x 2, rows sum to 1
    let weights = Columns::new(&weights[..], mesh.positions().len(), problem.bones());
    let mut skin = Skin::new(mesh.positions(), weights, 4);

    // Every frame: a pose, its motions, the skinned positions.
    let (mut pose, mut motions) = (skeleton.rest(), vec![Rigid::IDENTITY; 2]);
    pose[1].rotation = about_axis(2, std::f64::consts::FRAC_PI_2);
    skeleton.motions(&pose, &mut motions);
    let mut positions = mesh.positions().to_vec();
    skin.pose(&motions, &mut positions);

    let middle_of = |ring: usize| (0..24).map(|c| positions[24 * ring + c][1]).sum::<f64>() / 24.0;
    println!("the wrist is raised to {:.3}, the shoulder stays at {:.3}", middle_of(60), middle_of(0));
    assert!((middle_of(60) - 3.0).abs() < 0.05 && middle_of(0).abs() < 0.05);
    Ok(())
}

/// A tube of radius 0.5 and length 6 along x, open at its ends.
fn tube(rings: u32, around: u32) -> Result<TriangleMesh, Box<dyn Error>> {
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

#[test]
fn runs() {
    main().expect("the example");
}
