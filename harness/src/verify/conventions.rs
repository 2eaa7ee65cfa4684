//! What other programs define differently, written with our own parts: the pipelines that their answers are held to.

use lapsolve::laplacian::{Laplacian, Weights};
use lapsolve::mass::Mass;
use lapsolve::mesh::TriangleMesh;
use lapsolve::sparse::SymmetricCsr;
use lapsolve::workload::geodesic::GeodesicProblem;
use std::collections::HashMap;

/// The Laplacian by which a program deforms. We: negative weights count as zero, so that no rotation is fitted backwards. libigl:
/// plain weights. Open3D: as we do, but it divides the sum of cotangents at a boundary edge by one instead of two.
///
/// # Errors
/// A name that is not known.
pub fn arap_laplacian(mesh: &TriangleMesh, convention: Option<&str>) -> Result<SymmetricCsr, String> {
    match convention {
        None => Ok(Laplacian::assemble(mesh, Weights::ClampedPerEdge).into_matrix()),
        Some("libigl") => Ok(Laplacian::assemble(mesh, Weights::Plain).into_matrix()),
        Some("open3d") => Ok(open3d_laplacian(mesh)),
        Some(other) => Err(format!("no convention of `arap` is called {other}")),
    }
}

/// Distances as a program defines them. We: thirds of triangles as masses, the second system grounded. libigl: Voronoi areas.
/// geometry-central (potpourri3d): our masses, 1e-6 added to the diagonal of the second system.
///
/// # Errors
/// A name that is not known, or a mesh that is not acceptable.
pub fn geodesic(mesh: &TriangleMesh, convention: Option<&str>) -> Result<GeodesicProblem, String> {
    let new = |mass| GeodesicProblem::new(mesh, mass).map_err(|error| error.to_string());
    match convention {
        None => new(Mass::Barycentric),
        Some("libigl") => new(Mass::Voronoi),
        Some("geometry-central") => Ok(new(Mass::Barycentric)?.shifted(1e-6)),
        Some(other) => Err(format!("no convention of `geodesic` is called {other}")),
    }
}

fn open3d_laplacian(mesh: &TriangleMesh) -> SymmetricCsr {
    let plain = Laplacian::assemble(mesh, Weights::ClampedPerEdge).into_matrix();
    let mut triangles_at: HashMap<(u32, u32), u32> = HashMap::new();
    for (t, &[a, b, c]) in mesh.triangles().iter().enumerate() {
        if !mesh.is_zero_area(t) {
            for (i, j) in [(a, b), (b, c), (c, a)] {
                *triangles_at.entry((i.min(j), i.max(j))).or_default() += 1;
            }
        }
    }
    let mut triplets = Vec::with_capacity(plain.stored());
    let mut diagonal = vec![0.0; plain.n()];
    for i in 0..plain.n() {
        for (&j, &value) in plain.row(i).0.iter().zip(plain.row(i).1).skip(1) {
            let boundary = triangles_at.get(&(i as u32, j)) == Some(&1);
            let value = if boundary { 2.0 * value } else { value };
            triplets.push((i as u32, j, value));
            diagonal[i] -= value;
            diagonal[j as usize] -= value;
        }
    }
    triplets.extend((0..plain.n() as u32).map(|i| (i, i, diagonal[i as usize])));
    SymmetricCsr::from_triplets(plain.n(), &triplets).expect("the pattern of a Laplacian")
}
