//! The body of an ascii PLY file: one element to a line.

use super::header::{Element, Kind};
use super::{Role, add_strips, index, role};
use crate::file::Fault;
use crate::mesh_io::builder::MeshBuilder;
use crate::mesh_io::text::{Line, Lines};

/// Reads all elements.
///
/// # Errors
/// A fault naming the line.
pub fn read(elements: &[Element], lines: &mut Lines<'_>, builder: &mut MeshBuilder) -> Result<(), Fault> {
    for element in elements {
        // A number takes a digit and a separator, so that a header can promise no more than the file may hold.
        let possible = (lines.bytes_left() + 1) / (2 * element.properties.len().max(1));
        if element.properties.is_empty() {
            continue;
        }
        if element.count > possible {
            return Err(cut_off(element, lines.number()));
        }
        read_element(element, lines, builder)?;
    }
    Ok(())
}

fn read_element(element: &Element, lines: &mut Lines<'_>, builder: &mut MeshBuilder) -> Result<(), Fault> {
    let role = role(element)?;
    let mut row = Row::default();
    for _ in 0..element.count {
        let line = lines.next_filled().ok_or_else(|| cut_off(element, lines.number()))?;
        match role {
            Role::Other => {}
            Role::Vertices(at) => {
                row.read(element, &line, None)?;
                let point = at.map(|i| row.ones[i]);
                if point.iter().any(|x| !x.is_finite()) {
                    let problem =
                        format!("vertex {} has a coordinate that is not finite", builder.positions.len());
                    return Err(line.fault(problem, "remove the vertex or repair the file"));
                }
                builder.positions.push(point);
            }
            Role::Faces(list) => {
                row.read(element, &line, Some(list))?;
                row.corners.clear();
                for &value in &row.list {
                    row.corners.push(index(value, line.place())?);
                }
                builder.face(&row.corners, line.place());
            }
            Role::Strips(list) => {
                row.read(element, &line, Some(list))?;
                add_strips(&row.list, line.place(), builder)?;
            }
        }
    }
    Ok(())
}

fn cut_off(element: &Element, last_line: usize) -> Fault {
    Fault::new(
        format!(
            "ends at line {last_line} before the {} elements `{}` the header promises",
            element.count, element.name
        ),
        "the file is cut off or its header wrong",
    )
}

/// The values of one line, in buffers kept from line to line.
#[derive(Default)]
struct Row {
    /// Value of each property; lists leave 0.
    ones: Vec<f64>,
    /// Items of the list asked for.
    list: Vec<f64>,
    corners: Vec<u32>,
}

impl Row {
    fn read(&mut self, element: &Element, line: &Line<'_>, wanted: Option<usize>) -> Result<(), Fault> {
        self.ones.clear();
        self.list.clear();
        let mut tokens = line.tokens();
        for (i, property) in element.properties.iter().enumerate() {
            let value = line.value(tokens.next(), &property.name)?;
            if let Kind::List { .. } = property.kind {
                let length = line.count(value, &property.name)?;
                for _ in 0..length {
                    let item = line.value(tokens.next(), &property.name)?;
                    if wanted == Some(i) {
                        self.list.push(item);
                    }
                }
            }
            self.ones.push(value);
        }
        match tokens.next() {
            None => Ok(()),
            Some(_) => Err(line
                .fault("has more values than its element has properties", "repair the line or the header")),
        }
    }
}
