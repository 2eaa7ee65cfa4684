//! What a frame does to a surface: its volume and the lengths of its edges.

use lapsolve::mesh::TriangleMesh;
use lapsolve::vector::{Vector, distance_squared};
use lapsolve::workload::volume::Enclosure;
use rayon::prelude::*;

/// A surface at rest, for comparison.
#[derive(Clone, Debug)]
pub struct Rest {
    /// Each edge once, with its length; edges of length 0 are left out.
    edges: Vec<([u32; 2], f64)>,
    /// None for open surfaces.
    enclosure: Option<Enclosure>,
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

/// Edges of one parallel piece: some 100 us of work.
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
        Self { edges, enclosure: Enclosure::new(mesh).ok() }
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
        let change = |enclosure: &Enclosure| enclosure.volume(positions) / enclosure.at_rest() - 1.0;
        Figures {
            volume_change: self.enclosure.as_ref().map(change),
            stretch: [total.0, total.1 / count, total.2],
            distorted: total.3 as f64 / count,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lapsolve::vector::{add, scale};

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
        let open = crate::mesh_source::load("grid:4").unwrap().mesh;
        let figures = Rest::of(&open).compare(open.positions());
        assert_eq!((figures.volume_change, figures.distorted), (None, 0.0));
    }
}
