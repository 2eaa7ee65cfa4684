//! The triangles that enclose a volume, small holes closed.

use super::VolumeError;
use crate::mesh::TriangleMesh;
use crate::vector::{Vector, add, cross, dot, scale, sub};
use std::collections::HashMap;
use std::ops::Range;

/// Most edges without a partner, of all, that still count as small holes: scans have them at soles and ears.
const SMALL_HOLES: f64 = 0.01;

/// Triangles that are summed before the sums are added: 50 us of work, and sums of sums round less.
pub(super) const CHUNK: usize = 1 << 13;

/// A surface that encloses a volume: its triangles, and for each small hole a fan about the mean of its edges.
#[derive(Clone, Debug)]
pub struct Enclosure {
    triangles: Vec<[u32; 3]>,
    /// Directed edges without a partner, loop by loop.
    holes: Vec<Vec<[u32; 2]>>,
    at_rest: f64,
}

impl Enclosure {
    /// The surface of `mesh`. Up to one edge in a hundred may lie on a hole; repeated triangles and edges of several
    /// components count as often as they are there.
    ///
    /// # Errors
    /// [`VolumeError::Open`] for more holes than that, [`VolumeError::Nothing`] where the volume is 0 or no number.
    pub fn new(mesh: &TriangleMesh) -> Result<Self, VolumeError> {
        let (holes, edges) = holes(mesh.triangles());
        let open = holes.iter().map(Vec::len).sum::<usize>();
        if open as f64 > SMALL_HOLES * edges as f64 {
            return Err(VolumeError::Open { edges: open });
        }
        let mut new = Self { triangles: mesh.triangles().to_vec(), holes, at_rest: 0.0 };
        new.at_rest = new.volume(mesh.positions());
        match new.at_rest {
            volume if volume.is_normal() => Ok(new),
            volume => Err(VolumeError::Nothing { volume }),
        }
    }

    /// V of the mesh it was made of; negative where its triangles face inwards.
    pub fn at_rest(&self) -> f64 {
        self.at_rest
    }

    /// The triangles, without those of the fans.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// V for other positions of the vertices. Cost: one pass over the triangles, no allocation.
    pub fn volume(&self, positions: &[Vector]) -> f64 {
        let chunks = self.triangles.len().div_ceil(CHUNK);
        let cones: f64 = (0..chunks).map(|chunk| self.cones(self.chunk(chunk), positions)).sum();
        cones + self.fans(|v| [self.relative(v, positions), [0.0; 3]])[0]
    }

    /// The triangles of one chunk.
    pub(super) fn chunk(&self, chunk: usize) -> Range<usize> {
        chunk * CHUNK..((chunk + 1) * CHUNK).min(self.triangles.len())
    }

    /// Places count from a vertex of the surface, so that far from the origin no digits are lost.
    #[inline]
    pub(super) fn relative(&self, v: u32, positions: &[Vector]) -> Vector {
        sub(positions[v as usize], positions[self.triangles[0][0] as usize])
    }

    fn cones(&self, triangles: Range<usize>, positions: &[Vector]) -> f64 {
        let at = |v: u32| self.relative(v, positions);
        let cone = |&[a, b, c]: &[u32; 3]| dot(at(a), cross(at(b), at(c))) / 6.0;
        self.triangles[triangles].iter().map(cone).sum()
    }

    /// What the fans add to [`cubic`], for places and directions `at` the vertices; a tip has the mean of both.
    pub(super) fn fans(&self, at: impl Fn(u32) -> [Vector; 2]) -> [f64; 4] {
        let mut sum = [0.0; 4];
        for hole in &self.holes {
            let share = 1.0 / hole.len() as f64;
            let tip = hole
                .iter()
                .map(|&[a, _]| at(a))
                .fold([[0.0; 3]; 2], |tip, a| std::array::from_fn(|i| add(tip[i], scale(share, a[i]))));
            for &[a, b] in hole {
                let fan = cubic([tip, at(b), at(a)]);
                sum = std::array::from_fn(|i| sum[i] + fan[i]);
            }
        }
        sum
    }
}

/// Coefficients of the volume of the cone over a triangle whose corners are at x + s n, as a polynomial in s; a corner is [x, n].
#[inline]
pub(super) fn cubic([[a, u], [b, v], [c, w]]: [[Vector; 2]; 3]) -> [f64; 4] {
    let (bc, vw) = (cross(b, c), cross(v, w));
    let mixed = add(cross(b, w), cross(v, c));
    [dot(a, bc), dot(u, bc) + dot(a, mixed), dot(u, mixed) + dot(a, vw), dot(u, vw)].map(|x| x / 6.0)
}

/// Directed edges that no triangle uses the other way, as often as they lack a partner, grouped by common vertices; and the
/// number of all edges.
fn holes(triangles: &[[u32; 3]]) -> (Vec<Vec<[u32; 2]>>, usize) {
    let mut edges: Vec<([u32; 2], i32)> = triangles
        .iter()
        .flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]])
        .map(|[a, b]| if a < b { ([a, b], 1) } else { ([b, a], -1) })
        .collect();
    edges.sort_unstable();
    let (mut open, mut count): (Vec<[u32; 2]>, usize) = (Vec::new(), 0);
    for group in edges.chunk_by(|a, b| a.0 == b.0) {
        count += 1;
        let ([a, b], surplus) = (group[0].0, group.iter().map(|e| e.1).sum::<i32>());
        let edge = if surplus > 0 { [a, b] } else { [b, a] };
        open.extend(std::iter::repeat_n(edge, surplus.unsigned_abs() as usize));
    }
    let mut at: HashMap<u32, Vec<usize>> = HashMap::new();
    for (e, edge) in open.iter().enumerate() {
        edge.iter().for_each(|&v| at.entry(v).or_default().push(e));
    }
    let mut loops: Vec<Vec<[u32; 2]>> = Vec::new();
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
    (loops, count)
}
