//! The header of a PLY file: format, elements, properties.

use crate::file::Fault;
use crate::mesh_io::text::{Line, Lines, shown};

/// How the body is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    /// Numbers as text, one element to a line.
    Ascii,
    /// Binary, least significant byte first.
    Little,
    /// Binary, most significant byte first.
    Big,
}

/// A type of number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    /// Both spellings in use: C's and the sized one.
    fn named(name: &[u8]) -> Option<Self> {
        Some(match name {
            b"char" | b"int8" => Scalar::I8,
            b"uchar" | b"uint8" => Scalar::U8,
            b"short" | b"int16" => Scalar::I16,
            b"ushort" | b"uint16" => Scalar::U16,
            b"int" | b"int32" => Scalar::I32,
            b"uint" | b"uint32" => Scalar::U32,
            b"float" | b"float32" => Scalar::F32,
            b"double" | b"float64" => Scalar::F64,
            _ => return None,
        })
    }

    /// Bytes of one number.
    pub fn size(self) -> usize {
        match self {
            Scalar::I8 | Scalar::U8 => 1,
            Scalar::I16 | Scalar::U16 => 2,
            Scalar::I32 | Scalar::U32 | Scalar::F32 => 4,
            Scalar::F64 => 8,
        }
    }

    /// The number at the start of `bytes`, which hold at least [`Scalar::size`] of them; every type fits f64 exactly.
    pub fn read(self, bytes: &[u8], big: bool) -> f64 {
        macro_rules! number {
            ($type:ty) => {{
                let raw = bytes[..size_of::<$type>()].try_into().expect("the slice has the size of the type");
                f64::from(if big { <$type>::from_be_bytes(raw) } else { <$type>::from_le_bytes(raw) })
            }};
        }
        match self {
            Scalar::I8 => number!(i8),
            Scalar::U8 => number!(u8),
            Scalar::I16 => number!(i16),
            Scalar::U16 => number!(u16),
            Scalar::I32 => number!(i32),
            Scalar::U32 => number!(u32),
            Scalar::F32 => number!(f32),
            Scalar::F64 => number!(f64),
        }
    }
}

/// A property: one number, or a list of them behind its length.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    One(Scalar),
    List { length: Scalar, item: Scalar },
}

/// A named property of an element.
#[derive(Clone, Debug)]
pub struct Property {
    pub name: String,
    pub kind: Kind,
}

/// A table of the file: `count` rows of the same properties.
#[derive(Clone, Debug)]
pub struct Element {
    pub name: String,
    pub count: usize,
    pub properties: Vec<Property>,
}

impl Element {
    /// Bytes of a row with every list empty.
    pub fn least_row_bytes(&self) -> usize {
        let least = |p: &Property| match p.kind {
            Kind::One(scalar) => scalar.size(),
            Kind::List { length, .. } => length.size(),
        };
        self.properties.iter().map(least).sum()
    }

    /// Bytes of every row, unless there are lists.
    pub fn fixed_row_bytes(&self) -> Option<usize> {
        let fixed = self.properties.iter().all(|p| matches!(p.kind, Kind::One(_)));
        fixed.then(|| self.least_row_bytes())
    }

    /// Index of the first property with one of these names.
    pub fn position(&self, names: &[&str]) -> Option<usize> {
        self.properties.iter().position(|p| names.contains(&p.name.as_str()))
    }
}

/// A parsed header.
pub struct Header {
    pub encoding: Encoding,
    pub elements: Vec<Element>,
}

/// Reads up to and including `end_header`; `lines` then stands at the body.
///
/// # Errors
/// A fault naming the line.
pub fn parse(lines: &mut Lines<'_>) -> Result<Header, Fault> {
    let magic = lines.next().filter(|line| line.text.trim_ascii() == b"ply");
    magic.ok_or_else(|| Fault::new("does not begin with `ply`", "check that it is a PLY file"))?;
    let mut encoding = None;
    let mut elements = Vec::<Element>::new();
    for line in lines {
        let mut words = line.tokens();
        match words.next() {
            None | Some(b"comment" | b"obj_info") => {}
            Some(b"format") => encoding = Some(parse_encoding(&line, words)?),
            Some(b"element") => elements.push(parse_element(&line, words)?),
            Some(b"property") => match elements.last_mut() {
                Some(element) => element.properties.push(parse_property(&line, words)?),
                None => return Err(line.fault("a property before the first element", "repair the header")),
            },
            Some(b"end_header") => {
                let missing = || Fault::new("the header has no `format` line", "repair the header");
                return Ok(Header { encoding: encoding.ok_or_else(missing)?, elements });
            }
            Some(other) => {
                let problem = format!("`{}` is no word of a PLY header", shown(other));
                return Err(line.fault(problem, "repair the header"));
            }
        }
    }
    Err(Fault::new("the header has no `end_header` line", "the file is cut off or no PLY file"))
}

fn parse_encoding<'a>(line: &Line<'a>, mut words: impl Iterator<Item = &'a [u8]>) -> Result<Encoding, Fault> {
    match words.next() {
        Some(b"ascii") => Ok(Encoding::Ascii),
        Some(b"binary_little_endian") => Ok(Encoding::Little),
        Some(b"binary_big_endian") => Ok(Encoding::Big),
        other => {
            let problem = format!("unknown format `{}`", shown(other.unwrap_or_default()));
            Err(line.fault(problem, "use ascii, binary_little_endian or binary_big_endian"))
        }
    }
}

fn parse_element<'a>(line: &Line<'a>, mut words: impl Iterator<Item = &'a [u8]>) -> Result<Element, Fault> {
    let name = String::from_utf8_lossy(words.next().unwrap_or_default()).into_owned();
    let count = line.integer(words.next(), "number of elements")?;
    let count = usize::try_from(count).map_err(|_| {
        line.fault(format!("{count} elements `{}`", shown(name.as_bytes())), "repair the header")
    })?;
    Ok(Element { name, count, properties: Vec::new() })
}

fn parse_property<'a>(line: &Line<'a>, mut words: impl Iterator<Item = &'a [u8]>) -> Result<Property, Fault> {
    let scalar = |word: Option<&[u8]>| {
        let word = word.unwrap_or_default();
        Scalar::named(word).ok_or_else(|| {
            line.fault(
                format!("unknown type `{}`", shown(word)),
                "use char, uchar, short, ushort, int, uint, float or double",
            )
        })
    };
    let kind = match words.next() {
        Some(b"list") => Kind::List { length: scalar(words.next())?, item: scalar(words.next())? },
        word => Kind::One(scalar(word)?),
    };
    let name = words.next().ok_or_else(|| line.fault("a property without a name", "repair the header"))?;
    Ok(Property { name: String::from_utf8_lossy(name).into_owned(), kind })
}
