//! The readers by the folder of the corpus they belong to.

use std::path::Path;

use lapbench::animation::bvh;
use lapbench::file::{Fault, FileError};
use lapbench::mesh_io::{
    Finding, Format, matrix_market, npy, parse_animation, parse_mesh, read_animation, read_mesh, table,
};
use lapsolve::topology::Topology;

/// Vertices of the mesh that constraints are read for, and triangles on both sides of pairs.
const SIZE: usize = 8;

/// One reader, from a file and from bytes.
pub struct Reader {
    /// Its folder in the corpus.
    pub folder: &'static str,
    /// Reads a file; what was found in it.
    pub read: fn(&Path) -> Result<Vec<Finding>, FileError>,
    /// Reads bytes and examines the result.
    pub parse: fn(&[u8]) -> Result<(), Fault>,
}

/// All readers.
pub const READERS: [Reader; 11] = [
    Reader { folder: "ply", read: mesh, parse: |bytes| mesh_bytes(bytes, Format::Ply) },
    Reader { folder: "obj", read: mesh, parse: |bytes| mesh_bytes(bytes, Format::Obj) },
    Reader { folder: "off", read: mesh, parse: |bytes| mesh_bytes(bytes, Format::Off) },
    Reader { folder: "stl", read: mesh, parse: |bytes| mesh_bytes(bytes, Format::Stl) },
    Reader { folder: "gltf", read: mesh, parse: |bytes| mesh_bytes(bytes, Format::Gltf) },
    Reader {
        folder: "gltf_animation",
        read: |path| read_animation(path, &read_mesh(path)?.mesh).map(|_| vec![]),
        parse: |bytes| parse_animation(bytes, None).map(|(frames, _)| assert!(!frames.is_empty())),
    },
    Reader {
        folder: "bvh",
        read: |path| bvh::read(path).map(|_| vec![]),
        parse: |bytes| {
            bvh::parse(bytes).map(|clip| {
                assert!(!clip.is_empty() && clip.values.len() == clip.len() * clip.channels());
                clip.place(clip.len() - 1);
            })
        },
    },
    Reader {
        folder: "npy",
        read: |path| npy::read(path).map(|_| vec![]),
        parse: |bytes| npy::parse(bytes).map(|array| assert!(array.values.iter().all(|x| x.is_finite()))),
    },
    Reader {
        folder: "constraints",
        read: |path| table::read_constraints(path, SIZE).map(|_| vec![]),
        parse: |bytes| {
            table::parse_constraints(bytes, SIZE).map(|read| {
                assert!(
                    read.vertices.is_sorted_by(|a, b| a < b)
                        && read.vertices.iter().all(|&v| (v as usize) < SIZE)
                );
                assert_eq!(read.values.len(), read.k * read.vertices.len());
            })
        },
    },
    Reader {
        folder: "pairs",
        read: |path| table::read_pairs(path, [SIZE, SIZE]).map(|_| vec![]),
        parse: |bytes| {
            let pairs = table::parse_pairs(bytes, [SIZE, SIZE])?;
            assert!(pairs.as_flattened().iter().all(|&index| (index as usize) < SIZE));
            Ok(())
        },
    },
    Reader {
        folder: "matrix_market",
        read: |path| matrix_market::read(path).map(|_| vec![]),
        parse: |bytes| matrix_market::parse(bytes).map(|read| assert!(read.infinity_norm() >= 0.0)),
    },
];

fn mesh(path: &Path) -> Result<Vec<Finding>, FileError> {
    Ok(read_mesh(path)?.notes.iter().map(|note| note.finding).collect())
}

fn mesh_bytes(bytes: &[u8], named: Format) -> Result<(), Fault> {
    let (mesh, _) = parse_mesh(bytes, Some(named), None)?;
    let report = Topology::of(&mesh);
    assert!(report.components <= mesh.triangles().len());
    Ok(())
}
