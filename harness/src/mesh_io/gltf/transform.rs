//! Placement of nodes.

use ::gltf::Node;
use ::gltf::scene;

/// An affine map p -> A p + t.
#[derive(Clone, Copy)]
pub struct Transform {
    /// The columns of A, then t.
    columns: [[f64; 3]; 4],
}

impl Transform {
    /// The map that changes nothing.
    pub const IDENTITY: Self =
        Self { columns: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]] };

    /// The transform of a node relative to its parent. Rotations are normalised: f32 quaternions are not of unit length.
    pub fn of(node: &Node<'_>) -> Self {
        match node.transform() {
            scene::Transform::Matrix { matrix } => {
                Self { columns: matrix.map(|column| [column[0], column[1], column[2]].map(f64::from)) }
            }
            scene::Transform::Decomposed { translation, rotation, scale } => {
                let mut columns = rotation_columns(rotation.map(f64::from));
                for (column, s) in columns.iter_mut().zip(scale) {
                    *column = column.map(|x| x * f64::from(s));
                }
                let [x, y, z] = columns;
                Self { columns: [x, y, z, translation.map(f64::from)] }
            }
        }
    }

    /// The transform of a node some of whose parts are animated: translation, rotation (x, y, z, w), scale.
    pub fn moved(node: &Node<'_>, parts: &[Option<Vec<f64>>; 3]) -> Self {
        let (translation, rotation, scale) = node.transform().decomposed();
        let part = |k: usize, own: &[f32]| {
            parts[k].clone().unwrap_or_else(|| own.iter().copied().map(f64::from).collect())
        };
        let (t, r, s) = (part(0, &translation), part(1, &rotation), part(2, &scale));
        let mut columns = rotation_columns([r[0], r[1], r[2], r[3]]);
        for (column, s) in columns.iter_mut().zip(s) {
            *column = column.map(|x| x * s);
        }
        let [x, y, z] = columns;
        Self { columns: [x, y, z, [t[0], t[1], t[2]]] }
    }

    /// The map of a 4 x 4 matrix by columns, the last row of which is (0, 0, 0, 1).
    pub fn of_matrix(m: &[f64; 16]) -> Self {
        Self { columns: [0, 1, 2, 3].map(|c| [m[4 * c], m[4 * c + 1], m[4 * c + 2]]) }
    }

    /// The map that applies `inner` first and then this one.
    pub fn then(&self, inner: &Self) -> Self {
        let [x, y, z, t] = inner.columns;
        Self { columns: [self.linear(x), self.linear(y), self.linear(z), self.apply(t)] }
    }

    /// A p + t.
    pub fn apply(&self, p: [f64; 3]) -> [f64; 3] {
        let linear = self.linear(p);
        [0, 1, 2].map(|i| linear[i] + self.columns[3][i])
    }

    /// Whether det A < 0: the map turns surfaces inside out.
    pub fn mirrors(&self) -> bool {
        let [x, y, z, _] = self.columns;
        let cross = [x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]];
        cross[0] * z[0] + cross[1] * z[1] + cross[2] * z[2] < 0.0
    }

    fn linear(&self, p: [f64; 3]) -> [f64; 3] {
        let [x, y, z, _] = self.columns;
        [0, 1, 2].map(|i| x[i] * p[0] + y[i] * p[1] + z[i] * p[2])
    }
}

/// The columns of the rotation matrix of a quaternion (x, y, z, w) of any length but 0.
fn rotation_columns([x, y, z, w]: [f64; 4]) -> [[f64; 3]; 3] {
    let s = 2.0 / (x * x + y * y + z * z + w * w);
    if !s.is_finite() {
        return [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    }
    [
        [1.0 - s * (y * y + z * z), s * (x * y + z * w), s * (x * z - y * w)],
        [s * (x * y - z * w), 1.0 - s * (x * x + z * z), s * (y * z + x * w)],
        [s * (x * z + y * w), s * (y * z - x * w), 1.0 - s * (x * x + y * y)],
    ]
}
