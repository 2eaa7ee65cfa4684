//! What is written reads back: every bit of any finite number, in every format.

use lapbench::mesh_io::matrix_market::{self, Symmetry};
use lapbench::mesh_io::{npy, read_mesh, table, write_mesh};
use lapsolve::mesh::TriangleMesh;
use lapsolve::sparse::SymmetricCsr;
use proptest::prelude::*;

fn finite() -> impl Strategy<Value = f64> {
    use prop::num::f64::{NEGATIVE, NORMAL, POSITIVE, SUBNORMAL, ZERO};
    POSITIVE | NEGATIVE | NORMAL | SUBNORMAL | ZERO
}

fn bits(values: &[f64]) -> Vec<u64> {
    values.iter().map(|x| x.to_bits()).collect()
}

prop_compose! {
    fn mesh()(n in 1u32..40)(
        positions in prop::collection::vec(prop::array::uniform3(finite()), n as usize),
        triangles in prop::collection::vec(prop::array::uniform3(0..n), 1..60),
    ) -> TriangleMesh {
        TriangleMesh::new(positions, triangles).expect("finite and in range")
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn meshes(mesh in mesh()) {
        let folder = tempfile::tempdir().unwrap();
        for name in ["a.ply", "a.obj"] {
            let path = folder.path().join(name);
            write_mesh(&path, &mesh).unwrap();
            let read = read_mesh(&path).unwrap().mesh;
            prop_assert_eq!(read.triangles(), mesh.triangles());
            prop_assert_eq!(bits(read.positions().as_flattened()), bits(mesh.positions().as_flattened()));
        }
    }

    #[test]
    fn columns(rows in prop::collection::vec(prop::array::uniform2(finite()), 1..50)) {
        let folder = tempfile::tempdir().unwrap();
        let values = rows.as_flattened();
        npy::write_columns(&folder.path().join("a.npy"), values, 2).unwrap();
        let (k, read) = npy::read_columns(&folder.path().join("a.npy"), rows.len()).unwrap();
        prop_assert_eq!((k, bits(&read)), (2, bits(values)));
        table::write_columns(&folder.path().join("a.csv"), values, 2).unwrap();
        let text = std::fs::read_to_string(folder.path().join("a.csv")).unwrap();
        let read: Vec<f64> = text.split([',', '\n']).filter_map(|x| x.parse().ok()).collect();
        prop_assert_eq!(bits(&read), bits(values));
    }

    #[test]
    fn matrices(n in 1u32..12, entries in prop::collection::btree_map((0u32..12, 0u32..12), finite(), 0..40)) {
        let upper: Vec<_> =
            entries.into_iter().filter(|((i, j), _)| i <= j && *j < n).map(|((i, j), value)| (i, j, value + 0.0)).collect();
        let matrix = SymmetricCsr::from_triplets(n as usize, &upper).unwrap();
        let folder = tempfile::tempdir().unwrap();
        for symmetry in [Symmetry::Symmetric, Symmetry::General] {
            matrix_market::write(&folder.path().join("a.mtx"), &matrix, symmetry).unwrap();
            prop_assert_eq!(&matrix_market::read(&folder.path().join("a.mtx")).unwrap(), &matrix);
        }
    }
}
