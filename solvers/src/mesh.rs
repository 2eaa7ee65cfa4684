//! Triangle meshes: positions, triangles, and what is wrong with them.

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

    /// Whether triangle `t` has no area to speak of: 2 area <= 1e-8 (longest edge)^2, see [`is_zero_area`].
    pub fn is_zero_area(&self, t: usize) -> bool {
        is_zero_area(self.triangles[t].map(|v| self.positions[v as usize]))
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

/// Twice the area of a triangle relative to its longest edge squared at and below which it counts as having none. The
/// cotangents of such a triangle exceed 1e8, which leaves fewer than eight of sixteen digits to its neighbours.
pub const ZERO_AREA: f64 = 1e-8;

/// Whether 2 area <= [`ZERO_AREA`] (longest edge)^2; also when all corners coincide. Free of overflow and underflow for
/// all finite coordinates.
pub fn is_zero_area([p, q, r]: [[f64; 3]; 3]) -> bool {
    // Halved before they are subtracted, so that the difference of two large coordinates stays finite.
    let edge = |a: [f64; 3], b: [f64; 3]| [0, 1, 2].map(|i| 0.5 * b[i] - 0.5 * a[i]);
    let (mut u, mut v) = (edge(p, q), edge(p, r));
    let size = u.iter().chain(&v).fold(0.0f64, |size, x| size.max(x.abs()));
    // Outside of this range fourth powers of lengths leave the range of f64.
    if !(1e-70..=1e70).contains(&size) {
        if size == 0.0 {
            return true;
        }
        u = u.map(|x| x / size);
        v = v.map(|x| x / size);
    }
    let w = [0, 1, 2].map(|i| v[i] - u[i]);
    let square = |a: [f64; 3]| a[0] * a[0] + a[1] * a[1] + a[2] * a[2];
    let normal = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    let longest = square(u).max(square(v)).max(square(w));
    square(normal) <= (ZERO_AREA * longest).powi(2)
}
