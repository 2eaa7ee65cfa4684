//! The components of a target: which are solved for, which follow, which vertices stay.

use super::marks::Marks;
use crate::dirichlet::components;
use crate::laplacian::{Laplacian, Weights};
use crate::mesh::TriangleMesh;
use crate::range::within_range;
use crate::vector::{Vector, add, distance_squared, scale};

/// What becomes of every vertex of the target.
#[derive(Clone, Debug, Default)]
pub struct Pieces {
    /// For each mark its marked component, numbered from 0 by lowest vertex.
    of_mark: Vec<u32>,
    /// Number of marks on each marked component.
    marks_of: Vec<u32>,
    /// Marked component of every vertex; 0 for all others. Empty where there is only one.
    of_vertex: Vec<u32>,
    detached: Vec<Detached>,
    unreferenced: Vec<u32>,
}

/// A component without marks: it moves rigidly with `anchor`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Detached {
    /// Its vertices, ascending.
    pub vertices: Vec<u32>,
    /// The vertex of a marked component nearest to the mean of its vertices; the first of equally near ones.
    pub anchor: u32,
}

impl Pieces {
    /// Marked component of each mark.
    pub fn of_mark(&self) -> &[u32] {
        &self.of_mark
    }

    /// Number of marks on each marked component.
    pub fn marks_of(&self) -> &[u32] {
        &self.marks_of
    }

    /// Marked component of vertex `v`, which must be on one.
    #[inline(always)]
    pub fn of_vertex(&self, v: usize) -> usize {
        self.of_vertex.get(v).map_or(0, |&piece| piece as usize)
    }

    /// Components without marks.
    pub fn detached(&self) -> &[Detached] {
        &self.detached
    }

    /// Number of vertices that are in no system: detached or unreferenced.
    pub fn outside(&self) -> usize {
        self.unreferenced.len() + self.detached.iter().map(|d| d.vertices.len()).sum::<usize>()
    }

    /// Vertices on no triangle of positive area, ascending: they stay where they are.
    pub fn unreferenced(&self) -> &[u32] {
        &self.unreferenced
    }
}

/// L of the marked components, and the pieces.
pub(super) fn split(target: &TriangleMesh, marks: &Marks, weights: Weights) -> (Laplacian, Pieces) {
    let whole = Laplacian::assemble(target, weights);
    let roots = components(whole.matrix());
    let coupled = whole.matrix().coupled_rows();
    let n = target.positions().len();
    let mut marked: Vec<u32> = marks.all().iter().map(|m| roots[m.target[0] as usize]).collect();
    let of_root = |root: u32, marked: &[u32]| marked.binary_search(&root).ok();
    let root_of_mark = marked.clone();
    marked.sort_unstable();
    marked.dedup();
    let mut pieces = Pieces { marks_of: vec![0; marked.len()], ..Pieces::default() };
    for &root in &root_of_mark {
        let piece = of_root(root, &marked).expect("collected above");
        pieces.of_mark.push(piece as u32);
        pieces.marks_of[piece] += 1;
    }
    pieces.unreferenced = (0..n as u32).filter(|&v| whole.matrix().is_absent(v as usize, &coupled)).collect();
    if marked.len() > 1 {
        pieces.of_vertex = roots.iter().map(|&r| of_root(r, &marked).unwrap_or(0) as u32).collect();
    }
    let mut loose: Vec<u32> = (0..n as u32)
        .filter(|&v| {
            !whole.matrix().is_absent(v as usize, &coupled) && of_root(roots[v as usize], &marked).is_none()
        })
        .collect();
    if loose.is_empty() {
        return (whole, pieces);
    }
    let anchors: Vec<u32> =
        (0..n as u32).filter(|&v| of_root(roots[v as usize], &marked).is_some()).collect();
    loose.sort_by_key(|&v| roots[v as usize]); // stable: ascending within each component
    let groups: Vec<&[u32]> = loose.chunk_by(|&a, &b| roots[a as usize] == roots[b as usize]).collect();
    pieces.detached = detached(target.positions(), &groups, &anchors);
    let kept = target.triangles().iter().filter(|t| of_root(roots[t[0] as usize], &marked).is_some());
    let rest = TriangleMesh::new(target.positions().to_vec(), kept.copied().collect());
    (Laplacian::assemble(&rest.expect("a part of a mesh is a mesh"), weights), pieces)
}

fn detached(positions: &[[f64; 3]], groups: &[&[u32]], anchors: &[u32]) -> Vec<Detached> {
    let positions = within_range(positions);
    let centres: Vec<Vector> = groups
        .iter()
        .map(|group| {
            let sum = group.iter().fold([0.0; 3], |sum, &v| add(sum, positions[v as usize]));
            scale(1.0 / group.len() as f64, sum)
        })
        .collect();
    let points: Vec<(Vector, u32)> = anchors.iter().map(|&v| (positions[v as usize], v)).collect();
    let tree = Nearest::new(points);
    let follow =
        |(group, centre): (&&[u32], Vector)| Detached { vertices: group.to_vec(), anchor: tree.find(centre) };
    groups.iter().zip(centres).map(follow).collect()
}

/// Nearest-point queries: a k-d tree laid out in place, the median of every range being its root.
struct Nearest {
    points: Vec<(Vector, u32)>,
}

impl Nearest {
    fn new(mut points: Vec<(Vector, u32)>) -> Self {
        Self::arrange(&mut points, 0);
        Self { points }
    }

    fn arrange(points: &mut [(Vector, u32)], axis: usize) {
        if points.len() > 1 {
            let middle = points.len() / 2;
            points.select_nth_unstable_by(middle, |a, b| a.0[axis].total_cmp(&b.0[axis]));
            let (low, high) = points.split_at_mut(middle);
            Self::arrange(low, (axis + 1) % 3);
            Self::arrange(&mut high[1..], (axis + 1) % 3);
        }
    }

    /// The number of the nearest point; the lowest of equally near ones.
    fn find(&self, to: Vector) -> u32 {
        let mut best = (f64::INFINITY, u32::MAX);
        Self::search(&self.points, 0, to, &mut best);
        best.1
    }

    fn search(points: &[(Vector, u32)], axis: usize, to: Vector, best: &mut (f64, u32)) {
        let Some(&(point, number)) = points.get(points.len() / 2) else { return };
        let candidate = (distance_squared(point, to), number);
        if candidate < *best {
            *best = candidate;
        }
        let (low, high) = points.split_at(points.len() / 2);
        let gap = to[axis] - point[axis];
        let (near, far) = if gap < 0.0 { (low, &high[1..]) } else { (&high[1..], low) };
        Self::search(near, (axis + 1) % 3, to, best);
        if gap * gap <= best.0 {
            Self::search(far, (axis + 1) % 3, to, best);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nearest_agrees_with_trying_all() {
        let coordinate = |i: u32, k: u32| f64::from(i.wrapping_mul(2_654_435_761).rotate_left(9 * k) >> 27);
        let points: Vec<(Vector, u32)> = (0..500).map(|i| ([0, 1, 2].map(|k| coordinate(i, k)), i)).collect();
        let tree = Nearest::new(points.clone());
        for i in 500..700 {
            let to = [0, 1, 2].map(|k| coordinate(i, k) + 0.5); // many ties: coordinates are 0 to 31
            let all = points.iter().map(|&(p, number)| (distance_squared(p, to), number));
            let expected = all.reduce(|a, b| if b < a { b } else { a }).expect("points").1;
            assert_eq!(tree.find(to), expected);
        }
    }
}
