//! A surface with a boundary, of any size.

use lapsolve::mesh::TriangleMesh;

/// A bumpy sheet of `side` x `side` vertices.
pub fn sheet(side: u32) -> TriangleMesh {
    let place = |i: u32| (f64::from(i % side), f64::from(i / side));
    let positions = (0..side * side).map(place).map(|(x, y)| [x, y, (0.3 * x * y).sin()]).collect();
    let corner = |i: u32| i % (side - 1) + i / (side - 1) * side;
    let squares = (0..(side - 1) * (side - 1)).map(corner);
    let triangles = squares.flat_map(|i| [[i, i + 1, i + side], [i + 1, i + side + 1, i + side]]).collect();
    TriangleMesh::new(positions, triangles).expect("valid")
}
