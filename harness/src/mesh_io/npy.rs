//! NumPy `.npy` arrays: frames (frames x vertices x 3) and columns (n x k).

use std::io::{self, Cursor, Write};
use std::panic::catch_unwind;
use std::path::Path;

use npyz::{DType, Endianness, NpyHeader, Order, TypeChar, WriterBuilder};

use crate::file::{self, Fault, FileError, Place};

/// A dense array in C order.
#[derive(Clone, Debug, PartialEq)]
pub struct Array {
    /// Length along each axis, the slowest first.
    pub shape: Vec<usize>,
    /// The values; `f4` files are widened.
    pub values: Vec<f64>,
}

/// Positions of the same vertices over time.
#[derive(Clone, Debug, PartialEq)]
pub struct Frames {
    vertices: usize,
    positions: Vec<[f64; 3]>,
}

impl Frames {
    /// Takes over positions, frame after frame.
    ///
    /// # Panics
    /// If `positions` is no multiple of `vertices`, or `vertices` is 0.
    pub fn new(vertices: usize, positions: Vec<[f64; 3]>) -> Self {
        assert!(positions.len().is_multiple_of(vertices), "frames: the same number of vertices in each");
        Self { vertices, positions }
    }

    /// Number of frames.
    pub fn len(&self) -> usize {
        self.positions.len() / self.vertices
    }

    /// Whether there is no frame.
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// Vertices of each frame.
    pub fn vertices(&self) -> usize {
        self.vertices
    }

    /// The positions of frame `k`.
    pub fn frame(&self, k: usize) -> &[[f64; 3]] {
        &self.positions[k * self.vertices..][..self.vertices]
    }

    /// The frames in order.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = &[[f64; 3]]> {
        self.positions.chunks_exact(self.vertices)
    }
}

/// Reads a `.npy` file of `<f4` or `<f8` in C order, any number of axes. All values must be finite.
///
/// # Errors
/// [`FileError`] naming the file and, for a value that is not finite, its position.
pub fn read(path: &Path) -> Result<Array, FileError> {
    parse(&file::read(path)?).map_err(|fault| fault.in_file(path))
}

/// Reads frames of shape (frames, `vertices`, 3).
///
/// # Errors
/// As [`read`], and for another shape.
pub fn read_frames(path: &Path, vertices: usize) -> Result<Frames, FileError> {
    let array = read(path)?;
    match array.shape[..] {
        [frames, n, 3] if n == vertices && n > 0 && frames > 0 => {
            Ok(Frames::new(vertices, array.values.as_chunks().0.to_vec()))
        }
        _ => {
            let problem = format!("has shape {:?}, expected (frames, {vertices}, 3)", array.shape);
            Err(Fault::new(problem, "the frames must have the vertices of the mesh they move").in_file(path))
        }
    }
}

/// Reads columns of shape (`n`, k), vertex-major; a one-dimensional array is one column. Returns k and the values.
///
/// # Errors
/// As [`read`], and for another shape.
pub fn read_columns(path: &Path, n: usize) -> Result<(usize, Vec<f64>), FileError> {
    let array = read(path)?;
    let k = match array.shape[..] {
        [rows] if rows == n => 1,
        [rows, k] if rows == n && k > 0 => k,
        _ => {
            let problem = format!("has shape {:?}, expected ({n}, k)", array.shape);
            return Err(Fault::new(problem, "give one row per vertex").in_file(path));
        }
    };
    Ok((k, array.values))
}

/// Reads the bytes of a `.npy` file, see [`read`]. Memory: twice the file for `<f4`.
///
/// # Errors
/// A fault naming what is not supported or the first value that is not finite.
pub fn parse(bytes: &[u8]) -> Result<Array, Fault> {
    let (header, start) = parse_header(bytes)?;
    if header.order() == Order::Fortran && header.shape().iter().filter(|&&n| n > 1).count() > 1 {
        return Err(Fault::new("is in Fortran order", "save numpy.ascontiguousarray(a)"));
    }
    let size = item_size(&header.dtype())?;
    let shape: Option<Vec<usize>> = header.shape().iter().map(|&n| usize::try_from(n).ok()).collect();
    let count = shape.as_ref().and_then(|shape| shape.iter().try_fold(1usize, |a, &n| a.checked_mul(n)));
    let data = &bytes[start..];
    let (Some(shape), Some(count)) = (shape, count.filter(|&n| n.checked_mul(size) == Some(data.len())))
    else {
        let problem = format!("has {} bytes of data, but its shape is {:?}", data.len(), header.shape());
        return Err(Fault::new(problem, "the file is cut off or damaged; save it again"));
    };
    let values: Vec<f64> = match size {
        4 => data.as_chunks().0.iter().map(|&x| f64::from(f32::from_le_bytes(x))).collect(),
        _ => data.as_chunks().0.iter().map(|&x| f64::from_le_bytes(x)).collect(),
    };
    debug_assert_eq!(values.len(), count);
    match values.iter().position(|x| !x.is_finite()) {
        None => Ok(Array { shape, values }),
        Some(at) => Err(Fault::at(Place::Element("value", at), "is NaN or infinite", "repair the data")),
    }
}

/// The header and where the data starts.
fn parse_header(bytes: &[u8]) -> Result<(NpyHeader, usize), Fault> {
    let broken = |why: String| Fault::new(format!("is no .npy file ({why})"), "save it with numpy.save");
    // Format version 1 has a 2-byte length of the header, versions 2 and 3 a 4-byte one; the crate reserves that much
    // before it reads, so the length is checked here.
    let promised = match bytes {
        [0x93, b'N', b'U', b'M', b'P', b'Y', 1, _, a, b, ..] => {
            10 + usize::from(u16::from_le_bytes([*a, *b]))
        }
        [0x93, b'N', b'U', b'M', b'P', b'Y', 2 | 3, _, a, b, c, d, ..] => {
            12 + u32::from_le_bytes([*a, *b, *c, *d]) as usize
        }
        _ => return Err(broken("it lacks the signature of version 1, 2 or 3".into())),
    };
    const HEADER_LIMIT: usize = 4096; // one is a few hundred bytes
    if promised > bytes.len().min(HEADER_LIMIT) {
        return Err(broken(format!(
            "its header of {promised} bytes is cut off or over {HEADER_LIMIT} bytes"
        )));
    }
    // The crate parses the header as a Python literal, recursively. A plain array's is a dictionary with one tuple.
    if bytes[..promised].iter().filter(|b| b"([{".contains(b)).count() > 2 {
        return Err(Fault::new("is no plain array", "save numpy.asarray(a, '<f8') or '<f4'"));
    }
    let header = catch_unwind(|| NpyHeader::from_reader(Cursor::new(&bytes[..promised])));
    match header {
        Ok(Ok(header)) => Ok((header, promised)),
        Ok(Err(error)) => Err(broken(error.to_string())),
        Err(_) => Err(broken("its header cannot be parsed".into())),
    }
}

fn item_size(dtype: &DType) -> Result<usize, Fault> {
    let unsupported =
        || Fault::new(format!("has element type {}", dtype.descr()), "save numpy.asarray(a, '<f8') or '<f4'");
    let DType::Plain(plain) = dtype else { return Err(unsupported()) };
    let size = plain.size_field();
    let little = plain.endianness() == Endianness::Little;
    if plain.type_char() == TypeChar::Float && little && (size == 4 || size == 8) {
        Ok(size as usize)
    } else {
        Err(unsupported())
    }
}

/// Writes an `n x k` array of float64 in C order, atomically.
///
/// # Errors
/// [`FileError`] when the file cannot be written.
///
/// # Panics
/// If `values` is no multiple of `k`.
pub fn write_columns(path: &Path, values: &[f64], k: usize) -> Result<(), FileError> {
    assert!(values.len().is_multiple_of(k), "values: k in each row");
    write(path, &[values.len() / k, k], values)
}

/// Writes an array of float64 in C order, atomically.
///
/// # Errors
/// [`FileError`] when the file cannot be written.
///
/// # Panics
/// If the shape does not hold as many values.
pub fn write(path: &Path, shape: &[usize], values: &[f64]) -> Result<(), FileError> {
    assert_eq!(shape.iter().product::<usize>(), values.len(), "shape: of the values");
    file::write_atomically(path, |out| write_to(out, shape, values))
}

fn write_to(out: &mut dyn Write, shape: &[usize], values: &[f64]) -> io::Result<()> {
    let shape: Vec<u64> = shape.iter().map(|&n| n as u64).collect();
    let mut writer = npyz::WriteOptions::new().default_dtype().shape(&shape).writer(out).begin_nd()?;
    writer.extend(values)?;
    writer.finish()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(header: &str, data: &[u8]) -> Vec<u8> {
        let length = (header.len() as u16).to_le_bytes();
        [b"\x93NUMPY\x01\x00", &length[..], header.as_bytes(), data].concat()
    }

    #[test]
    fn floats_of_both_sizes() {
        let header = "{'descr': '<f4', 'fortran_order': False, 'shape': (2, 1), }\n";
        let read = parse(&file(header, &[0.5f32.to_le_bytes(), (-2f32).to_le_bytes()].concat())).unwrap();
        assert_eq!(read, Array { shape: vec![2, 1], values: vec![0.5, -2.0] });
        let mut bytes = Vec::new();
        write_to(&mut bytes, &[1, 3], &[0.1, -0.0, 1e-300]).unwrap();
        assert_eq!(parse(&bytes).unwrap(), Array { shape: vec![1, 3], values: vec![0.1, -0.0, 1e-300] });
    }

    #[test]
    fn what_is_not_supported_is_named() {
        let nested = format!("{{'descr': {}", "(".repeat(4000));
        for (header, data, part) in [
            ("{'descr': '>f8', 'fortran_order': False, 'shape': (1,), }", &[0; 8][..], "element type"),
            ("{'descr': '<i8', 'fortran_order': False, 'shape': (1,), }", &[0; 8], "element type"),
            ("{'descr': '<f4', 'fortran_order': True, 'shape': (2, 2), }", &[0; 16], "Fortran"),
            (
                "{'descr': '<f8', 'fortran_order': False, 'shape': (4000000000, 4000000000, 3), }",
                &[0; 8],
                "shape",
            ),
            ("{'descr': '<f8', 'fortran_order': False, 'shape': (2,), }", &[0; 8], "8 bytes"),
            ("{'descr': '<f8', 'fortran_order': False, 'shape': (1,), }", &[255; 8], "value 0"),
            ("{'descr': '<f8', 'shape': (1,), }", &[0; 8], "no .npy file"),
            (&nested, &[0; 8], "no plain array"),
        ] {
            let fault = parse(&file(header, data)).unwrap_err();
            assert!(fault.to_string().contains(part), "{fault}");
        }
        assert!(parse(b"\x93NUMPY\x02\x00\xff\xff\xff\xff{}").is_err());
    }
}
