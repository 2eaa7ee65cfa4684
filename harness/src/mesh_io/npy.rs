//! NumPy `.npy` arrays of floats.
//!
//! Own reader and writer instead of a crate: what is needed of the format fits one page, and parsers of its header, a
//! Python literal, recurse and multiply whatever a file asks for.

use std::io::{self, Write};
use std::path::Path;

use super::text::shown;
use crate::file::{self, Fault, FileError, Place};

const MAGIC: &[u8] = b"\x93NUMPY";

/// A dense array in C order.
#[derive(Clone, Debug, PartialEq)]
pub struct Array {
    /// Length along each axis, the slowest first.
    pub shape: Vec<usize>,
    /// The values; `f4` files are widened.
    pub values: Vec<f64>,
}

/// Reads a `.npy` file of `<f4` or `<f8` in C order, any number of axes. All values must be finite.
///
/// # Errors
/// [`FileError`] naming the file and, for a value that is not finite, its position.
pub fn read(path: &Path) -> Result<Array, FileError> {
    parse(&file::read(path)?).map_err(|fault| fault.in_file(path))
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
    let (header, data) = split(bytes)?;
    let header = Header::parse(header)?;
    if header.fortran_order && header.shape.iter().filter(|&&n| n > 1).count() > 1 {
        return Err(Fault::new("is in Fortran order", "save numpy.ascontiguousarray(a)"));
    }
    let size = match header.descr {
        "<f4" => 4,
        "<f8" => 8,
        other => {
            let problem = format!("has element type '{}'", shown(other.as_bytes()));
            return Err(Fault::new(problem, "save numpy.asarray(a, '<f8') or '<f4'"));
        }
    };
    if header.bytes(size) != Some(data.len()) {
        let problem = format!("has {} bytes of data, but its shape is {:?}", data.len(), header.shape);
        return Err(Fault::new(problem, "the file is cut off or damaged; save it again"));
    }
    let values: Vec<f64> = match size {
        4 => data.as_chunks().0.iter().map(|&x| f64::from(f32::from_le_bytes(x))).collect(),
        _ => data.as_chunks().0.iter().map(|&x| f64::from_le_bytes(x)).collect(),
    };
    match values.iter().position(|x| !x.is_finite()) {
        None => Ok(Array { shape: header.shape, values }),
        Some(at) => Err(Fault::at(Place::Element("value", at), "is NaN or infinite", "repair the data")),
    }
}

fn broken(why: &str) -> Fault {
    Fault::new(format!("is no .npy file ({why})"), "save it with numpy.save")
}

/// Header and data. Format version 1 has a 2-byte length of the header, versions 2 and 3 a 4-byte one.
fn split(bytes: &[u8]) -> Result<(&[u8], &[u8]), Fault> {
    let rest = bytes.strip_prefix(MAGIC).ok_or_else(|| broken("it lacks the signature"))?;
    let (length, rest) = match *rest {
        [1, _, a, b, ref rest @ ..] => (usize::from(u16::from_le_bytes([a, b])), rest),
        [2 | 3, _, a, b, c, d, ref rest @ ..] => (u32::from_le_bytes([a, b, c, d]) as usize, rest),
        _ => return Err(broken("its version is not 1, 2 or 3")),
    };
    rest.split_at_checked(length).ok_or_else(|| broken("its header is cut off"))
}

/// What the header says: `{'descr': '<f8', 'fortran_order': False, 'shape': (2, 3), }`.
struct Header<'a> {
    descr: &'a str,
    fortran_order: bool,
    shape: Vec<usize>,
}

impl<'a> Header<'a> {
    fn parse(bytes: &'a [u8]) -> Result<Self, Fault> {
        let text = std::str::from_utf8(bytes).map_err(|_| broken("its header is no text"))?;
        let value = |key: &str| {
            let at = text
                .find(&format!("'{key}':"))
                .ok_or_else(|| broken(&format!("its header lacks '{key}'")))?;
            Ok(text[at + key.len() + 3..].trim_start())
        };
        let quoted = value("descr")?.strip_prefix('\'').and_then(|descr| descr.split_once('\''));
        let (descr, _) = quoted.ok_or_else(|| {
            Fault::new("is no plain array of numbers", "save numpy.asarray(a, '<f8') or '<f4'")
        })?;
        let fortran_order = value("fortran_order")?.starts_with("True");
        let tuple = value("shape")?.strip_prefix('(').and_then(|shape| shape.split_once(')'));
        let (tuple, _) = tuple.ok_or_else(|| broken("its shape is no tuple"))?;
        let lengths = tuple.split(',').map(str::trim).filter(|length| !length.is_empty());
        let shape: Result<_, _> = lengths.map(str::parse).collect();
        Ok(Self {
            descr,
            fortran_order,
            shape: shape.map_err(|_| broken("its shape holds no whole numbers"))?,
        })
    }

    /// Bytes of all items of `size` bytes, unless the product overflows.
    fn bytes(&self, size: usize) -> Option<usize> {
        self.shape.iter().try_fold(size, |bytes, &n| bytes.checked_mul(n))
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
    // A tuple of one needs its comma.
    let tuple: String = shape.iter().map(|n| format!("{n}, ")).collect();
    let header = format!("{{'descr': '<f8', 'fortran_order': False, 'shape': ({}), }}", tuple.trim_end());
    // NumPy wants the data at a multiple of 64 bytes and a line end before it.
    let before = MAGIC.len() + 4;
    let length = (before + header.len() + 1).next_multiple_of(64) - before;
    out.write_all(MAGIC)?;
    out.write_all(&[1, 0])?;
    out.write_all(&(length as u16).to_le_bytes())?; // a shape of more than a thousand axes is not written here
    writeln!(out, "{header:<width$}", width = length - 1)?;
    for value in values {
        out.write_all(&value.to_le_bytes())?;
    }
    Ok(())
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
            ("{'descr': '<f8', 'shape': (1,), }", &[0; 8], "lacks 'fortran_order'"),
            (&nested, &[0; 8], "no plain array"),
        ] {
            let fault = parse(&file(header, data)).unwrap_err();
            assert!(fault.to_string().contains(part), "{fault}");
        }
        assert!(parse(b"\x93NUMPY\x02\x00\xff\xff\xff\xff{}").is_err());
    }
}
