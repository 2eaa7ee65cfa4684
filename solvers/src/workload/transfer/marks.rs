//! Marks: corresponding triangles, their rotations in a pose (step 1) and the constraints they set (step 2).

use super::TransferError;
use super::alignment::Similarity;
use crate::error::SolveError;
use crate::mesh::TriangleMesh;
use crate::rotation::{
    Quaternion, conjugate, dominant_eigenvector, dot4, from_matrix, normalised, outer_products, product,
    rotate,
};
use crate::triangle::shape;
use crate::vector::{Vector, add, cross, distance_squared, dot, norm, scale, sub};
use std::ops::Range;

/// A norm below which an average of unit quaternions says nothing about a rotation any more.
pub const LEAST_NORM: f64 = 1e-3;

/// A template triangle and the target triangle that follows it.
#[derive(Clone, Debug)]
pub struct Mark {
    /// Vertices of the template triangle.
    pub template: [u32; 3],
    /// Vertices of the target triangle.
    pub target: [u32; 3],
    /// Centroid of the target triangle in its reference pose, c_t.
    pub target_centroid: Vector,
    /// c_t - s A c_p - d: from the aligned template triangle to the target triangle.
    pub offset: Vector,
    reference: Frame,
}

/// Stands for "no rotation" until the mean rotation is known.
const UNKNOWN: Quaternion = [0.0; 4];

/// What a mark does in a pose.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MarkPose {
    /// A R A^T as unit quaternion.
    pub rotation: Quaternion,
    /// Where the target triangle's centroid is to go: s A c'_p + d + A R A^T (c_t - s A c_p - d).
    pub centroid: Vector,
}

/// All marks, and which of them meet at each constrained vertex.
#[derive(Clone, Debug)]
pub struct Marks {
    marks: Vec<Mark>,
    alignment: Similarity,
    /// Constrained target vertices, ascending.
    vertices: Vec<u32>,
    /// For each of them the range of its marks in `at_vertex`.
    starts: Vec<u32>,
    at_vertex: Vec<u32>,
    template_vertices: usize,
}

impl Marks {
    /// Checks `pairs` (template triangle, target triangle) and aligns the reference poses by them.
    ///
    /// # Errors
    /// [`TransferError`] naming the first pair that cannot be used.
    pub(super) fn new(
        template: &TriangleMesh,
        target: &TriangleMesh,
        pairs: &[(u32, u32)],
    ) -> Result<Self, TransferError> {
        if pairs.is_empty() {
            return Err(TransferError::NoMarks);
        }
        let check = |pair: usize, side: &'static str, mesh: &TriangleMesh, triangle: u32| {
            let triangles = mesh.triangles().len();
            if triangle as usize >= triangles {
                return Err(TransferError::OutOfRange { pair, side, triangle, triangles });
            }
            Frame::of(mesh.corners(triangle as usize)).ok_or(TransferError::ZeroArea { pair, side, triangle })
        };
        let mut frames = Vec::with_capacity(pairs.len());
        for (pair, &(p, t)) in pairs.iter().enumerate() {
            frames.push(check(pair, "template", template, p)?);
            check(pair, "target", target, t)?;
        }
        let centroids = |&(p, t): &(u32, u32)| {
            (centroid(template.corners(p as usize)), centroid(target.corners(t as usize)))
        };
        let centroids: Vec<_> = pairs.iter().map(centroids).collect();
        let alignment = Similarity::between(&centroids);
        let mut marks = Vec::with_capacity(pairs.len());
        for ((&(p, t), reference), (c_p, c_t)) in pairs.iter().zip(frames).zip(centroids) {
            marks.push(Mark {
                template: template.triangles()[p as usize],
                target: target.triangles()[t as usize],
                target_centroid: c_t,
                offset: sub(c_t, alignment.apply(c_p)),
                reference,
            });
        }
        let (vertices, starts, at_vertex) = by_vertex(&marks);
        Ok(Self {
            marks,
            alignment,
            vertices,
            starts,
            at_vertex,
            template_vertices: template.positions().len(),
        })
    }

    /// The marks, in the order given.
    pub fn all(&self) -> &[Mark] {
        &self.marks
    }

    /// The similarity between the reference poses.
    pub fn alignment(&self) -> &Similarity {
        &self.alignment
    }

    /// Constrained target vertices, ascending.
    pub fn vertices(&self) -> &[u32] {
        &self.vertices
    }

    /// Number of template vertices.
    pub fn template_vertices(&self) -> usize {
        self.template_vertices
    }

    /// Step 1: rotation and centroid of every mark in the pose `template`. The signs of the quaternions agree with qbar,
    /// the dominant eigenvector of sum q q^T, whatever the order of the marks. A mark whose triangle has zero area in the
    /// pose takes qbar, the mean rotation of the others; the number of such marks is returned.
    ///
    /// # Errors
    /// [`SolveError::NonFinite`] with the template vertex.
    ///
    /// # Panics
    /// If the numbers of vertices or marks differ.
    pub fn pose(&self, template: &[[f64; 3]], poses: &mut [MarkPose]) -> Result<usize, SolveError> {
        assert_eq!(template.len(), self.template_vertices, "template: one position per vertex");
        assert_eq!(poses.len(), self.marks.len(), "poses: one per mark");
        self.turn(template, 0..poses.len(), poses);
        self.agree(template, poses)
    }

    /// The first half of [`pose`](Self::pose), mark by mark: rotations without a common sign, and centroids of marks `range`
    /// into `poses` (theirs alone). Collapsed triangles have rotation 0.
    pub(super) fn turn(&self, template: &[[f64; 3]], range: Range<usize>, poses: &mut [MarkPose]) {
        for (mark, pose) in self.marks[range].iter().zip(poses) {
            let corners = mark.template.map(|v| template[v as usize]);
            let turn = |frame: Frame| {
                let a = self.alignment.rotation;
                product(product(a, from_matrix(&mark.reference.rotation_to(&frame))), conjugate(a))
            };
            pose.rotation = Frame::of(corners).map_or(UNKNOWN, turn);
            pose.centroid = self.alignment.apply(centroid(corners));
        }
    }

    /// The second half of [`pose`](Self::pose): signs that agree, collapsed triangles, places.
    pub(super) fn agree(&self, template: &[[f64; 3]], poses: &mut [MarkPose]) -> Result<usize, SolveError> {
        let lost = |p: &[f64; 3]| p.iter().any(|x| !x.is_finite());
        let corners = || self.marks.iter().flat_map(|mark| mark.template);
        if let Some(v) = corners().find(|&v| lost(&template[v as usize])) {
            return Err(SolveError::NonFinite { row: v as usize });
        }
        let collapsed = poses.iter().filter(|pose| pose.rotation == UNKNOWN).count();
        let (mean, _) = dominant_eigenvector(&outer_products(poses.iter().map(|p| p.rotation)));
        for (mark, pose) in self.marks.iter().zip(poses) {
            if pose.rotation == UNKNOWN {
                pose.rotation = mean;
            } else if dot4(pose.rotation, mean) < 0.0 {
                pose.rotation = pose.rotation.map(|x| -x);
            }
            pose.centroid = add(pose.centroid, rotate(pose.rotation, mark.offset));
        }
        Ok(collapsed)
    }

    /// The constraint values of step 2, |C| x 4: at each constrained vertex the normalised mean over its marks.
    /// Where that mean vanishes (opposite rotations) the first of the marks counts; the number of such vertices is
    /// returned.
    pub fn constraint_values(&self, poses: &[MarkPose], values: &mut [f64]) -> usize {
        let mut vanished = 0;
        for (row, value) in values.chunks_exact_mut(4).enumerate() {
            let marks = &self.at_vertex[self.starts[row] as usize..self.starts[row + 1] as usize];
            let rotation = |mark: &u32| poses[*mark as usize].rotation;
            let sum = marks.iter().map(rotation).fold([0.0; 4], |s, q| std::array::from_fn(|i| s[i] + q[i]));
            let mean = normalised(sum, LEAST_NORM);
            vanished += usize::from(mean.is_none());
            value.copy_from_slice(&mean.unwrap_or_else(|| rotation(&marks[0])));
        }
        vanished
    }

    /// The mark whose target centroid is nearest to `x`; the first of equally near ones.
    pub fn nearest(&self, x: Vector) -> usize {
        let distance = |m: usize| distance_squared(self.marks[m].target_centroid, x);
        (1..self.marks.len()).fold(0, |best, m| if distance(m) < distance(best) { m } else { best })
    }
}

/// Constrained vertices, ascending, and the marks at each.
fn by_vertex(marks: &[Mark]) -> (Vec<u32>, Vec<u32>, Vec<u32>) {
    let mut pairs: Vec<(u32, u32)> =
        (0..).zip(marks).flat_map(|(m, mark)| mark.target.map(|v| (v, m))).collect();
    pairs.sort_unstable();
    let (mut vertices, mut starts) = (Vec::new(), vec![0]);
    for group in pairs.chunk_by(|a, b| a.0 == b.0) {
        vertices.push(group[0].0);
        starts.push(starts.last().expect("not empty") + group.len() as u32);
    }
    (vertices, starts, pairs.into_iter().map(|p| p.1).collect())
}

/// (p + q + r) / 3, summed in this order.
pub(super) fn centroid([p, q, r]: [Vector; 3]) -> Vector {
    [0, 1, 2].map(|i| ((p[i] + q[i]) + r[i]) / 3.0)
}

/// A triangle in coordinates of its own: orthonormal axes x, y in its plane and its unit normal z.
#[derive(Clone, Copy, Debug)]
struct Frame {
    axes: [Vector; 3],
    /// First edge (a, 0) and second edge (b, c) in these axes, in units of the largest edge component.
    a: f64,
    b: f64,
    c: f64,
}

impl Frame {
    /// The frame of a triangle; `None` where it has zero area.
    fn of(corners: [Vector; 3]) -> Option<Self> {
        shape(corners)?;
        let [p, q, r] = corners.map(|x| scale(0.5, x)); // halved: differences of huge coordinates stay finite
        let (first, second) = (sub(q, p), sub(r, p));
        let unit = first.iter().chain(&second).fold(0.0f64, |m, x| m.max(x.abs()));
        let (first, second) = (first.map(|x| x / unit), second.map(|x| x / unit));
        let a = norm(first);
        let x = first.map(|e| e / a);
        let b = dot(second, x);
        let height = sub(second, scale(b, x));
        let c = norm(height);
        let y = height.map(|e| e / c);
        Some(Self { axes: [x, y, cross(x, y)], a, b, c })
    }

    /// The rotation nearest to the map of this triangle's edges and unit normal to those of `pose` (polar decomposition).
    ///
    /// That map keeps the normal direction, so only its plane part G = E' E^-1 needs decomposing, and the rotation
    /// nearest to a 2 x 2 matrix turns by atan2(G21 - G12, G11 + G22).
    fn rotation_to(&self, pose: &Self) -> [[f64; 3]; 3] {
        let cos = pose.a * self.c + pose.c * self.a;
        let sin = pose.a * self.b - pose.b * self.a;
        let length = cos.hypot(sin);
        let (cos, sin) = (cos / length, sin / length);
        let [x, y, z] = pose.axes;
        let turned = [add(scale(cos, x), scale(sin, y)), sub(scale(cos, y), scale(sin, x)), z];
        std::array::from_fn(|i| {
            std::array::from_fn(|j| (0..3).map(|axis| turned[axis][i] * self.axes[axis][j]).sum())
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rotation::{IDENTITY, about_axis};

    const TRIANGLE: [Vector; 3] = [[0.1, 0.2, 0.3], [1.4, -0.2, 0.5], [0.6, 1.1, -0.4]];

    fn quaternion_between(from: [Vector; 3], to: [Vector; 3]) -> Quaternion {
        from_matrix(&Frame::of(from).expect("area").rotation_to(&Frame::of(to).expect("area")))
    }

    #[test]
    fn rotations_are_recovered_at_any_scale() {
        let q = product(about_axis(0, 2.9), about_axis(1, 1.0));
        for size in [1.0, 1e-300, 1e300] {
            let moved = TRIANGLE.map(|p| add(scale(size, rotate(q, p)), scale(size, [1.0, 2.0, 3.0])));
            let found = quaternion_between(TRIANGLE, moved);
            assert!(dot4(found, q).abs() > 1.0 - 1e-14, "{found:?} {q:?}");
        }
    }

    #[test]
    fn stretching_along_an_edge_does_not_rotate_but_shearing_does() {
        let flat = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        assert_eq!(quaternion_between(flat, flat.map(|p| [3.0 * p[0], 0.5 * p[1], 0.0])), IDENTITY);
        // Shear x += y: the polar factor turns by atan(-1/2).
        let sheared = quaternion_between(flat, flat.map(|p| [p[0] + p[1], p[1], 0.0]));
        let expected = about_axis(2, (-0.5f64).atan());
        assert!(sheared.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-15), "{sheared:?}");
    }

    fn strip(marks: &[(u32, u32)]) -> (TriangleMesh, Marks) {
        let positions =
            (0..8).map(|i| [f64::from(i / 2), f64::from(i % 2), 0.1 * f64::from(i * i)]).collect();
        let mesh = TriangleMesh::new(positions, (0..6).map(|i| [i, i + 1, i + 2]).collect()).expect("valid");
        let marks = Marks::new(&mesh, &mesh, marks).expect("usable");
        (mesh, marks)
    }

    #[test]
    fn signs_agree_whatever_the_order() {
        let order = [(0, 0), (2, 2), (4, 4)];
        let (mesh, forwards) = strip(&order);
        let (_, backwards) = strip(&[order[2], order[1], order[0]]);
        // Marks turn by 170, 190 and 200 degrees: "w >= 0" would tear them apart.
        let mut moved = mesh.positions().to_vec();
        let turn = |t: usize, degrees: f64, moved: &mut Vec<[f64; 3]>| {
            let q = about_axis(1, degrees.to_radians());
            for &v in &mesh.triangles()[t] {
                moved[v as usize] = rotate(q, mesh.positions()[v as usize]);
            }
        };
        turn(0, 170.0, &mut moved);
        turn(4, 200.0, &mut moved);
        let poses = |marks: &Marks| {
            let mut poses = [MarkPose::default(); 3];
            marks.pose(&moved, &mut poses).expect("finite");
            poses.map(|p| p.rotation)
        };
        let (a, mut b) = (poses(&forwards), poses(&backwards));
        b.reverse();
        let sign = dot4(a[0], b[0]).signum();
        for i in 0..3 {
            assert!((0..4).all(|c| (a[i][c] - sign * b[i][c]).abs() < 1e-14), "{a:?} {b:?}");
        }
        assert!(dot4(a[0], a[2]) > 0.9, "170 and 200 degrees are 30 degrees apart");
    }

    #[test]
    fn collapsed_triangles_take_the_mean_rotation_and_are_counted() {
        let (mesh, marks) = strip(&[(0, 0), (3, 3)]);
        let q = about_axis(2, 1.0);
        let mut moved: Vec<_> = mesh.positions().iter().map(|&p| rotate(q, p)).collect();
        let [a, b, c] = mesh.triangles()[3].map(|v| v as usize);
        moved[b] = moved[a];
        moved[c] = moved[a];
        let mut poses = [MarkPose::default(); 2];
        assert_eq!(marks.pose(&moved, &mut poses), Ok(1));
        assert!(dot4(poses[1].rotation, q).abs() > 1.0 - 1e-14);
        moved[c][1] = f64::INFINITY;
        assert_eq!(marks.pose(&moved, &mut poses), Err(SolveError::NonFinite { row: c }));
    }

    #[test]
    fn bad_pairs_are_named() {
        let mesh = TriangleMesh::new(
            vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [2.0, 0.0, 0.0]],
            vec![[0, 1, 2], [0, 1, 3]],
        )
        .expect("valid");
        let error = |pairs: &[(u32, u32)]| Marks::new(&mesh, &mesh, pairs).expect_err("not usable");
        assert_eq!(error(&[]), TransferError::NoMarks);
        let range = TransferError::OutOfRange { pair: 1, side: "target", triangle: 2, triangles: 2 };
        assert_eq!(error(&[(0, 0), (0, 2)]), range);
        assert_eq!(error(&[(1, 0)]), TransferError::ZeroArea { pair: 0, side: "template", triangle: 1 });
    }
}
