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
