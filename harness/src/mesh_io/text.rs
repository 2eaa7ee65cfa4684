//! Lines and numbers of text formats.

use crate::file::{Fault, Place};

/// The lines of a text file with their 1-based numbers; `\n`, `\r\n` and `\r` all end a line.
pub struct Lines<'a> {
    rest: &'a [u8],
    number: usize,
}

impl<'a> Lines<'a> {
    /// The lines of `bytes`, of which the first has number `first`. The byte order mark that some editors put before a
    /// text is none of it.
    pub fn new(bytes: &'a [u8], first: usize) -> Self {
        let mark: &[u8] = if first == 1 { b"\xEF\xBB\xBF" } else { b"" };
        Self { rest: bytes.strip_prefix(mark).unwrap_or(bytes), number: first - 1 }
    }

    /// Number of bytes not yet handed out.
    pub fn bytes_left(&self) -> usize {
        self.rest.len()
    }

    /// 1-based number of the line handed out last.
    pub fn number(&self) -> usize {
        self.number
    }

    /// The next line that holds anything but blanks.
    pub fn next_filled(&mut self) -> Option<Line<'a>> {
        self.find(|line| line.tokens().next().is_some())
    }
}

impl<'a> Iterator for Lines<'a> {
    type Item = Line<'a>;

    fn next(&mut self) -> Option<Line<'a>> {
        if self.rest.is_empty() {
            return None;
        }
        let end = self.rest.iter().position(|&b| b == b'\n' || b == b'\r').unwrap_or(self.rest.len());
        let (text, tail) = self.rest.split_at(end);
        self.rest = match tail {
            [b'\r', b'\n', after @ ..] | [_, after @ ..] => after,
            [] => tail,
        };
        self.number += 1;
        Some(Line { text, number: self.number })
    }
}

/// One line of a text file.
#[derive(Clone, Copy)]
pub struct Line<'a> {
    /// The bytes, without the line ending.
    pub text: &'a [u8],
    /// 1-based number.
    pub number: usize,
}

impl<'a> Line<'a> {
    /// The words of the line: what stands between blanks and tabs.
    pub fn tokens(&self) -> impl Iterator<Item = &'a [u8]> + use<'a> {
        self.text.split(|b| b.is_ascii_whitespace()).filter(|token| !token.is_empty())
    }

    /// The line up to the first `#`.
    pub fn without_comment(self) -> Self {
        let end = self.text.iter().position(|&b| b == b'#').unwrap_or(self.text.len());
        Self { text: &self.text[..end], number: self.number }
    }

    /// A fault at this line.
    pub fn fault(&self, problem: impl Into<String>, remedy: impl Into<String>) -> Fault {
        Fault::at(self.place(), problem, remedy)
    }

    /// This line as a place.
    pub fn place(&self) -> Place {
        Place::Line(self.number)
    }

    /// A number, possibly NaN or infinite.
    ///
    /// # Errors
    /// A fault at this line when `token` is missing or no number.
    pub fn value(&self, token: Option<&[u8]>, what: &str) -> Result<f64, Fault> {
        let token = self.present(token, what)?;
        parse(token).ok_or_else(|| {
            self.fault(format!("`{}` is no number ({what} expected)", shown(token)), "correct the line")
        })
    }

    /// A finite number.
    ///
    /// # Errors
    /// As [`Line::value`], and for NaN and infinity (also by overflow).
    pub fn finite(&self, token: Option<&[u8]>, what: &str) -> Result<f64, Fault> {
        let value = self.value(token, what)?;
        if value.is_finite() {
            return Ok(value);
        }
        let problem = format!("{what} is not finite (`{}`)", shown(token.unwrap_or_default()));
        Err(self.fault(problem, "remove the line or repair the value"))
    }

    /// The length of a list.
    ///
    /// # Errors
    /// A fault at this line unless `value` is a whole number from 0 that the line has bytes for.
    pub fn count(&self, value: f64, what: &str) -> Result<usize, Fault> {
        let count = value as usize; // saturates, NaN becomes 0: neither equals the value
        if count as f64 == value && count <= self.text.len() {
            return Ok(count);
        }
        Err(self.fault(format!("the list {what} cannot have {value} items"), "correct the line"))
    }

    /// Three finite numbers: a position.
    ///
    /// # Errors
    /// See [`Line::finite`].
    pub fn point(&self, tokens: &mut impl Iterator<Item = &'a [u8]>) -> Result<[f64; 3], Fault> {
        let mut point = [0.0; 3];
        for (x, name) in point.iter_mut().zip(["x coordinate", "y coordinate", "z coordinate"]) {
            *x = self.finite(tokens.next(), name)?;
        }
        Ok(point)
    }

    /// A whole number.
    ///
    /// # Errors
    /// A fault at this line when `token` is missing or no whole number.
    pub fn integer(&self, token: Option<&[u8]>, what: &str) -> Result<i64, Fault> {
        let token = self.present(token, what)?;
        parse(token).ok_or_else(|| {
            self.fault(format!("`{}` is no whole number ({what} expected)", shown(token)), "correct the line")
        })
    }

    /// A 0-based index below 2^32.
    ///
    /// # Errors
    /// As [`Line::integer`], and for a negative number.
    pub fn index(&self, token: Option<&[u8]>, what: &str) -> Result<u32, Fault> {
        let value = self.integer(token, what)?;
        u32::try_from(value)
            .map_err(|_| self.fault(format!("{what} {value} is out of range"), "indices count from 0"))
    }

    fn present<'t>(&self, token: Option<&'t [u8]>, what: &str) -> Result<&'t [u8], Fault> {
        token
            .ok_or_else(|| self.fault(format!("the line ends where {what} is expected"), "complete the line"))
    }
}

fn parse<T: std::str::FromStr>(token: &[u8]) -> Option<T> {
    std::str::from_utf8(token).ok()?.parse().ok()
}

/// A piece of a file as it may stand in a message: at most 40 characters, nothing unprintable.
pub fn shown(bytes: &[u8]) -> String {
    let text = String::from_utf8_lossy(&bytes[..bytes.len().min(160)]);
    let mut clean: String = text.chars().take(40).flat_map(char::escape_debug).collect();
    if text.chars().count() > 40 {
        clean.push('…');
    }
    clean
}
