//! What bone weights, distances and a deformation by handles look like on a generated human.
//!
//! `cargo run --release -p lapbench --example workloads -- workloads.png` writes three pictures side by side: the weight of the
//! left forearm, rings of equal distance from the fingertips of the left hand, and the body with that hand pulled up.

use lapbench::body::{Body, Build};
use lapbench::render::{Camera, Colouring, Image, Style, Up, View, contact_sheet, draw};
use lapsolve::backend::Backend;
use lapsolve::laplacian::Weights;
use lapsolve::mass::Mass;
use lapsolve::registry::{self, OpenOptions};
use lapsolve::vector::{Vector, add, distance_squared};
use lapsolve::workload::arap::{Arap, ArapProblem};
use lapsolve::workload::geodesic::{Geodesic, GeodesicProblem};
use lapsolve::workload::skinning::{Bone, HEAT, SkinningProblem};
use std::error::Error;
use std::path::PathBuf;

/// Metres between two rings of equal distance.
const RING: f64 = 0.08;

/// Where the left hand is pulled, metres.
const PULL: Vector = [0.1, 0.55, 0.15];

fn main() -> Result<(), Box<dyn Error>> {
    let out = PathBuf::from(std::env::args().nth(1).unwrap_or("workloads.png".into()));
    let body = Body::new(Build::Female, 60_000);
    let backend = (registry::find("framechol-f64").ok_or("not built in")?.open)(&OpenOptions::default())?;
    let (weights, distances) = (forearm_weights(&body, &*backend)?, distances(&body, &*backend)?);
    let rings: Vec<f64> = distances.iter().map(|d| (std::f64::consts::TAU * d / RING).sin()).collect();
    let (handles, moved) = pulled(&body, &*backend)?;

    let camera = Camera::framing(&body.mesh, View::Front, Up::Y);
    let picture = |colouring, marked: &[u32], positions: &[Vector]| -> Result<Image, Box<dyn Error>> {
        let style = Style { size: (300, 460), colouring, marked_vertices: marked, ..Style::default() };
        Ok(draw(&body.mesh.with_positions(positions.to_vec())?, &style, &camera))
    };
    let rest = body.mesh.positions();
    let pictures = [
        picture(Colouring::Scalar { values: &weights, range: Some((0.0, 1.0)) }, &[], rest)?,
        picture(Colouring::Scalar { values: &rings, range: None }, &[], rest)?,
        picture(Style::default().colouring, &handles, &moved)?,
    ];
    contact_sheet(&pictures, 3, 4, [255; 3]).ok_or("too large a sheet")?.write_png(&out)?;
    println!("wrote {}", out.display());
    Ok(())
}

/// The weight of the left forearm at every vertex.
fn forearm_weights(body: &Body, backend: &dyn Backend) -> Result<Vec<f64>, Box<dyn Error>> {
    let bones: Vec<Bone> = body.skeleton.bones.iter().map(|b| Bone::segment(b.head, b.tail)).collect();
    let forearm = body.skeleton.find("left_forearm").ok_or("a body has forearms")?;
    let weights = SkinningProblem::new(&body.mesh, &bones, HEAT)?.weights(backend)?;
    Ok(weights.chunks_exact(bones.len()).map(|row| row[forearm]).collect())
}

/// Distances along the surface from the tip of the left hand, metres.
fn distances(body: &Body, backend: &dyn Backend) -> Result<Vec<f64>, Box<dyn Error>> {
    let problem = GeodesicProblem::new(&body.mesh, Mass::Barycentric)?;
    let mut geodesic = Geodesic::prepare(backend, &problem, &mut |_| {})?;
    let mut distances = vec![0.0; body.mesh.positions().len()];
    geodesic.solve(&[end_of(body, "left_hand")], &mut distances)?;
    Ok(distances)
}

/// Hands, feet and head as handles, the left hand pulled away: the handles, and all positions.
fn pulled(body: &Body, backend: &dyn Backend) -> Result<(Vec<u32>, Vec<Vector>), Box<dyn Error>> {
    let hand = near_end(body, "left_hand");
    let others = ["right_hand", "left_foot", "right_foot", "head"].map(|name| near_end(body, name));
    let handles: Vec<u32> = others.into_iter().flatten().chain(hand.iter().copied()).collect();
    let problem = ArapProblem::new(&body.mesh, &handles, Weights::ClampedPerEdge)?;
    let mut arap = Arap::prepare(backend, &problem, &mut |_| {})?;
    let rest = body.mesh.positions();
    let target = |v: &u32| if hand.contains(v) { add(rest[*v as usize], PULL) } else { rest[*v as usize] };
    let targets: Vec<Vector> = problem.handles().iter().map(target).collect();
    let mut moved = rest.to_vec();
    arap.solve(&targets, 2000, &mut moved)?;
    Ok((handles, moved))
}

fn distance_to_end(body: &Body, bone: &str, vertex: u32) -> f64 {
    let tail = body.skeleton.find(bone).map_or([0.0; 3], |b| body.skeleton.bones[b].tail);
    distance_squared(body.mesh.positions()[vertex as usize], tail).sqrt()
}

/// The vertices within 6 cm of the far end of a bone.
fn near_end(body: &Body, bone: &str) -> Vec<u32> {
    (0..body.mesh.positions().len() as u32).filter(|&v| distance_to_end(body, bone, v) < 0.06).collect()
}

/// The vertex nearest to the far end of a bone.
fn end_of(body: &Body, bone: &str) -> u32 {
    let distance = |v: &u32| distance_to_end(body, bone, *v);
    (0..body.mesh.positions().len() as u32).min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap_or(0)
}
