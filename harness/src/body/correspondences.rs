//! Triangles of two builds that lie at the same place of the anatomy.

use super::Body;
use super::surface::Surface;
use crate::vector::{Vector, add, area_normal, dot, normalize, scale, sub};
use lapsolve::mesh::TriangleMesh;
use rayon::prelude::*;

/// Up to `count` pairs (triangle of `template`, triangle of `target`), spread over the body by farthest-point sampling
/// of the template's triangles, first the one nearest to the crown.
///
/// Each template triangle has a place in the part of the body it belongs to: along its axis, and across it in units of
/// the radii. The same place in the target's part, brought onto the target's surface, gives the target's triangle.
/// Pairs whose target triangle is taken are left out, so fewer than `count` may come back (on coarse meshes only).
pub fn correspondences(template: &Body, target: &Body, count: usize) -> Vec<[u32; 2]> {
    let (centroids, _) = centres(&template.mesh);
    let (target_centroids, target_normals) = centres(&target.mesh);
    let chosen = spread(&centroids, count);
    let found: Vec<u32> = chosen
        .par_iter()
        .map(|&t| {
            let place = same_place(&template.surface, &target.surface, centroids[t as usize]);
            nearest(&target_centroids, &target_normals, place, target.surface.normal(place))
        })
        .collect();
    let mut taken = vec![false; target_centroids.len()];
    let pairs = chosen.into_iter().zip(found).map(|(t, u)| [t, u]);
    pairs.filter(|&[_, u]| !std::mem::replace(&mut taken[u as usize], true)).collect()
}

/// Centroid and unit normal of every triangle.
fn centres(mesh: &TriangleMesh) -> (Vec<Vector>, Vec<Vector>) {
    let corners = |t: &[u32; 3]| t.map(|v| mesh.positions()[v as usize]);
    let centroid = |[a, b, c]: [Vector; 3]| scale(1.0 / 3.0, add(add(a, b), c));
    let normal = |[a, b, c]: [Vector; 3]| normalize(area_normal(a, b, c));
    mesh.triangles().iter().map(|t| (centroid(corners(t)), normal(corners(t)))).unzip()
}

/// Farthest-point sampling: each next point is the one with the largest distance to those chosen so far; ties go to
/// the lowest index.
fn spread(points: &[Vector], count: usize) -> Vec<u32> {
    let farthest = |distances: &[f64]| {
        let pick = |best: usize, i: usize| if distances[i] > distances[best] { i } else { best };
        (0..distances.len()).fold(0, pick)
    };
    let heights: Vec<f64> = points.iter().map(|p| p[1]).collect();
    let mut distances = vec![f64::INFINITY; points.len()];
    let mut chosen = vec![farthest(&heights) as u32];
    while chosen.len() < count.min(points.len()) {
        let last = points[chosen[chosen.len() - 1] as usize];
        distances.par_iter_mut().zip(points).for_each(|(d, &p)| {
            let offset = sub(p, last);
            *d = d.min(dot(offset, offset));
        });
        chosen.push(farthest(&distances) as u32);
    }
    chosen.truncate(count);
    chosen
}

/// The point on the target's surface at the anatomical place of p.
fn same_place(template: &Surface, target: &Surface, p: Vector) -> Vector {
    const STEPS: usize = 20; // Newton steps; a few suffice, the rest do nothing
    let part = template.owner(p).expect("a point on the surface belongs to a part");
    let place = template.parts[part].loft.anatomical(p);
    target.project(target.parts[part].loft.place(place), STEPS, 0.02)
}

/// The triangle with the nearest centroid among those whose normal agrees to within 60 degrees; ties go to the lowest
/// index.
fn nearest(centroids: &[Vector], normals: &[Vector], p: Vector, normal: Vector) -> u32 {
    let distance = |i: usize| {
        let offset = sub(centroids[i], p);
        let penalty = if dot(normals[i], normal) < 0.5 { 1.0 } else { 0.0 }; // square metres: never the nearest
        dot(offset, offset) + penalty
    };
    let best = (0..centroids.len()).map(|i| (distance(i), i)).min_by(|a, b| a.0.total_cmp(&b.0));
    best.expect("a mesh has triangles").1 as u32
}

#[cfg(test)]
mod tests {
    use super::super::Build;
    use super::*;

    #[test]
    fn pairs_are_distinct_and_name_the_same_place_of_both_bodies() {
        let template = Body::new(Build::Template, 30_000);
        for build in [Build::Male, Build::Female] {
            let target = Body::new(build, 50_000);
            let pairs = correspondences(&template, &target, 200);
            assert_eq!(pairs.len(), 200, "{build:?}");
            let [mut from, mut to] = [0, 1].map(|k| pairs.iter().map(|p| p[k]).collect::<Vec<_>>());
            for list in [&mut from, &mut to] {
                list.sort_unstable();
                list.dedup();
                assert_eq!(list.len(), 200, "{build:?}");
            }
            let places = |body: &Body| {
                let stature = body.mesh.bounding_box().1[1];
                centres(&body.mesh).0.into_iter().map(|c| scale(1.0 / stature, c)).collect::<Vec<_>>()
            };
            let (from, to) = (places(&template), places(&target));
            for [t, u] in pairs {
                let apart = sub(from[t as usize], to[u as usize]);
                // Builds differ in breadth and in the reach of the arms by a few per cent of the stature.
                assert!(dot(apart, apart).sqrt() < 0.05, "{build:?} {t} {u}: {apart:?}");
            }
        }
    }
}
