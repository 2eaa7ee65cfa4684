//! What a frame does to a surface: its volume and the lengths of its edges.

use lapsolve::mesh::TriangleMesh;
use lapsolve::vector::{Vector, add, cross, distance_squared, dot, scale, sub};
use rayon::prelude::*;

/// A surface at rest, for comparison.
#[derive(Clone, Debug)]
pub struct Rest {
    triangles: Vec<[u32; 3]>,
    /// Each edge once, with its length; edges of length 0 are left out.
    edges: Vec<([u32; 2], f64)>,
    /// Directed edges without a partner, loop by loop.
    holes: Vec<Vec<[u32; 2]>>,
    volume: f64,
    encloses: bool,
}

/// A frame against the surface at rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Figures {
    /// Enclosed volume over that at rest, less 1, with small holes closed by fans; none for open surfaces.
    pub volume_change: Option<f64>,
    /// Smallest, mean and largest length of an edge over that at rest.
    pub stretch: [f64; 3],
    /// Share of the edges that are longer or shorter by more than a fifth.
    pub distorted: f64,
}

/// An edge that is longer or shorter by more than this is counted as distorted.
pub const DISTORTED: f64 = 0.2;

/// Edges and triangles of one parallel piece: some 100 us of work.
const CHUNK: usize = 1 << 15;

impl Rest {
    /// Edges and volume of `mesh`.
    pub fn of(mesh: &TriangleMesh) -> Self {
        let mut edges: Vec<[u32; 2]> = mesh
            .triangles()
            .iter()
            .flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]].map(|[a, b]| [a.min(b), a.max(b)]))
            .collect();
        edges.sort_unstable();
        edges.dedup();
        let length = |[a, b]: [u32; 2]| {
            distance_squared(mesh.positions()[a as usize], mesh.positions()[b as usize]).sqrt()
        };
        let edges: Vec<([u32; 2], f64)> =
            edges.into_iter().map(|e| (e, length(e))).filter(|&(_, l)| l > 0.0).collect();
        let holes = holes(mesh.triangles());
        let open = holes.iter().map(Vec::len).sum::<usize>();
        let volume = volume(mesh.triangles(), &holes, mesh.positions());
        let encloses = open as f64 <= SMALL_HOLES * edges.len() as f64 && volume != 0.0;
        Self { triangles: mesh.triangles().to_vec(), edges, holes, volume, encloses }
    }

    /// Whether the surface encloses a volume.
    pub fn encloses(&self) -> bool {
        self.encloses
    }

    /// Compares a frame. Cost: every triangle and every edge once, on the current rayon pool.
    pub fn compare(&self, positions: &[Vector]) -> Figures {
        let part = |edges: &[([u32; 2], f64)]| {
            let mut sum = (f64::INFINITY, 0.0, f64::NEG_INFINITY, 0usize);
            for &([a, b], length) in edges {
                let ratio = distance_squared(positions[a as usize], positions[b as usize]).sqrt() / length;
                sum.0 = sum.0.min(ratio);
                sum.1 += ratio;
                sum.2 = sum.2.max(ratio);
                sum.3 += usize::from((ratio - 1.0).abs() > DISTORTED);
            }
            sum
        };
        let parts: Vec<_> = self.edges.par_chunks(CHUNK).map(part).collect();
        let total = parts.iter().fold((f64::INFINITY, 0.0, f64::NEG_INFINITY, 0), |a, b| {
            (a.0.min(b.0), a.1 + b.1, a.2.max(b.2), a.3 + b.3)
        });
        let count = self.edges.len().max(1) as f64;
        let change = || volume(&self.triangles, &self.holes, positions) / self.volume - 1.0;
        Figures {
            volume_change: self.encloses.then(change),
            stretch: [total.0, total.1 / count, total.2],
            distorted: total.3 as f64 / count,
        }
    }
}

/// Most edges without a partner, of all, that still count as small holes: scans have them at soles and ears.
const SMALL_HOLES: f64 = 0.01;

/// Directed edges that no triangle uses the other way, as often as they lack a partner, grouped by common vertices.
fn holes(triangles: &[[u32; 3]]) -> Vec<Vec<[u32; 2]>> {
    let mut edges: Vec<([u32; 2], i32)> = triangles
        .iter()
        .flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]])
        .map(|[a, b]| if a < b { ([a, b], 1) } else { ([b, a], -1) })
        .collect();
    edges.sort_unstable();
    let mut open: Vec<[u32; 2]> = Vec::new();
    for group in edges.chunk_by(|a, b| a.0 == b.0) {
        let ([a, b], surplus) = (group[0].0, group.iter().map(|e| e.1).sum::<i32>());
        let edge = if surplus > 0 { [a, b] } else { [b, a] };
        open.extend(std::iter::repeat_n(edge, surplus.unsigned_abs() as usize));
    }
    let mut loops: Vec<Vec<[u32; 2]>> = Vec::new();
    let mut at: std::collections::HashMap<u32, Vec<usize>> = std::collections::HashMap::new();
    for (e, edge) in open.iter().enumerate() {
        edge.iter().for_each(|&v| at.entry(v).or_default().push(e));
    }
    let mut seen = vec![false; open.len()];
    for first in 0..open.len() {
        let (mut pending, mut own) = (vec![first], Vec::new());
        while let Some(e) = pending.pop() {
            if !std::mem::replace(&mut seen[e], true) {
                own.push(open[e]);
                pending.extend(open[e].iter().flat_map(|v| &at[v]));
            }
        }
        if !own.is_empty() {
            loops.push(own);
        }
    }
    loops
}

/// The volume that triangles enclose, each hole closed by a fan about the mean of its edges; about the first vertex, so that
/// places far from the origin lose no digits.
fn volume(triangles: &[[u32; 3]], holes: &[Vec<[u32; 2]>], positions: &[Vector]) -> f64 {
    let origin = positions.first().copied().unwrap_or_default();
    let at = |v: u32| sub(positions[v as usize], origin);
    let cone = |&[a, b, c]: &[u32; 3]| dot(at(a), cross(at(b), at(c))) / 6.0;
    let fan = |hole: &Vec<[u32; 2]>| {
        let sum = hole.iter().fold([0.0; 3], |sum, &[a, _]| add(sum, at(a)));
        let tip = scale(1.0 / hole.len() as f64, sum);
        hole.iter().map(|&[a, b]| dot(tip, cross(at(b), at(a))) / 6.0).sum::<f64>()
    };
    let parts: Vec<f64> = triangles.par_chunks(CHUNK).map(|part| part.iter().map(cone).sum()).collect();
    parts.iter().sum::<f64>() + holes.iter().map(fan).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;
    #[test]
    fn volumes_and_lengths_are_known() {
        let mesh = crate::mesh_source::load("sphere:3").unwrap().mesh;
        let rest = Rest::of(&mesh);
        let far = mesh.positions().iter().map(|&p| add(p, [1e3, 0.0, 0.0])).collect::<Vec<_>>();
        let moved = rest.compare(&far);
        assert!(moved.volume_change.unwrap().abs() < 1e-9 && (moved.stretch[1] - 1.0).abs() < 1e-9);
        let half: Vec<_> = mesh.positions().iter().map(|&p| scale(0.5, p)).collect();
        let halved = rest.compare(&half);
        assert!((halved.volume_change.unwrap() + 0.875).abs() < 1e-12);
        assert!(halved.stretch.iter().all(|s| (s - 0.5).abs() < 1e-12) && halved.distorted == 1.0);
        // A sphere without one triangle: the fan of three is the triangle that is gone.
        let torn = TriangleMesh::new(mesh.positions().to_vec(), mesh.triangles()[1..].to_vec()).unwrap();
        let rest = Rest::of(&torn);
        assert!((rest.volume - Rest::of(&mesh).volume).abs() < 1e-12);
        assert!((rest.compare(&half).volume_change.unwrap() + 0.875).abs() < 1e-12);
        let open = crate::mesh_source::load("grid:4").unwrap().mesh;
        let figures = Rest::of(&open).compare(open.positions());
        assert_eq!((figures.volume_change, figures.distorted), (None, 0.0));
    }
}
