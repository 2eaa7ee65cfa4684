//! Triangle meshes: positions, triangles, and what is wrong with them.

use crate::triangle::shape;
use thiserror::Error;

/// A triangle mesh with checked construction: every coordinate is finite and every index in range.
///
/// Nothing else is promised: triangles may have zero area or repeat, vertices may be used by no triangle, edges may
/// be non-manifold. What the mathematics does with those is said where it happens ([`crate::laplacian`]).
#[derive(Clone, Debug, PartialEq)]
pub struct TriangleMesh {
    positions: Vec<[f64; 3]>,
    triangles: Vec<[u32; 3]>,
}

/// Why a [`TriangleMesh`] cannot be made.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum MeshError {
    /// A coordinate is NaN or infinite.
    #[error("vertex {vertex} has a coordinate that is not finite; remove the vertex or repair the file")]
    NonFinite {
        /// 0-based index of the first such vertex.
        vertex: usize,
    },
    /// A triangle names a vertex that does not exist.
    #[error(
        "triangle {triangle} names vertex {vertex}, but the mesh has {vertices} vertices (indices are 0-based)"
    )]
    IndexOutOfRange {
        /// 0-based index of the first such triangle.
        triangle: usize,
        /// The offending index.
        vertex: u32,
        /// Number of vertices of the mesh.
        vertices: usize,
    },
    /// There is no triangle, so there is no surface to work on.
    #[error("the mesh has no triangles")]
    Empty,
    /// More vertices or triangles than 32-bit indices can name.
    #[error("the mesh has {count} {what}; at most 2^30 are supported")]
    TooLarge {
        /// "vertices" or "triangles".
        what: &'static str,
        /// How many there are.
        count: usize,
    },
}

impl TriangleMesh {
    /// Checks and takes over positions (n x 3) and triangles (m x 3, 0-based vertex indices).
    ///
    /// # Errors
    /// [`MeshError`] naming the first offending vertex or triangle. Cost: one pass over both arrays.
    pub fn new(positions: Vec<[f64; 3]>, triangles: Vec<[u32; 3]>) -> Result<Self, MeshError> {
        const LIMIT: usize = 1 << 30; // so that 3 m half-edges and 2 n still fit the u32 indices used everywhere
        for (what, count) in [("vertices", positions.len()), ("triangles", triangles.len())] {
            if count > LIMIT {
                return Err(MeshError::TooLarge { what, count });
            }
        }
        if triangles.is_empty() {
            return Err(MeshError::Empty);
        }
        if let Some(vertex) = positions.iter().position(|p| p.iter().any(|x| !x.is_finite())) {
            return Err(MeshError::NonFinite { vertex });
        }
        let vertices = positions.len();
        for (triangle, corners) in triangles.iter().enumerate() {
            if let Some(&vertex) = corners.iter().find(|&&v| v as usize >= vertices) {
                return Err(MeshError::IndexOutOfRange { triangle, vertex, vertices });
            }
        }
        Ok(Self { positions, triangles })
    }

    /// Vertex positions, n x 3, in file units.
    pub fn positions(&self) -> &[[f64; 3]] {
        &self.positions
    }

    /// Triangles, m x 3, 0-based vertex indices, counter-clockwise seen from outside.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Corners of triangle `t`.
    pub fn corners(&self, t: usize) -> [[f64; 3]; 3] {
        self.triangles[t].map(|v| self.positions[v as usize])
    }

    /// Whether triangle `t` has no area to speak of: 2 area <= 1e-8 (longest edge)^2, see [`crate::triangle::ZERO_AREA`].
    pub fn is_zero_area(&self, t: usize) -> bool {
        shape(self.corners(t)).is_none()
    }

    /// The same connectivity with other positions.
    ///
    /// # Errors
    /// [`MeshError::NonFinite`]. # Panics: if the number of positions differs.
    pub fn with_positions(&self, positions: Vec<[f64; 3]>) -> Result<Self, MeshError> {
        assert_eq!(positions.len(), self.positions.len(), "positions: one per vertex of the mesh");
        Self::new(positions, self.triangles.clone())
    }

    /// Length of the diagonal of the bounding box of the vertices that triangles use: the length scale of every
    /// relative error in this project. Zero only if all those vertices coincide.
    pub fn diagonal(&self) -> f64 {
        let (low, high) = self.bounding_box();
        (0..3).map(|i| (high[i] - low[i]).powi(2)).sum::<f64>().sqrt()
    }

    /// Smallest and largest coordinate along each axis, over the vertices that triangles use.
    pub fn bounding_box(&self) -> ([f64; 3], [f64; 3]) {
        let mut low = [f64::INFINITY; 3];
        let mut high = [f64::NEG_INFINITY; 3];
        for &v in self.triangles.iter().flatten() {
            let p = self.positions[v as usize];
            for i in 0..3 {
                low[i] = low[i].min(p[i]);
                high[i] = high[i].max(p[i]);
            }
        }
        (low, high)
    }
}
