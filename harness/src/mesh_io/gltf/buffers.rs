//! The bytes behind a glTF document: inside the file, in base64, or in files beside it.

use std::path::{Component, Path};

use ::gltf::buffer::Source;
use ::gltf::{Buffer, Document};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;

use crate::file::{self, Fault, MAX_FILE_BYTES, Place};

/// The buffers of a document, in its order.
pub struct Buffers(Vec<Vec<u8>>);

impl Buffers {
    /// Loads all buffers, together at most [`MAX_FILE_BYTES`].
    ///
    /// # Errors
    /// A fault naming the buffer.
    pub fn load(document: &Document, blob: Option<&[u8]>, folder: Option<&Path>) -> Result<Self, Fault> {
        let mut loaded = Vec::new();
        let mut total = 0;
        for buffer in document.buffers() {
            let place = Place::Element("buffer", buffer.index());
            let bytes = load_one(&buffer, blob, folder, place)?;
            if bytes.len() < buffer.length() {
                let problem = format!("has {} bytes, promised are {}", bytes.len(), buffer.length());
                return Err(Fault::at(place, problem, "the file is cut off or damaged"));
            }
            total += bytes.len() as u64;
            if total > MAX_FILE_BYTES {
                return Err(Fault::at(place, "brings the buffers over 4 GiB", "split the scene"));
            }
            loaded.push(bytes);
        }
        Ok(Self(loaded))
    }

    /// A part of a buffer, if it has it.
    pub fn range(&self, buffer: usize, offset: usize, length: usize) -> Option<&[u8]> {
        self.0.get(buffer)?.get(offset..)?.get(..length)
    }
}

fn load_one(
    buffer: &Buffer<'_>,
    blob: Option<&[u8]>,
    folder: Option<&Path>,
    place: Place,
) -> Result<Vec<u8>, Fault> {
    let uri = match buffer.source() {
        Source::Bin => {
            // Only the first buffer may be the chunk of the container.
            let blob = blob.filter(|_| buffer.index() == 0).map(<[u8]>::to_vec);
            return blob.ok_or_else(|| Fault::at(place, "is missing from the file", "export it again"));
        }
        Source::Uri(uri) => uri,
    };
    if let Some(data) = uri.strip_prefix("data:") {
        let encoded = data.split_once(";base64,").map(|(_media_type, encoded)| encoded);
        return encoded
            .and_then(|encoded| STANDARD.decode(encoded).ok())
            .ok_or_else(|| Fault::at(place, "is a data URI that is no valid base64", "export it again"));
    }
    let name = percent_decoded(uri);
    // A mesh file has no business in other folders.
    let below = Path::new(&name).components().all(|c| matches!(c, Component::Normal(_) | Component::CurDir));
    let folder = folder.filter(|_| below && !uri.contains(':')).ok_or_else(|| {
        Fault::at(
            place,
            format!("lies outside of the folder of the file (`{uri}`)"),
            "move it there, or use .glb",
        )
    })?;
    file::read(&folder.join(&name)).map_err(|error| {
        Fault::at(place, format!("cannot be loaded: {error}"), "put it beside the mesh file, or use .glb")
    })
}

/// Replaces `%20` and its like by the bytes they stand for.
fn percent_decoded(uri: &str) -> String {
    let digit = |byte: Option<&u8>| byte.and_then(|&b| char::from(b).to_digit(16)).map(|d| d as u8);
    let mut decoded = Vec::with_capacity(uri.len());
    let mut rest = uri.as_bytes();
    while let [first, tail @ ..] = rest {
        match (first, digit(tail.first()), digit(tail.get(1))) {
            (b'%', Some(high), Some(low)) => {
                decoded.push(16 * high + low);
                rest = &tail[2..];
            }
            _ => {
                decoded.push(*first);
                rest = tail;
            }
        }
    }
    String::from_utf8_lossy(&decoded).into_owned()
}
