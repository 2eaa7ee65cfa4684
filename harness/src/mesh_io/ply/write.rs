//! Writes binary PLY.

use std::io::{self, Write};

use lapsolve::mesh::TriangleMesh;

/// Writes `binary_little_endian 1.0` with `double` positions and `int` indices: every bit of the mesh.
///
/// # Errors
/// Those of `out`.
pub fn write(mesh: &TriangleMesh, out: &mut dyn Write) -> io::Result<()> {
    write!(
        out,
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty double x\nproperty double y\n\
         property double z\nelement face {}\nproperty list uchar int vertex_indices\nend_header\n",
        mesh.positions().len(),
        mesh.triangles().len()
    )?;
    for x in mesh.positions().as_flattened() {
        out.write_all(&x.to_le_bytes())?;
    }
    for triangle in mesh.triangles() {
        let mut row = [3; 13]; // the length of the list, then three indices below 2^31
        for (slot, vertex) in row[1..].chunks_exact_mut(4).zip(triangle) {
            slot.copy_from_slice(&vertex.to_le_bytes());
        }
        out.write_all(&row)?;
    }
    Ok(())
}
