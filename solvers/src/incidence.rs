//! Which triangle corners meet at each vertex.

/// For every vertex the corners at it, ascending. Corner 3 t + c is corner c of triangle t.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Incidence {
    starts: Vec<u32>,
    corners: Vec<u32>,
}

impl Incidence {
    /// Counting sort of the 3 m corners by vertex: two passes over the triangles, 12 bytes written per triangle.
    ///
    /// # Panics
    /// If a triangle names a vertex outside of 0..`vertices`.
    pub fn new(vertices: usize, triangles: &[[u32; 3]]) -> Self {
        let mut starts = vec![0u32; vertices + 1];
        let corners_of = triangles.as_flattened();
        for &v in corners_of {
            starts[v as usize] += 1;
        }
        let mut total = 0;
        for start in &mut starts {
            total += *start;
            *start = total;
        }
        // Each start stands at the end of its list now and walks down to its beginning.
        let mut corners = vec![0u32; total as usize];
        for (corner, &v) in corners_of.iter().enumerate().rev() {
            let slot = &mut starts[v as usize];
            *slot -= 1;
            corners[*slot as usize] = corner as u32;
        }
        Self { starts, corners }
    }

    /// Drops the corners of the triangles that `keep` refuses.
    pub fn retain(&mut self, keep: impl Fn(usize) -> bool) {
        let mut kept = 0;
        let mut begin = 0;
        for v in 0..self.vertices() {
            let end = self.starts[v + 1] as usize;
            self.starts[v] = kept as u32;
            for at in begin..end {
                let corner = self.corners[at];
                if keep(corner as usize / 3) {
                    self.corners[kept] = corner;
                    kept += 1;
                }
            }
            begin = end;
        }
        *self.starts.last_mut().expect("one more than vertices") = kept as u32;
        self.corners.truncate(kept);
    }

    /// Number of vertices.
    pub fn vertices(&self) -> usize {
        self.starts.len() - 1
    }

    /// The corners at vertex `v`, ascending.
    #[inline]
    pub fn at(&self, v: usize) -> &[u32] {
        &self.corners[self.starts[v] as usize..self.starts[v + 1] as usize]
    }

    /// Start of each vertex' corners in [`corners`](Self::corners); length vertices + 1.
    pub fn starts(&self) -> &[u32] {
        &self.starts
    }

    /// All corners, vertex after vertex.
    pub fn corners(&self) -> &[u32] {
        &self.corners
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_triangles_and_a_lonely_vertex() {
        let mut incidence = Incidence::new(5, &[[0, 1, 2], [2, 1, 4]]);
        let lists: Vec<_> = (0..5).map(|v| incidence.at(v).to_vec()).collect();
        assert_eq!(lists, [vec![0], vec![1, 4], vec![2, 3], vec![], vec![5]]);
        incidence.retain(|triangle| triangle == 1);
        let lists: Vec<_> = (0..5).map(|v| incidence.at(v).to_vec()).collect();
        assert_eq!(lists, [vec![], vec![4], vec![3], vec![], vec![5]]);
    }
}
