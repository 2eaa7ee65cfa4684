//! The adjacency graph of a symmetric sparse matrix.

/// An undirected graph without loops, stored as one sorted neighbour list per vertex.
///
/// It is the pattern of a symmetric matrix without its diagonal; for a mesh Laplacian, the vertex adjacency of the
/// mesh. Every edge is stored twice, once per end. Memory: 4 (n + 1) + 8 |E| bytes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Graph {
    starts: Vec<u32>,
    neighbours: Vec<u32>,
}

impl Graph {
    /// The graph of `n` vertices with the given edges, in any order and direction; repeated edges and loops are
    /// dropped. `edges` is called twice and must yield the same pairs both times. Cost: O(n + edges).
    ///
    /// # Panics
    /// If an end is not below `n`, or if the 2 |E| list entries do not fit 32-bit positions.
    pub fn from_edges<I: Iterator<Item = (u32, u32)>>(n: usize, edges: impl Fn() -> I) -> Self {
        let mut starts = vec![0_usize; n + 1];
        edges().filter(|(a, b)| a != b).for_each(|(a, b)| {
            starts[a as usize + 1] += 1;
            starts[b as usize + 1] += 1;
        });
        let mut next = Self::offsets(&mut starts);
        let mut neighbours = vec![0; starts[n]];
        let mut put = |at: u32, value: u32| {
            neighbours[next[at as usize] as usize] = value;
            next[at as usize] += 1;
        };
        edges().filter(|(a, b)| a != b).for_each(|(a, b)| {
            put(a, b);
            put(b, a);
        });
        Self::sorted(&starts, neighbours)
    }

    /// The graph of a symmetric matrix given by one triangle in compressed rows (or columns): row i holds
    /// `columns[row_starts[i]..row_starts[i + 1]]`. Diagonal entries are ignored. Cost: O(n + nnz).
    ///
    /// # Panics
    /// As [`Graph::from_edges`].
    pub fn from_triangle_of_matrix(row_starts: &[u32], columns: &[u32]) -> Self {
        let n = row_starts.len().saturating_sub(1);
        let row = |i: usize| {
            let own = &columns[row_starts[i] as usize..row_starts[i + 1] as usize];
            own.iter().copied().filter(move |&j| j as usize != i)
        };
        let mut starts = vec![0_usize; n + 1];
        for i in 0..n {
            let mut own = 0;
            for j in row(i) {
                starts[j as usize + 1] += 1;
                own += 1;
            }
            starts[i + 1] += own;
        }
        let mut next = Self::offsets(&mut starts);
        let mut neighbours = vec![0; starts[n]];
        for i in 0..n {
            let mut at = next[i];
            for j in row(i) {
                neighbours[at as usize] = j;
                at += 1;
                let other = &mut next[j as usize];
                neighbours[*other as usize] = i as u32;
                *other += 1;
            }
            next[i] = at;
        }
        Self::sorted(&starts, neighbours)
    }

    /// The vertex adjacency of a triangle mesh with `n` vertices: the graph of its Laplacian.
    ///
    /// # Panics
    /// As [`Graph::from_edges`].
    pub fn from_triangles(n: usize, triangles: &[[u32; 3]]) -> Self {
        Self::from_edges(n, || triangles.iter().flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)]))
    }

    /// Sums up the list lengths in `starts[1..]`; also returns the starts as positions for filling the lists.
    fn offsets(starts: &mut [usize]) -> Vec<u32> {
        for v in 1..starts.len() {
            starts[v] += starts[v - 1];
        }
        let total = starts[starts.len() - 1];
        assert!(u32::try_from(total).is_ok(), "{total} adjacency entries do not fit 32-bit positions");
        starts.iter().map(|&s| s as u32).collect()
    }

    /// Sorts each list `raw[starts[v]..starts[v + 1]]` and drops repeated entries.
    fn sorted(starts: &[usize], mut raw: Vec<u32>) -> Self {
        // A sorted triangle gives sorted lists: a vertex meets its earlier neighbours in their rows, then its own row.
        if starts.windows(2).all(|range| raw[range[0]..range[1]].is_sorted_by(|a, b| a < b)) {
            return Self { starts: starts.iter().map(|&s| s as u32).collect(), neighbours: raw };
        }
        let mut compact = Vec::with_capacity(starts.len());
        compact.push(0);
        let mut length = 0;
        for range in starts.windows(2) {
            raw[range[0]..range[1]].sort_unstable();
            let first = length;
            for at in range[0]..range[1] {
                let value = raw[at];
                if length == first || raw[length - 1] != value {
                    raw[length] = value;
                    length += 1;
                }
            }
            compact.push(length as u32);
        }
        raw.truncate(length);
        Self { starts: compact, neighbours: raw }
    }

    /// Number of vertices.
    pub fn n(&self) -> usize {
        self.starts.len() - 1
    }

    /// Number of list entries: twice the number of edges.
    pub fn entries(&self) -> usize {
        self.neighbours.len()
    }

    /// The neighbours of `v`, ascending, without `v` itself.
    #[inline]
    pub fn neighbours(&self, v: u32) -> &[u32] {
        &self.neighbours[self.starts[v as usize] as usize..self.starts[v as usize + 1] as usize]
    }

    /// Number of neighbours of `v`.
    #[inline]
    pub fn degree(&self, v: u32) -> usize {
        (self.starts[v as usize + 1] - self.starts[v as usize]) as usize
    }

    /// n + 1 positions in [`Graph::lists`]: vertex v owns `starts[v]..starts[v + 1]`.
    pub fn starts(&self) -> &[u32] {
        &self.starts
    }

    /// All neighbour lists, one after the other.
    pub fn lists(&self) -> &[u32] {
        &self.neighbours
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn repeated_edges_and_loops_are_dropped() {
        let edges = [(0, 1), (1, 0), (2, 2), (3, 1), (1, 3), (0, 1)];
        let graph = Graph::from_edges(5, || edges.into_iter());
        let lists: Vec<&[u32]> = (0..5).map(|v| graph.neighbours(v)).collect();
        assert_eq!(lists, [&[1][..], &[0, 3], &[], &[1], &[]]);
        assert_eq!((graph.n(), graph.entries(), graph.degree(1)), (5, 4, 2));
    }

    #[test]
    fn the_triangle_of_a_matrix_loses_its_diagonal() {
        // Upper triangle by rows of the path 0 - 1 - 2 plus the entry (0, 2).
        let graph = Graph::from_triangle_of_matrix(&[0, 3, 5, 6], &[0, 1, 2, 1, 2, 2]);
        assert_eq!(graph, Graph::from_triangles(3, &[[0, 1, 2]]));
        assert_eq!(Graph::from_triangle_of_matrix(&[0], &[]).n(), 0);
    }
}
