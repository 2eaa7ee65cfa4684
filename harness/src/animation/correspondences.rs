//! Pairs of corresponding triangles: read, taken from what is known of two meshes, or proposed.

use crate::mesh_io::table;
use crate::vector::{area_normal, normalize};
use lapsolve::mesh::TriangleMesh;
use lapsolve::rotation::rotate;
use lapsolve::vector::{Vector, add, distance_squared, dot, scale, sub};
use lapsolve::workload::sampling::farthest_points;
use lapsolve::workload::transfer::alignment::Similarity;
use rayon::prelude::*;
use std::path::Path;

/// A triangle of the template and one of the target.
pub type Pair = (u32, u32);

/// Reads pairs of vertices and gives each the pair of triangles at them whose shapes show the same side: the first triangle
/// with an area at the template's vertex, and the triangle at the target's vertex whose normal agrees best with it.
///
/// # Errors
/// A line that is malformed or out of range, or a vertex on no triangle with an area.
pub fn read_vertex_pairs(
    path: &Path,
    template: &TriangleMesh,
    target: &TriangleMesh,
) -> anyhow::Result<Vec<Pair>> {
    let limits = [template.positions().len(), target.positions().len()];
    let pairs = table::read_pairs(path, limits)?;
    let (from, to) = (around(template), around(target));
    let missing = |side: &str, v: u32| {
        anyhow::anyhow!("{}: {side} vertex {v} is on no triangle with an area", path.display())
    };
    pairs
        .into_iter()
        .map(|[a, b]| {
            let &p = from[a as usize].first().ok_or_else(|| missing("template", a))?;
            let normal = unit_normal(template, p);
            let agreement = |&t: &u32| dot(unit_normal(target, t), normal);
            let best = to[b as usize].iter().copied().max_by(|x, y| agreement(x).total_cmp(&agreement(y)));
            Ok((p, best.ok_or_else(|| missing("target", b))?))
        })
        .collect()
}

/// The triangles with an area at every vertex.
fn around(mesh: &TriangleMesh) -> Vec<Vec<u32>> {
    let mut around = vec![Vec::new(); mesh.positions().len()];
    for (t, triangle) in mesh.triangles().iter().enumerate().filter(|&(t, _)| !mesh.is_zero_area(t)) {
        triangle.iter().for_each(|&v| around[v as usize].push(t as u32));
    }
    around
}

fn unit_normal(mesh: &TriangleMesh, t: u32) -> Vector {
    let [a, b, c] = mesh.corners(t as usize);
    normalize(area_normal(a, b, c))
}

/// Pairs that were proposed, and how well they fit.
#[derive(Clone, Debug, PartialEq)]
pub struct Proposal {
    /// The pairs, spread over the target.
    pub pairs: Vec<Pair>,
    /// Mean distance of paired centroids after alignment, in diagonals of the target.
    pub distance: f64,
}

/// Least cosine of the angle between the normals of a pair.
const AGREEING: f64 = 0.7;
/// Largest distance of the centroids of a pair after alignment, in diagonals of the target.
const NEAR: f64 = 0.08;
/// Rounds of pairing and aligning.
const ROUNDS: usize = 6;

/// Proposes up to `count` pairs for shapes that are roughly aligned and posed alike: farthest-point samples of the target's
/// triangles, each with the nearest triangle of the template whose normal agrees, after a similarity that begins with the
/// boxes of both and is fitted to the pairs a few times. Samples without a near partner are left out.
pub fn propose(template: &TriangleMesh, target: &TriangleMesh, count: usize) -> Proposal {
    let usable = |mesh: &TriangleMesh| -> Vec<u32> {
        (0..mesh.triangles().len() as u32).filter(|&t| !mesh.is_zero_area(t as usize)).collect()
    };
    let (from, to) = (usable(template), usable(target));
    let faces = |mesh: &TriangleMesh, which: &[u32]| -> Vec<(Vector, Vector)> {
        which.par_iter().map(|&t| (middle(mesh, t), unit_normal(mesh, t))).collect()
    };
    let places: Vec<Vector> = to.iter().map(|&t| middle(target, t)).collect();
    let samples: Vec<u32> = farthest_points(&places, count).into_iter().map(|i| to[i as usize]).collect();
    let (from_faces, to_faces) = (faces(template, &from), faces(target, &samples));
    let diagonal = target.diagonal();
    let mut alignment = by_boxes(template, target);
    let mut found = Vec::new();
    for round in 0..=ROUNDS {
        // Wide at first, because boxes align only roughly.
        let reach = NEAR * diagonal * if round < ROUNDS { 2.0 } else { 1.0 };
        let moved: Vec<(Vector, Vector)> = from_faces
            .par_iter()
            .map(|&(x, n)| (alignment.apply(x), rotate(alignment.rotation, n)))
            .collect();
        found = partners(&moved, &to_faces, reach);
        if round == ROUNDS || found.len() < 3 {
            break;
        }
        let points: Vec<(Vector, Vector)> =
            found.iter().map(|&(i, s, _)| (from_faces[i].0, to_faces[s].0)).collect();
        alignment = Similarity::between(&points);
    }
    let distance = found.iter().map(|f| f.2).sum::<f64>() / found.len().max(1) as f64 / diagonal;
    Proposal { pairs: found.iter().map(|&(i, s, _)| (from[i], samples[s])).collect(), distance }
}

/// For every sample the nearest face with an agreeing normal within `reach`: (face, sample, distance).
fn partners(
    faces: &[(Vector, Vector)],
    samples: &[(Vector, Vector)],
    reach: f64,
) -> Vec<(usize, usize, f64)> {
    let nearest = |(s, &(x, n)): (usize, &(Vector, Vector))| {
        let mut best = (usize::MAX, reach * reach);
        for (i, &(y, m)) in faces.iter().enumerate() {
            let squared = distance_squared(x, y);
            if squared < best.1 && dot(n, m) >= AGREEING {
                best = (i, squared);
            }
        }
        (best.0 != usize::MAX).then(|| (best.0, s, best.1.sqrt()))
    };
    samples.par_iter().enumerate().filter_map(nearest).collect()
}

/// Lays the box of the template over that of the target: centres together, diagonals of equal length.
fn by_boxes(template: &TriangleMesh, target: &TriangleMesh) -> Similarity {
    let centre = |mesh: &TriangleMesh| {
        let (low, high) = mesh.bounding_box();
        add(scale(0.5, low), scale(0.5, high))
    };
    let ratio = target.diagonal() / template.diagonal();
    let size = if ratio.is_finite() && ratio > 0.0 { ratio } else { 1.0 };
    Similarity {
        rotation: lapsolve::rotation::IDENTITY,
        scale: size,
        translation: sub(centre(target), scale(size, centre(template))),
    }
}

fn middle(mesh: &TriangleMesh, t: u32) -> Vector {
    let [a, b, c] = mesh.corners(t as usize);
    scale(1.0 / 3.0, add(add(a, b), c))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::{Body, Build};

    #[test]
    fn proposals_for_two_builds_lie_at_the_same_place_of_both() {
        let (template, target) =
            (Body::new(Build::Template, 4_000).mesh, Body::new(Build::Female, 6_000).mesh);
        let proposal = propose(&template, &target, 80);
        assert!(proposal.pairs.len() > 60, "{}", proposal.pairs.len());
        assert!(proposal.distance < 0.02, "{}", proposal.distance);
        for &(p, t) in &proposal.pairs {
            let [p, t] = [(&template, p), (&target, t)]
                .map(|(mesh, t)| scale(1.0 / mesh.bounding_box().1[1], middle(mesh, t)));
            assert!(distance_squared(p, t).sqrt() < 0.09, "{p:?} {t:?}");
        }
    }

    #[test]
    fn vertex_pairs_become_triangles_at_them() {
        let mesh = crate::mesh_source::load("sphere:1").unwrap().mesh;
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("pairs.txt");
        std::fs::write(&path, "2\n0 5\n3, 0\n").unwrap();
        let pairs = read_vertex_pairs(&path, &mesh, &mesh).unwrap();
        for ((p, t), [a, b]) in pairs.into_iter().zip([[0, 5], [3, 0]]) {
            assert!(mesh.triangles()[p as usize].contains(&a) && mesh.triangles()[t as usize].contains(&b));
        }
        std::fs::write(&path, "0 99\n").unwrap();
        assert!(read_vertex_pairs(&path, &mesh, &mesh).unwrap_err().to_string().contains("line 1"));
    }
}
