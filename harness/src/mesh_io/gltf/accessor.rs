//! Typed reading of buffers, every range checked.

use ::gltf::Accessor;
use ::gltf::accessor::{DataType, Dimensions};

use super::buffers::Buffers;
use crate::file::{Fault, Place};

/// The positions an accessor holds; none is NaN or infinite.
///
/// # Errors
/// A fault naming the accessor.
pub fn positions(accessor: &Accessor<'_>, buffers: &Buffers) -> Result<Vec<[f64; 3]>, Fault> {
    if accessor.data_type() != DataType::F32 || accessor.dimensions() != Dimensions::Vec3 {
        return Err(fault(accessor, "positions that are not three floats", "export without quantization"));
    }
    let positions: Vec<[f64; 3]> = items(accessor, buffers)?
        .map(|item| {
            let xyz: &[[u8; 4]; 3] = item.as_chunks().0.try_into().expect("items have 12 bytes");
            xyz.map(|x| f64::from(f32::from_le_bytes(x)))
        })
        .collect();
    match positions.iter().position(|p| p.iter().any(|x| !x.is_finite())) {
        None => Ok(positions),
        Some(at) => Err(fault(
            accessor,
            &format!("vertex {at}, which is NaN or infinite"),
            "remove it or repair the file",
        )),
    }
}

/// The vertex indices an accessor holds.
///
/// # Errors
/// A fault naming the accessor.
pub fn indices(accessor: &Accessor<'_>, buffers: &Buffers) -> Result<Vec<u32>, Fault> {
    let read: fn(&[u8]) -> u32 = match (accessor.data_type(), accessor.dimensions()) {
        (DataType::U8, Dimensions::Scalar) => |item| u32::from(item[0]),
        (DataType::U16, Dimensions::Scalar) => |item| u32::from(u16::from_le_bytes([item[0], item[1]])),
        (DataType::U32, Dimensions::Scalar) => {
            |item| u32::from_le_bytes([item[0], item[1], item[2], item[3]])
        }
        _ => return Err(fault(accessor, "indices that are not unsigned integers", "export the file again")),
    };
    Ok(items(accessor, buffers)?.map(read).collect())
}

/// All numbers of an accessor whose items have `components` of them; normalised integers become fractions.
///
/// # Errors
/// A fault naming the accessor.
pub fn numbers(accessor: &Accessor<'_>, buffers: &Buffers, components: usize) -> Result<Vec<f64>, Fault> {
    let kind = accessor.data_type();
    let size = match kind {
        DataType::I8 | DataType::U8 => 1,
        DataType::I16 | DataType::U16 => 2,
        DataType::F32 | DataType::U32 => 4,
    };
    if accessor.size() != size * components {
        let what = format!("items of {} bytes where {components} numbers are expected", accessor.size());
        return Err(fault(accessor, &what, "export the file again"));
    }
    let normalised = |x: f64, most: f64| if accessor.normalized() { (x / most).max(-1.0) } else { x };
    let number = |bytes: &[u8]| match kind {
        DataType::I8 => normalised(f64::from(bytes[0] as i8), 127.0),
        DataType::U8 => normalised(f64::from(bytes[0]), 255.0),
        DataType::I16 => normalised(f64::from(i16::from_le_bytes([bytes[0], bytes[1]])), 32767.0),
        DataType::U16 => normalised(f64::from(u16::from_le_bytes([bytes[0], bytes[1]])), 65535.0),
        DataType::U32 => f64::from(u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])),
        DataType::F32 => f64::from(f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])),
    };
    Ok(items(accessor, buffers)?.flat_map(|item| item.chunks_exact(size)).map(number).collect())
}

/// The bytes of each item.
fn items<'b>(
    accessor: &Accessor<'_>,
    buffers: &'b Buffers,
) -> Result<impl ExactSizeIterator<Item = &'b [u8]> + use<'b>, Fault> {
    let size = accessor.size();
    let view = match accessor.view() {
        Some(view) if accessor.sparse().is_none() => view,
        _ => return Err(fault(accessor, "sparse data", "export without sparse accessors")),
    };
    let stride = view.stride().unwrap_or(size);
    // Where the last item ends; items may not overlap, so that a file cannot promise more than it holds.
    let end =
        accessor.count().checked_sub(1).map_or(Some(0), |last| last.checked_mul(stride)?.checked_add(size));
    let bytes = buffers.range(view.buffer().index(), view.offset(), view.length());
    let bytes = bytes.and_then(|bytes| bytes.get(accessor.offset()..)).and_then(|bytes| bytes.get(..end?));
    match bytes {
        Some(bytes) if stride >= size => Ok(bytes.chunks(stride).map(move |item| &item[..size])),
        _ => Err(fault(accessor, "data outside of its buffer", "the file is cut off or damaged")),
    }
}

fn fault(accessor: &Accessor<'_>, what: &str, remedy: &str) -> Fault {
    Fault::at(Place::Element("accessor", accessor.index()), format!("describes {what}"), remedy)
}
