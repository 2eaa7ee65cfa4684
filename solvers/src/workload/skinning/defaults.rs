//! The bones of a mesh that comes alone.

use super::Bone;
use crate::mesh::TriangleMesh;
use crate::vector::{Vector, distance_squared};
use crate::workload::sampling::farthest_points;

/// Bones where nothing else is known: the middle of the 18 to 40 that animated characters have, less the fingers.
pub const BONES: usize = 22;

/// [`BONES`] segments (fewer on meshes with fewer vertices) inside of the mesh: the vertices that triangles use are divided
/// among [`BONES`] + 1 farthest points, each vertex going to the nearest one; the means of these regions lie within limbs
/// rather than on the surface, and the edges of their minimum spanning tree are the bones. A single point is one bone.
///
/// Depends on the mesh alone: ties go to the lowest index. Cost: [`BONES`] distances per vertex, twice.
pub fn default_bones(mesh: &TriangleMesh) -> Vec<Bone> {
    let mut used = vec![false; mesh.positions().len()];
    mesh.triangles().as_flattened().iter().for_each(|&v| used[v as usize] = true);
    let points: Vec<Vector> =
        mesh.positions().iter().zip(&used).filter(|&(_, &used)| used).map(|(&p, _)| p).collect();
    let centres = centres(&points, &farthest_points(&points, BONES + 1));
    match centres[..] {
        [] => Vec::new(),
        [single] => vec![Bone::segment(single, single)],
        _ => {
            spanning_tree(&centres).into_iter().map(|[a, b]| Bone::segment(centres[a], centres[b])).collect()
        }
    }
}

/// Mean of the points nearest to each of `seeds`.
fn centres(points: &[Vector], seeds: &[u32]) -> Vec<Vector> {
    let mut sums = vec![([0.0; 3], 0.0); seeds.len()];
    for &p in points {
        let distance = |s: usize| distance_squared(p, points[seeds[s] as usize]);
        let nearest = (1..seeds.len()).fold(0, |best, s| if distance(s) < distance(best) { s } else { best });
        let (sum, count) = &mut sums[nearest];
        (0..3).for_each(|i| sum[i] += p[i]);
        *count += 1.0;
    }
    // Every seed is nearest to itself unless it coincides with an earlier one.
    sums.into_iter().filter(|&(_, count)| count > 0.0).map(|(sum, count)| sum.map(|x| x / count)).collect()
}

/// Edges of the minimum spanning tree (Prim 1957), from point 0 on.
fn spanning_tree(points: &[Vector]) -> Vec<[usize; 2]> {
    let mut best: Vec<(f64, usize)> = points.iter().map(|&p| (distance_squared(p, points[0]), 0)).collect();
    let mut outside: Vec<usize> = (1..points.len()).collect();
    let mut edges = Vec::new();
    while let Some(at) =
        (0..outside.len()).reduce(|a, b| if best[outside[b]].0 < best[outside[a]].0 { b } else { a })
    {
        let joined = outside.remove(at);
        edges.push([best[joined].1, joined]);
        for &p in &outside {
            let distance = distance_squared(points[p], points[joined]);
            if distance < best[p].0 {
                best[p] = (distance, joined);
            }
        }
    }
    edges
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_tree_spans_and_is_shortest() {
        let points = [[0.0; 3], [3.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [9.0, 0.0, 0.0]];
        assert_eq!(spanning_tree(&points), [[0, 2], [2, 3], [2, 1], [1, 4]]);
    }

    #[test]
    fn a_tube_has_bones_along_its_middle() {
        let (rings, around) = (200_u32, 12_u32);
        let positions = (0..rings * around)
            .map(|v| {
                let angle = f64::from(v % around) * std::f64::consts::TAU / f64::from(around);
                [0.2 * f64::from(v / around), angle.cos(), angle.sin()]
            })
            .collect();
        let at = |r: u32, c: u32| r * around + c % around;
        let triangles = (0..rings - 1)
            .flat_map(|r| (0..around).map(move |c| (r, c)))
            .flat_map(|(r, c)| {
                [[at(r, c), at(r, c + 1), at(r + 1, c)], [at(r + 1, c), at(r, c + 1), at(r + 1, c + 1)]]
            })
            .collect();
        let mesh = TriangleMesh::new(positions, triangles).expect("valid");
        let bones = default_bones(&mesh);
        assert_eq!(bones.len(), BONES);
        for bone in &bones {
            for [_, y, z] in bone.segments[0] {
                assert!(y.hypot(z) < 0.7, "inside of a tube of radius 1: {y} {z}");
            }
        }
    }

    #[test]
    fn few_vertices_have_few_bones() {
        let mesh =
            TriangleMesh::new(vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [50.0; 3]], vec![[0, 1, 2]])
                .expect("valid");
        assert_eq!(default_bones(&mesh).len(), 2);
        let point = TriangleMesh::new(vec![[2.0; 3]], vec![[0, 0, 0]]).expect("valid");
        assert_eq!(default_bones(&point), [Bone::segment([2.0; 3], [2.0; 3])]);
    }
}
