//! Video-driven animation in one page: a template body walks, its motion moves a male and a female body.
//!
//! `cargo run --release -p lapbench --example walk -- walk.png` writes a contact sheet: the template above, the two
//! targets below it, eight poses of the cycle.

use lapbench::body::{Body, Build, correspondences, walk};
use lapbench::render::{Camera, Image, Style, Up, View, contact_sheet, draw};
use lapsolve::backend::TransferFrame;
use lapsolve::laplacian::Weights;
use lapsolve::mesh::TriangleMesh;
use lapsolve::registry::{self, OpenOptions};
use lapsolve::workload::transfer::{Transfer, TransferProblem};
use std::error::Error;
use std::path::PathBuf;

const FRAMES: usize = 156;
const PICTURES: usize = 8;
const MARKS: usize = 64;

fn main() -> Result<(), Box<dyn Error>> {
    let out = PathBuf::from(std::env::args().nth(1).unwrap_or("walk.png".into()));
    let template = Body::new(Build::Template, 20_000);
    let cycle = walk(&template, FRAMES);
    let poses: Vec<_> = (0..PICTURES).map(|i| cycle.positions(i * FRAMES / PICTURES)).collect();
    let backend = registry::find("framechol-f64").ok_or("not built in")?;
    let backend = (backend.open)(&OpenOptions::default())?;

    let mut pictures = row(&template.mesh, &poses)?;
    for build in [Build::Male, Build::Female] {
        let target = Body::new(build, 50_000);
        let marks: Vec<_> =
            correspondences(&template, &target, MARKS).into_iter().map(|[p, t]| (p, t)).collect();
        let problem = TransferProblem::new(&template.mesh, target.mesh.clone(), &marks, Weights::Plain)?;
        let mut transfer = Transfer::prepare(&*backend, &problem, &mut |_| {})?;
        let mut moved = vec![[0.0; 3]; target.mesh.positions().len()];
        let mut frames = Vec::new();
        for pose in &poses {
            transfer.frame(pose, &mut moved)?;
            frames.push(moved.clone());
        }
        pictures.extend(row(&target.mesh, &frames)?);
    }
    contact_sheet(&pictures, PICTURES, 4, [255; 3]).ok_or("too large a sheet")?.write_png(&out)?;
    println!("wrote {}", out.display());
    Ok(())
}

/// One picture per pose, all through the camera that frames the reference pose.
fn row(mesh: &TriangleMesh, poses: &[Vec<[f64; 3]>]) -> Result<Vec<Image>, Box<dyn Error>> {
    let camera = Camera::framing(mesh, View::ThreeQuarter, Up::Y);
    let style = Style { size: (150, 230), ..Style::default() };
    poses.iter().map(|pose| Ok(draw(&mesh.with_positions(pose.clone())?, &style, &camera))).collect()
}
