//! Binary glTF 2.0 with one morph target per frame.
//!
//! Positions of every frame are displacements from the reference pose, 32-bit floats; an animation blends linearly from one
//! frame's target to the next. Normals are left out, so that viewers compute those of each pose themselves.

use super::sink::not_writable;
use crate::file::{self, Fault, FileError};
use lapsolve::mesh::TriangleMesh;
use lapsolve::vector::{Vector, sub};
use serde_json::{Value, json};
use std::fs::File;
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// Largest GLB file: its length is a 32-bit number.
const LARGEST: u64 = u32::MAX as u64;

/// A GLB file in the making. Frames go to a temporary file; the file itself appears when all are there.
pub struct GlbWriter {
    path: PathBuf,
    rest: Vec<Vector>,
    triangles: usize,
    rate: f64,
    bin: BufWriter<File>,
    /// Lowest and highest displacement of each frame.
    bounds: Vec<[[f32; 3]; 2]>,
    rest_bounds: [[f32; 3]; 2],
    expected: usize,
}

impl GlbWriter {
    /// A file for `frames` frames of `mesh` at `rate` frames per second.
    ///
    /// # Errors
    /// [`FileError`] where the folder is not writable or the file would exceed 4 GiB.
    pub fn new(path: &Path, mesh: &TriangleMesh, frames: usize, rate: f64) -> Result<Self, FileError> {
        let bytes = 12
            * (mesh.triangles().len() as u64 + (frames as u64 + 1) * mesh.positions().len() as u64)
            + 4 * frames as u64 * (frames as u64 + 1);
        if bytes + bytes / 100 > LARGEST {
            let problem = format!("would have {} MB, and GLB files end at 4 GiB", bytes >> 20);
            let remedy = "take fewer frames (--every), or name a folder for PLY files";
            return Err(Fault::new(problem, remedy).in_file(path));
        }
        let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let bin = tempfile::tempfile_in(folder).map_err(|e| not_writable(path, &e))?;
        let mut writer = Self {
            path: path.to_owned(),
            rest: mesh.positions().to_vec(),
            triangles: mesh.triangles().len(),
            rate,
            bin: BufWriter::with_capacity(1 << 20, bin),
            bounds: Vec::with_capacity(frames),
            rest_bounds: [[0.0; 3]; 2],
            expected: frames,
        };
        let begin = |writer: &mut Self| -> io::Result<()> {
            for corner in mesh.triangles().as_flattened() {
                writer.bin.write_all(&corner.to_le_bytes())?;
            }
            writer.rest_bounds = write_points(&mut writer.bin, mesh.positions().iter().copied())?;
            Ok(())
        };
        begin(&mut writer).map_err(|e| not_writable(path, &e))?;
        Ok(writer)
    }

    /// The next frame.
    ///
    /// # Errors
    /// [`FileError`] for a full disk.
    ///
    /// # Panics
    /// If `positions` has not one entry per vertex.
    pub fn push(&mut self, positions: &[Vector]) -> Result<(), FileError> {
        assert_eq!(positions.len(), self.rest.len(), "positions: one per vertex");
        let displaced = positions.iter().zip(&self.rest).map(|(&p, &rest)| sub(p, rest));
        let bounds = write_points(&mut self.bin, displaced).map_err(|e| not_writable(&self.path, &e))?;
        self.bounds.push(bounds);
        Ok(())
    }

    /// Writes the file.
    ///
    /// # Errors
    /// [`FileError`] for a full disk.
    ///
    /// # Panics
    /// If a frame is missing.
    pub fn finish(mut self) -> Result<(), FileError> {
        assert_eq!(self.bounds.len(), self.expected, "as many frames as announced");
        let failed = |e: io::Error| not_writable(&self.path, &e);
        let frames = self.bounds.len();
        for k in 0..frames {
            self.bin.write_all(&((k as f64 / self.rate) as f32).to_le_bytes()).map_err(failed)?;
        }
        let mut weights = vec![0u8; 4 * frames];
        for k in 0..frames {
            weights.fill(0);
            weights[4 * k..4 * k + 4].copy_from_slice(&1f32.to_le_bytes());
            self.bin.write_all(&weights).map_err(failed)?;
        }
        let length = self.bin.stream_position().map_err(failed)?;
        let mut json = self.document(length).to_string().into_bytes();
        json.resize(json.len().next_multiple_of(4), b' ');
        let Self { path, bin, .. } = self;
        let mut bin = bin.into_inner().map_err(|e| not_writable(&path, e.error()))?;
        file::write_atomically(&path, |out| {
            let total = 12 + 8 + json.len() as u64 + 8 + length;
            out.write_all(b"glTF")?;
            for word in [2, total as u32, json.len() as u32] {
                out.write_all(&word.to_le_bytes())?;
            }
            out.write_all(b"JSON")?;
            out.write_all(&json)?;
            out.write_all(&(length as u32).to_le_bytes())?;
            out.write_all(b"BIN\0")?;
            bin.seek(SeekFrom::Start(0))?;
            io::copy(&mut bin, out).map(|_| ())
        })
    }

    /// The JSON part.
    fn document(&self, length: u64) -> Value {
        const FLOAT: u32 = 5126;
        const UNSIGNED: u32 = 5125;
        let (n, m, frames) = (self.rest.len(), self.triangles, self.bounds.len());
        let (mut views, mut accessors, mut offset) = (Vec::new(), Vec::new(), 0u64);
        let mut array = |count: usize,
                         kind: &str,
                         component: u32,
                         target: Option<u32>,
                         bounds: Option<[Value; 2]>| {
            let numbers = if kind == "VEC3" { 3 } else { 1 };
            let bytes = 4 * numbers * count as u64;
            let mut view = json!({"buffer": 0, "byteOffset": offset, "byteLength": bytes});
            if let Some(target) = target {
                view["target"] = target.into();
            }
            let mut accessor =
                json!({"bufferView": views.len(), "componentType": component, "count": count, "type": kind});
            if let Some([low, high]) = bounds {
                (accessor["min"], accessor["max"]) = (low, high);
            }
            offset += bytes;
            views.push(view);
            accessors.push(accessor);
            accessors.len() - 1
        };
        const ARRAY: Option<u32> = Some(34962);
        const ELEMENTS: Option<u32> = Some(34963);
        let of = |bounds: &[[f32; 3]; 2]| Some(bounds.map(|b| json!(b)));
        let indices = array(3 * m, "SCALAR", UNSIGNED, ELEMENTS, None);
        let rest = array(n, "VEC3", FLOAT, ARRAY, of(&self.rest_bounds));
        let targets: Vec<Value> = self
            .bounds
            .iter()
            .map(|bounds| json!({"POSITION": array(n, "VEC3", FLOAT, ARRAY, of(bounds))}))
            .collect();
        let last = (frames.saturating_sub(1) as f64 / self.rate) as f32;
        let times = array(frames, "SCALAR", FLOAT, None, Some([json!([0.0]), json!([last])]));
        let weights = array(frames * frames, "SCALAR", FLOAT, None, None);
        json!({
            "asset": {"version": "2.0", "generator": concat!("lapbench ", env!("CARGO_PKG_VERSION"))},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0}],
            "materials": [{
                "doubleSided": true,
                "pbrMetallicRoughness": {"baseColorFactor": [0.6, 0.48, 0.39, 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.8},
            }],
            "meshes": [{
                "primitives": [{"attributes": {"POSITION": rest}, "indices": indices, "material": 0, "targets": targets}],
                "weights": vec![0.0; frames],
            }],
            "animations": [{
                "channels": [{"sampler": 0, "target": {"node": 0, "path": "weights"}}],
                "samplers": [{"input": times, "output": weights, "interpolation": "LINEAR"}],
            }],
            "accessors": accessors,
            "bufferViews": views,
            "buffers": [{"byteLength": length}],
        })
    }
}

/// Writes points as three floats each; their lowest and highest coordinates as written.
fn write_points(out: &mut impl Write, points: impl Iterator<Item = Vector>) -> io::Result<[[f32; 3]; 2]> {
    let mut bounds = [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]];
    for point in points {
        for (i, x) in point.map(|x| x as f32).into_iter().enumerate() {
            bounds[0][i] = bounds[0][i].min(x);
            bounds[1][i] = bounds[1][i].max(x);
            out.write_all(&x.to_le_bytes())?;
        }
    }
    Ok(bounds)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_independent_reader_finds_every_frame() {
        let mesh = crate::mesh_source::load("sphere:1").unwrap().mesh;
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.glb");
        let frame = |k: usize| -> Vec<Vector> {
            mesh.positions().iter().map(|&[x, y, z]| [x + k as f64, 2.0 * y, z]).collect()
        };
        let mut writer = GlbWriter::new(&path, &mesh, 3, 10.0).unwrap();
        (0..3).for_each(|k| writer.push(&frame(k)).unwrap());
        assert!(!path.exists(), "nothing before all is there");
        writer.finish().unwrap();
        let (document, blob) = {
            let gltf = ::gltf::Gltf::open(&path).unwrap();
            (gltf.document, gltf.blob.unwrap())
        };
        let primitive = document.meshes().next().unwrap().primitives().next().unwrap();
        let reader = primitive.reader(|_| Some(&blob));
        let rest: Vec<[f32; 3]> = reader.read_positions().unwrap().collect();
        let indices: Vec<u32> = reader.read_indices().unwrap().into_u32().collect();
        assert_eq!(indices, mesh.triangles().as_flattened());
        for (k, (displacements, _, _)) in reader.read_morph_targets().enumerate() {
            let moved: Vec<[f32; 3]> = displacements.unwrap().collect();
            for ((p, d), expected) in rest.iter().zip(&moved).zip(frame(k)) {
                assert!((0..3).all(|i| (f64::from(p[i] + d[i]) - expected[i]).abs() < 1e-5));
            }
        }
        let animation = document.animations().next().unwrap();
        let channel = animation.channels().next().unwrap().reader(|_| Some(&blob));
        assert_eq!(channel.read_inputs().unwrap().collect::<Vec<f32>>(), [0.0, 0.1, 0.2]);
        let ::gltf::animation::util::ReadOutputs::MorphTargetWeights(weights) =
            channel.read_outputs().unwrap()
        else {
            panic!("weights expected")
        };
        let weights: Vec<f32> = weights.into_f32().collect();
        assert_eq!(weights, [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
        // And this program's own reader takes it as a mesh.
        assert_eq!(crate::mesh_io::read_mesh(&path).unwrap().mesh.triangles(), mesh.triangles());
    }

    #[test]
    fn too_much_is_refused_before_anything_is_written() {
        let mesh = crate::mesh_source::load("sphere:1").unwrap().mesh;
        let folder = tempfile::tempdir().unwrap();
        let error = GlbWriter::new(&folder.path().join("a.glb"), &mesh, 10_000_000, 30.0).err().unwrap();
        assert!(error.to_string().contains("--every"), "{error}");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
