//! Raw arrays in files: how the parent and its children exchange matrices, right-hand sides and solutions.
//!
//! Little-endian numbers, nothing else; the shape travels in the protocol message. Any language reads them in one line
//! (`numpy.fromfile`, `fread`), and they can be mapped.

use serde::{Deserialize, Serialize};
use std::fs::File;
use std::io::{self, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// A block of `rows` x `columns` numbers in a file, row after row. Whether they are f64 or u32 is fixed by the member
/// of the message that names the file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ArrayFile {
    /// Where it is.
    pub path: PathBuf,
    /// Number of rows.
    pub rows: usize,
    /// Numbers per row.
    pub columns: usize,
}

/// A number with a fixed little-endian form.
pub trait Number: Copy + Default {
    /// Bytes per number.
    const BYTES: usize;
    /// The number in the first [`BYTES`](Self::BYTES) bytes.
    fn decode(bytes: &[u8]) -> Self;
    /// Appends its bytes.
    fn encode(self, bytes: &mut Vec<u8>);
}

macro_rules! number {
    ($type:ty) => {
        impl Number for $type {
            const BYTES: usize = size_of::<$type>();
            fn decode(bytes: &[u8]) -> Self {
                let mut own = [0; size_of::<$type>()];
                own.copy_from_slice(&bytes[..size_of::<$type>()]);
                Self::from_le_bytes(own)
            }
            fn encode(self, bytes: &mut Vec<u8>) {
                bytes.extend_from_slice(&self.to_le_bytes());
            }
        }
    };
}
number!(f64);
number!(u32);

/// Bytes converted at a time: fits the second-level cache.
const CHUNK: usize = 1 << 16;

impl ArrayFile {
    /// Writes `data` (rows x columns) to `path`.
    ///
    /// # Errors
    /// Those of the file system.
    ///
    /// # Panics
    /// If `data` is no multiple of `columns`.
    pub fn write<T: Number>(path: &Path, data: &[T], columns: usize) -> io::Result<Self> {
        assert!(columns > 0 && data.len().is_multiple_of(columns), "data: whole rows of {columns}");
        let mut file = BufWriter::with_capacity(CHUNK, File::create(path)?);
        let mut bytes = Vec::with_capacity(CHUNK);
        for block in data.chunks(CHUNK / T::BYTES) {
            bytes.clear();
            block.iter().for_each(|x| x.encode(&mut bytes));
            file.write_all(&bytes)?;
        }
        file.flush()?;
        Ok(Self { path: path.to_owned(), rows: data.len() / columns, columns })
    }

    /// All numbers. The file must hold exactly as many as the shape says; that is checked before memory is taken.
    ///
    /// # Errors
    /// Those of the file system, and `InvalidData` naming both sizes.
    pub fn read<T: Number>(&self) -> io::Result<Vec<T>> {
        let mut data = Vec::new();
        self.read_rows_into(0, self.rows, &mut data)?;
        Ok(data)
    }

    /// Rows `first .. first + count` into `data`, replacing its content and keeping its memory.
    ///
    /// # Errors
    /// As [`read`](Self::read).
    pub fn read_rows_into<T: Number>(&self, first: usize, count: usize, data: &mut Vec<T>) -> io::Result<()> {
        let mut file = File::open(&self.path)?;
        let row = (self.columns as u64).checked_mul(T::BYTES as u64);
        let expected = row.and_then(|row| row.checked_mul(self.rows as u64));
        let found = file.metadata()?.len();
        if expected != Some(found) || first.checked_add(count).is_none_or(|end| end > self.rows) {
            let problem = format!(
                "{}: {found} bytes do not hold rows {first} to {first} + {count} of {} x {} numbers of {} bytes",
                self.path.display(),
                self.rows,
                self.columns,
                T::BYTES
            );
            return Err(io::Error::new(io::ErrorKind::InvalidData, problem));
        }
        file.seek(SeekFrom::Start(row.unwrap_or(0) * first as u64))?;
        data.clear();
        let total = count * self.columns;
        data.try_reserve_exact(total).map_err(io::Error::other)?;
        let mut bytes = [0; CHUNK];
        while data.len() < total {
            let part = &mut bytes[..CHUNK.min((total - data.len()) * T::BYTES)];
            file.read_exact(part)?;
            data.extend(part.chunks_exact(T::BYTES).map(T::decode));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn comes_back_bit_for_bit() {
        let folder = tempfile::tempdir().unwrap();
        let data: Vec<f64> = (0..30_000).map(|i| f64::from(i).sin()).collect();
        let file = ArrayFile::write(&folder.path().join("a"), &data, 3).unwrap();
        assert_eq!(file.rows, 10_000);
        assert_eq!(file.read::<f64>().unwrap(), data);
        let mut some: Vec<f64> = Vec::new();
        file.read_rows_into(9_998, 2, &mut some).unwrap();
        assert_eq!(some, data[29_994..]);
    }

    #[test]
    fn a_false_shape_costs_no_memory() {
        let folder = tempfile::tempdir().unwrap();
        let file = ArrayFile::write(&folder.path().join("a"), &[1u32, 2, 3], 1).unwrap();
        for rows in [2, 4, usize::MAX] {
            let lie = ArrayFile { rows, ..file.clone() };
            assert_eq!(lie.read::<u32>().unwrap_err().kind(), io::ErrorKind::InvalidData);
        }
        assert!(file.read_rows_into(usize::MAX, 2, &mut Vec::<u32>::new()).is_err());
    }
}
