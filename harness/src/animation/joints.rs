//! Places of joints in a mesh, as text: rows `name, x, y, z`.

use super::clip::Clip;
use crate::file::{self, Fault, FileError};
use crate::mesh_io::text::{Lines, shown};
use lapsolve::vector::Vector;
use std::path::Path;

/// Reads the places of all joints of `clip`, by name, in any order.
///
/// # Errors
/// [`FileError`] naming the line, or the joint that is missing.
pub fn read(path: &Path, clip: &Clip) -> Result<Vec<Vector>, FileError> {
    parse(&file::read(path)?, clip).map_err(|fault| fault.in_file(path))
}

fn parse(bytes: &[u8], clip: &Clip) -> Result<Vec<Vector>, Fault> {
    let mut places: Vec<Option<Vector>> = vec![None; clip.joints.len()];
    for line in Lines::new(bytes, 1) {
        let mut fields = line.text.split(|&b| b == b',').map(<[u8]>::trim_ascii);
        let name = fields.next().unwrap_or_default();
        if name.is_empty() || name.starts_with(b"#") || (line.number == 1 && name == b"name") {
            continue;
        }
        let place = line.point(&mut fields)?;
        match clip.joints.iter().position(|joint| joint.name.as_bytes() == name) {
            Some(j) => places[j] = Some(place),
            None => {
                let problem = format!("the motion has no joint `{}`", shown(name));
                return Err(line.fault(problem, "use the names of the motion file"));
            }
        }
    }
    let missing = places.iter().position(Option::is_none);
    if let Some(j) = missing {
        let problem = format!("joint `{}` has no place", shown(clip.joints[j].name.as_bytes()));
        return Err(Fault::new(problem, "add a row `name, x, y, z`"));
    }
    Ok(places.into_iter().flatten().collect())
}

/// Writes the places of all joints.
///
/// # Errors
/// [`FileError`] when the file cannot be written.
pub fn write(path: &Path, clip: &Clip, places: &[Vector]) -> Result<(), FileError> {
    file::write_atomically(path, |out| {
        writeln!(out, "name,x,y,z")?;
        for (joint, [x, y, z]) in clip.joints.iter().zip(places) {
            writeln!(out, "{},{x:.6},{y:.6},{z:.6}", joint.name)?;
        }
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::animation::clip::tests::leg;

    #[test]
    fn joints_are_found_by_name() {
        let clip = leg(vec![0.0; 9]);
        let places = [[0.5, 1.0, 0.0], [0.5, -0.25, 2.0]];
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("j.csv");
        write(&path, &clip, &places).unwrap();
        assert_eq!(read(&path, &clip).unwrap(), places);
        for (text, part) in [
            ("hip, 0, 0, 0\n", "joint `knee` has no place"),
            ("hip, 0, 0, 0\nfoot, 1, 2, 3\n", "line 2: the motion has no joint `foot`"),
            ("hip, 0, 0\n", "line 1"),
        ] {
            let fault = parse(text.as_bytes(), &clip).unwrap_err().to_string();
            assert!(fault.contains(part), "{text}: {fault}");
        }
    }
}
