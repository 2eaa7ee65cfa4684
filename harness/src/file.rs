//! Whole files, read with a size limit and written atomically, with errors that name file, place and remedy.

use std::fmt;
use std::fs::File;
use std::io::{self, BufWriter, Read, Write};
use std::path::{Path, PathBuf};

use thiserror::Error;

/// Largest input file that is read: 4 GiB, room for 150 million triangles in a binary format. Readers hold the whole
/// file and a result of at most about eight times its size, so this bounds their memory.
pub const MAX_FILE_BYTES: u64 = 4 << 30;

/// A file that cannot be used: which one, where in it, what is wrong, what to do about it.
#[derive(Debug, Error)]
#[error("{}: {fault}", path.display())]
pub struct FileError {
    /// The file.
    pub path: PathBuf,
    /// What is wrong with it.
    pub fault: Fault,
}

/// What is wrong with the content of a file; a [`FileError`] without the file's name.
#[derive(Clone, Debug, PartialEq)]
pub struct Fault {
    /// Where in the file; `None` when the whole file is meant.
    pub place: Option<Place>,
    /// What is wrong.
    pub problem: String,
    /// What the user can do.
    pub remedy: String,
}

/// A place in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// 1-based line of a text file.
    Line(usize),
    /// Byte offset from the start of a binary file.
    Byte(usize),
    /// 0-based index of an element, such as `("face", 12)`.
    Element(&'static str, usize),
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Place::Line(line) => write!(f, "line {line}"),
            Place::Byte(offset) => write!(f, "byte {offset}"),
            Place::Element(what, index) => write!(f, "{what} {index}"),
        }
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(place) = self.place {
            write!(f, "{place}: ")?;
        }
        write!(f, "{}; {}", self.problem, self.remedy)
    }
}

impl Fault {
    /// A fault of the whole file.
    pub fn new(problem: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { place: None, problem: problem.into(), remedy: remedy.into() }
    }

    /// A fault at one place of the file.
    pub fn at(place: Place, problem: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { place: Some(place), problem: problem.into(), remedy: remedy.into() }
    }

    /// The same fault, said of a named file.
    pub fn in_file(self, path: &Path) -> FileError {
        FileError { path: path.to_owned(), fault: self }
    }
}

/// Reads a regular file of at most [`MAX_FILE_BYTES`].
///
/// The file is read, not mapped: a mapped file that another program shortens kills the process on access.
///
/// # Errors
/// [`FileError`] for a missing or unreadable file, a folder, a device or pipe (which may never end), and a file over
/// the limit.
pub fn read(path: &Path) -> Result<Vec<u8>, FileError> {
    read_regular(path).map_err(|fault| fault.in_file(path))
}

fn read_regular(path: &Path) -> Result<Vec<u8>, Fault> {
    let unreadable =
        |e: io::Error| Fault::new(format!("cannot be read ({e})"), "check the path and its permissions");
    // Asked before opening: opening a pipe nobody writes to would block.
    let metadata = std::fs::metadata(path).map_err(unreadable)?;
    if metadata.is_dir() {
        return Err(Fault::new("is a folder", "name a file in it"));
    }
    if !metadata.is_file() {
        return Err(Fault::new("is not a regular file", "save the data to a file first"));
    }
    let too_large = || Fault::new("is larger than 4 GiB", "split or decimate it");
    if metadata.len() > MAX_FILE_BYTES {
        return Err(too_large());
    }
    let mut bytes = Vec::new();
    bytes
        .try_reserve_exact(metadata.len() as usize + 1) // one more, so that the end is seen without growing
        .map_err(|_| Fault::new(format!("needs {} bytes of memory", metadata.len()), "free some memory"))?;
    let file = File::open(path).map_err(unreadable)?;
    file.take(MAX_FILE_BYTES + 1).read_to_end(&mut bytes).map_err(unreadable)?;
    if bytes.len() as u64 > MAX_FILE_BYTES { Err(too_large()) } else { Ok(bytes) }
}

/// Writes a file through `content` so that it appears under its name whole or not at all: a temporary file beside it
/// is renamed when everything is written, and removed on any error.
///
/// A name that exists and is no regular file (`/dev/stdout`, a pipe) is written to directly. The data is handed to the
/// operating system but not forced to the disk: a power failure may lose it.
///
/// # Errors
/// [`FileError`] when the name is a folder, its folder is missing or not writable, or the disk is full.
pub fn write_atomically(
    path: &Path,
    content: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<(), FileError> {
    write_or_explain(path, content).map_err(|fault| fault.in_file(path))
}

fn write_or_explain(
    path: &Path,
    content: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<(), Fault> {
    let failed = |e: io::Error| {
        Fault::new(format!("cannot be written ({e})"), "check its folder, permissions and free space")
    };
    match std::fs::metadata(path) {
        Ok(metadata) if metadata.is_dir() => {
            return Err(Fault::new("cannot be written because it is a folder", "name a file in it"));
        }
        Ok(metadata) if !metadata.is_file() => {
            let mut out = BufWriter::new(File::options().write(true).open(path).map_err(failed)?);
            return content(&mut out).and_then(|()| out.flush()).map_err(failed);
        }
        _ => {}
    }
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut builder = tempfile::Builder::new();
    builder.prefix(".lapbench-");
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(std::fs::Permissions::from_mode(0o666)); // less the umask, as any created file
    }
    let temporary = builder.tempfile_in(folder).map_err(failed)?;
    let mut out = BufWriter::with_capacity(1 << 16, temporary);
    content(&mut out).map_err(failed)?;
    let temporary = out.into_inner().map_err(|e| failed(e.into_error()))?;
    temporary.persist(path).map_err(|e| failed(e.error))?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failed_write_leaves_nothing_behind_and_the_old_file_alone() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("out.txt");
        write_atomically(&path, |out| out.write_all(b"old")).unwrap();
        let error = write_atomically(&path, |out| {
            out.write_all(&[b'x'; 200_000])?;
            Err(io::Error::other("injected"))
        });
        assert!(error.unwrap_err().to_string().contains("injected"));
        assert_eq!(std::fs::read(&path).unwrap(), b"old");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn folders_are_neither_read_nor_overwritten() {
        let folder = tempfile::tempdir().unwrap();
        assert!(read(folder.path()).unwrap_err().to_string().contains("is a folder"));
        let error = write_atomically(folder.path(), |_| Ok(())).unwrap_err();
        assert!(error.to_string().contains("is a folder"), "{error}");
        let error = write_atomically(&folder.path().join("no/such/a.txt"), |_| Ok(())).unwrap_err();
        assert!(error.to_string().contains("cannot be written"), "{error}");
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_full_disk_is_an_error_and_a_device_is_no_input() {
        let error = write_atomically(Path::new("/dev/full"), |out| out.write_all(b"x")).unwrap_err();
        assert!(error.to_string().contains("free space"), "{error}");
        assert!(read(Path::new("/dev/zero")).unwrap_err().to_string().contains("not a regular file"));
    }
}
