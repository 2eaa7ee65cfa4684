//! A bounding-volume hierarchy of triangles, to ask whether a segment crosses a surface.
//!
//! Binary, split at the median centroid along the longest side of the box of centroids, so that its depth is at most
//! log2 of the number of triangles whatever the mesh. Zero-area triangles are nothing to cross and are left out.

use crate::mesh::TriangleMesh;
use crate::vector::{Vector, cross, dot, sub};

/// Triangles of a leaf: testing four costs about as much as visiting two more boxes.
const LEAF: usize = 4;

/// Slack of the barycentric coordinates of a hit, so that rounding leaves no crack between two triangles.
const SEAM: f64 = 1e-12;

/// The triangles of a mesh, sorted into boxes.
#[derive(Clone, Debug)]
pub struct TriangleTree {
    nodes: Vec<Node>,
    triangles: Vec<Entry>,
}

#[derive(Clone, Copy, Debug)]
struct Entry {
    corners: [Vector; 3],
    vertices: [u32; 3],
}

/// A box and what is in it: the children of node i are i + 1 and `next`, unless it holds triangles.
#[derive(Clone, Copy, Debug)]
struct Node {
    low: Vector,
    high: Vector,
    /// First triangle of a leaf; second child of another node.
    next: u32,
    /// Triangles of a leaf; 0 in other nodes.
    count: u32,
}

impl TriangleTree {
    /// Sorts the triangles of `mesh`. Cost: O(m log m), about 150 bytes per triangle.
    pub fn new(mesh: &TriangleMesh) -> Self {
        let entry = |t: usize| Entry { corners: mesh.corners(t), vertices: mesh.triangles()[t] };
        let mut triangles: Vec<Entry> =
            (0..mesh.triangles().len()).filter(|&t| !mesh.is_zero_area(t)).map(entry).collect();
        let mut nodes = Vec::with_capacity(triangles.len());
        if !triangles.is_empty() {
            let count = triangles.len();
            split(&mut nodes, &mut triangles, 0, count);
        }
        Self { nodes, triangles }
    }

    /// Whether the segment from `from` to `to` meets a triangle that does not use vertex `ignored`, farther than `margin`
    /// from both of its ends.
    pub fn crosses(&self, from: Vector, to: Vector, ignored: Option<u32>, margin: f64) -> bool {
        let direction = sub(to, from);
        let length = dot(direction, direction).sqrt();
        let range = [margin / length, 1.0 - margin / length];
        // Written so that a NaN (segment of length 0) leaves, too.
        if self.nodes.is_empty() || !(range[0] < range[1]) {
            return false;
        }
        let inverse = direction.map(|x| 1.0 / x);
        let mut stack = [0_u32; 64]; // the depth is below 32
        let mut top = 1;
        while top > 0 {
            top -= 1;
            let at = stack[top];
            let node = &self.nodes[at as usize];
            if !meets_box(node, from, inverse) {
                continue;
            }
            if node.count == 0 {
                (stack[top], stack[top + 1]) = (at + 1, node.next);
                top += 2;
                continue;
            }
            let leaf = &self.triangles[node.next as usize..(node.next + node.count) as usize];
            let hit = |entry: &Entry| {
                ignored.is_none_or(|v| !entry.vertices.contains(&v))
                    && hit(from, direction, &entry.corners).is_some_and(|t| range[0] < t && t < range[1])
            };
            if leaf.iter().any(hit) {
                return true;
            }
        }
        false
    }
}

/// Adds the node of `triangles[from..to]` and all below it.
fn split(nodes: &mut Vec<Node>, triangles: &mut [Entry], from: usize, to: usize) {
    let (low, high) = bounds(triangles[from..to].iter().flat_map(|entry| entry.corners));
    let at = nodes.len();
    nodes.push(Node { low, high, next: from as u32, count: (to - from) as u32 });
    if to - from <= LEAF {
        return;
    }
    let (low, high) = bounds(triangles[from..to].iter().map(|entry| centroid(&entry.corners)));
    let side = |i: usize| high[i] - low[i];
    let axis = (1..3).fold(0, |best, i| if side(i) > side(best) { i } else { best });
    let middle = usize::midpoint(from, to);
    triangles[from..to].select_nth_unstable_by(middle - from, |a, b| {
        centroid(&a.corners)[axis].total_cmp(&centroid(&b.corners)[axis])
    });
    split(nodes, triangles, from, middle);
    let next = nodes.len() as u32;
    split(nodes, triangles, middle, to);
    (nodes[at].next, nodes[at].count) = (next, 0);
}

fn bounds(points: impl Iterator<Item = Vector>) -> (Vector, Vector) {
    points.fold(([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]), |(low, high), p| {
        (std::array::from_fn(|i| low[i].min(p[i])), std::array::from_fn(|i| high[i].max(p[i])))
    })
}

/// Three times the centroid.
fn centroid(corners: &[Vector; 3]) -> Vector {
    std::array::from_fn(|i| corners[0][i] + corners[1][i] + corners[2][i])
}

/// Whether from + t direction is in the box for some t in [0, 1] (slabs; `inverse` = 1 / direction).
fn meets_box(node: &Node, from: Vector, inverse: Vector) -> bool {
    let (mut enter, mut leave) = (0.0_f64, 1.0_f64);
    for i in 0..3 {
        if inverse[i].is_infinite() {
            // Parallel to the slab: 0 x infinity would be NaN.
            if from[i] < node.low[i] || from[i] > node.high[i] {
                return false;
            }
            continue;
        }
        let (a, b) = ((node.low[i] - from[i]) * inverse[i], (node.high[i] - from[i]) * inverse[i]);
        enter = enter.max(a.min(b));
        leave = leave.min(a.max(b));
    }
    enter <= leave + SEAM
}

/// t where from + t direction meets the triangle, from either side (Moller and Trumbore 1997).
fn hit(from: Vector, direction: Vector, corners: &[Vector; 3]) -> Option<f64> {
    let (e1, e2) = (sub(corners[1], corners[0]), sub(corners[2], corners[0]));
    let p = cross(direction, e2);
    let determinant = dot(e1, p);
    let s = sub(from, corners[0]);
    let u = dot(s, p) / determinant;
    let q = cross(s, e1);
    let v = dot(direction, q) / determinant;
    // A segment in the plane of the triangle has determinant 0 and fails here by its NaN or infinity.
    let inside = u >= -SEAM && v >= -SEAM && u + v <= 1.0 + SEAM;
    inside.then(|| dot(e2, q) / determinant)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A sphere of radius 1 by longitude and latitude.
    fn sphere() -> TriangleMesh {
        let (rows, columns) = (16_u32, 24_u32);
        let positions = (0..=rows)
            .flat_map(|r| (0..columns).map(move |c| (r, c)))
            .map(|(r, c)| {
                let (polar, around) = (f64::from(r) / f64::from(rows), f64::from(c) / f64::from(columns));
                let (theta, phi) = (polar * std::f64::consts::PI, around * std::f64::consts::TAU);
                [theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()]
            })
            .collect();
        let triangles = (0..rows)
            .flat_map(|r| (0..columns).map(move |c| (r, c)))
            .flat_map(|(r, c)| {
                let at = |r: u32, c: u32| r * columns + c % columns;
                [[at(r, c), at(r + 1, c), at(r, c + 1)], [at(r, c + 1), at(r + 1, c), at(r + 1, c + 1)]]
            })
            .collect();
        TriangleMesh::new(positions, triangles).expect("valid")
    }

    #[test]
    fn agrees_with_every_triangle_tested_alone() {
        let mesh = sphere();
        let tree = TriangleTree::new(&mesh);
        let mut crossings = 0;
        for i in 0..500_u32 {
            let point = |k: u32| -> Vector {
                [1, 2, 3].map(|j| {
                    f64::from((i * 7 + k).wrapping_mul(2_654_435_761).rotate_left(9 * j) >> 8)
                        / f64::from(1 << 23)
                        - 1.0
                })
            };
            let (from, to) = (point(1), point(2));
            let plain = (0..mesh.triangles().len())
                .filter(|&t| !mesh.is_zero_area(t))
                .filter_map(|t| hit(from, sub(to, from), &mesh.corners(t)))
                .any(|t| 0.0 < t && t < 1.0);
            assert_eq!(tree.crosses(from, to, None, 0.0), plain, "{from:?} {to:?}");
            crossings += u32::from(plain);
        }
        assert!((50..450).contains(&crossings), "{crossings}");
    }

    #[test]
    fn inner_segments_cross_nothing_and_no_ray_slips_through_an_edge() {
        let mesh = sphere();
        let tree = TriangleTree::new(&mesh);
        for (v, &p) in mesh.positions().iter().enumerate() {
            let outside = p.map(|x| 1.5 * x);
            assert!(!tree.crosses([0.0; 3], p, Some(v as u32), 1e-9), "{v}");
            assert!(tree.crosses([0.01, 0.02, 0.0], outside, None, 1e-9), "through vertex {v}");
            assert!(!tree.crosses(p, outside, Some(v as u32), 1e-9), "{v}");
        }
        for &[a, b, _] in mesh.triangles() {
            let middle: Vector =
                std::array::from_fn(|i| mesh.positions()[a as usize][i] + mesh.positions()[b as usize][i]);
            assert!(tree.crosses([0.0; 3], middle, None, 0.0), "through edge {a} {b}");
        }
        assert!(!tree.crosses([0.5; 3], [0.5; 3], None, 0.0), "a segment of length 0");
    }
}
