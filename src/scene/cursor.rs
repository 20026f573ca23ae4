//! Reads a mesh file, text or binary, from beginning to end: lines, words and numbers one by one. Errors give the
//! position in the file.
//!
//! The project has its own parsers, which use this module, for two reasons: errors name file and line, and a wrong
//! count in a file's header never makes a parser allocate memory for so many items. Of the existing crates, mshio reads
//! only Gmsh 4.1, vtkio had no current release, and neither mshio nor vtkio reports lines.

use std::path::Path;
use std::str::FromStr;

use glam::DVec3;

use crate::{Error, Result, files};

/// Greatest magnitude of a coordinate. The greatest number of single precision, 3e38, is so much greater that the
/// coordinate may be multiplied by 1e8 without overflow.
pub(super) const LARGEST: f64 = 1e30;

/// With what some editors begin a text.
pub(super) const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";

/// Byte order of binary numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Order {
    Little,
    Big,
}

/// A file's bytes, and the position up to which they have been read.
pub(super) struct Cursor<'a> {
    path: &'a Path,
    bytes: &'a [u8],
    at: usize,
    /// Position at which the last item read (line, word or bytes) begins.
    mark: usize,
    /// What the user can do about an error in the file's data; the message of every such error shows it.
    remedy: &'static str,
    /// Byte order of the numbers; `None` for text.
    pub order: Option<Order>,
    /// Whether errors name a line; false for a mesh that is not from a file.
    has_lines: bool,
}

/// Reads all bytes of a mesh file.
pub(super) fn bytes(path: &Path) -> Result<Vec<u8>> {
    let mut bytes = files::mesh(path, "give a mesh file")?;
    if bytes.starts_with(BYTE_ORDER_MARK) {
        bytes.drain(..BYTE_ORDER_MARK.len());
    }
    Ok(bytes)
}

/// Shortens a word to 40 characters and escapes it, for use in a message.
pub(super) fn short(word: &str) -> String {
    word.chars().take(40).collect::<String>().escape_debug().to_string()
}

/// Whether a byte ends a line; the two bytes `\r\n` end one line together.
fn is_line_end(byte: &u8) -> bool {
    matches!(byte, b'\n' | b'\r')
}

/// Number of line ends in a text.
fn line_ends(bytes: &[u8]) -> usize {
    let pairs = bytes.windows(2).filter(|two| two == b"\r\n").count();
    bytes.iter().filter(|byte| is_line_end(byte)).count() - pairs
}

impl<'a> Cursor<'a> {
    pub(super) fn new(path: &'a Path, bytes: &'a [u8], remedy: &'static str) -> Self {
        Cursor { path, bytes, at: 0, mark: 0, remedy, order: None, has_lines: true }
    }

    /// A cursor for a mesh that is not from a file; errors show `name` in place of a path.
    pub(super) fn of_arrays(name: &'a Path, remedy: &'static str) -> Self {
        Cursor { has_lines: false, ..Cursor::new(name, &[], remedy) }
    }

    /// Position at which the last item read begins, for [`Cursor::error_at`].
    pub(super) fn mark(&self) -> usize {
        self.mark
    }

    /// Position up to which the file has been read.
    pub(super) fn position(&self) -> usize {
        self.at
    }

    pub(super) fn error(&self, problem: impl Into<String>) -> Error {
        self.error_at(self.mark, problem, self.remedy)
    }

    /// An error at byte `mark` of the file. Its message names the line of a text file, or the byte of a binary file.
    pub(super) fn error_at(&self, mark: usize, problem: impl Into<String>, remedy: &str) -> Error {
        match self.order {
            Some(_) => Error::input(self.path, None, format!("{}, at byte {mark}", problem.into()), remedy),
            None if !self.has_lines => Error::input(self.path, None, problem, remedy),
            None => Error::input(self.path, Some(1 + line_ends(&self.bytes[..mark])), problem, remedy),
        }
    }

    /// An error about the file as a whole.
    pub(super) fn error_of_file(&self, problem: &str, remedy: &str) -> Error {
        Error::input(self.path, None, problem, remedy)
    }

    /// What has not been read yet.
    pub(super) fn left(&self) -> &'a [u8] {
        &self.bytes[self.at.min(self.bytes.len())..]
    }

    pub(super) fn ended(&self) -> bool {
        self.at >= self.bytes.len()
    }

    /// Reads the rest of the current line, and returns it trimmed; `None` at the end of the file.
    pub(super) fn next_line(&mut self) -> Option<&'a str> {
        self.mark = self.at;
        if self.ended() {
            return None;
        }
        let rest = &self.bytes[self.at..];
        let length = rest.iter().position(is_line_end).unwrap_or(rest.len());
        let end = if rest[length..].starts_with(b"\r\n") { 2 } else { 1 };
        self.at = (self.at + length + end).min(self.bytes.len());
        // Bytes that are not UTF-8 become a character that no parser accepts, so that the error names this line.
        Some(std::str::from_utf8(&rest[..length]).unwrap_or("\u{fffd}").trim())
    }

    /// Reads up to the end of the next line that is not empty, and returns that line trimmed.
    pub(super) fn next_filled(&mut self) -> Option<&'a str> {
        loop {
            let line = self.next_line()?;
            if !line.is_empty() {
                return Some(line);
            }
        }
    }

    /// Like [`Cursor::next_filled`]; if the file ends first, the error says that it ends before `what`.
    pub(super) fn need(&mut self, what: &str) -> Result<&'a str> {
        self.next_filled().ok_or_else(|| self.error(format!("the file ends early, before {what}")))
    }

    /// Reads the next line that is not empty, which must be `marker`.
    pub(super) fn expect(&mut self, marker: &str) -> Result<()> {
        match self.need(marker)? {
            line if line == marker => Ok(()),
            line => Err(self.error(format!("found \"{}\" instead of {marker}", short(line)))),
        }
    }

    /// Skips everything up to and including the next `marker`, which may be anywhere in a line.
    pub(super) fn skip_past(&mut self, marker: &str) -> Result<()> {
        let rest = &self.bytes[self.at..];
        match rest.windows(marker.len()).position(|window| window == marker.as_bytes()) {
            Some(place) => {
                self.at += place + marker.len();
                Ok(())
            }
            None => {
                self.mark = self.bytes.len();
                Err(self.error(format!("the file ends early, before {marker}")))
            }
        }
    }

    /// Parses a word of the line that was read last; `what` is what the word stands for, for use in an error.
    pub(super) fn parse<T: FromStr>(&self, word: &str, what: &str) -> Result<T> {
        word.parse().map_err(|_| self.error(format!("\"{}\" is not valid for {what}", short(word))))
    }

    /// Reads the next line that is not empty, and returns all its numbers, of which there must be at least `least`.
    pub(super) fn numbers<T: FromStr>(&mut self, what: &str, least: usize) -> Result<Vec<T>> {
        let line = self.need(what)?;
        let numbers: Vec<T> = line.split_whitespace().map(|word| self.parse(word, what)).collect::<Result<_>>()?;
        if numbers.len() < least && self.ended() {
            return Err(self.error(format!("the file ends early, within {what}")));
        }
        if numbers.len() < least {
            return Err(self.error(format!("{} numbers are too few for {what}, which needs {least}", numbers.len())));
        }
        Ok(numbers)
    }

    /// Reads the next word, on this line or a later one; `what` is what the word belongs to, for use in an error.
    pub(super) fn word(&mut self, what: &str) -> Result<&'a str> {
        let rest = &self.bytes[self.at..];
        let blank = rest.iter().position(|byte| !byte.is_ascii_whitespace()).unwrap_or(rest.len());
        let length = rest[blank..].iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len() - blank);
        self.mark = self.at + blank;
        self.at = self.mark + length;
        match std::str::from_utf8(&rest[blank..blank + length]) {
            Ok("") => Err(self.error(format!("the file ends early, within {what}"))),
            word => Ok(word.unwrap_or("\u{fffd}")),
        }
    }

    /// The next word, without reading past it; empty if there is none or it is not UTF-8.
    pub(super) fn peek_word(&self) -> &'a str {
        let rest = self.bytes[self.at..].trim_ascii_start();
        let length = rest.iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len());
        std::str::from_utf8(&rest[..length]).unwrap_or_default()
    }

    /// Reads the next `count` bytes.
    pub(super) fn take(&mut self, count: usize, what: &str) -> Result<&'a [u8]> {
        self.mark = self.at;
        let taken = self.at.checked_add(count).and_then(|end| self.bytes.get(self.at..end));
        let taken = taken.ok_or_else(|| self.error(format!("the file ends early, within {what}")))?;
        self.at += count;
        Ok(taken)
    }

    /// Reads the bytes of a number, and returns them with the least significant byte first.
    fn array<const N: usize>(&mut self, what: &str) -> Result<[u8; N]> {
        let mut array = [0; N];
        array.copy_from_slice(self.take(N, what)?);
        if self.order == Some(Order::Big) {
            array.reverse();
        }
        Ok(array)
    }

    /// Reads a binary integer of at most eight bytes.
    pub(super) fn integer(&mut self, bytes: usize, signed: bool, what: &str) -> Result<i64> {
        let mut taken = self.take(bytes, what)?.to_vec();
        if self.order == Some(Order::Big) {
            taken.reverse();
        }
        let start = if signed && taken.last().is_some_and(|byte| *byte >= 0x80) { -1 } else { 0 };
        Ok(taken.iter().rev().fold(start, |number, byte| number << 8 | i64::from(*byte)))
    }

    /// Reads a four-byte binary integer.
    pub(super) fn i32(&mut self, what: &str) -> Result<i32> {
        self.array(what).map(i32::from_le_bytes)
    }

    /// Reads an eight-byte binary integer.
    pub(super) fn i64(&mut self, what: &str) -> Result<i64> {
        self.array(what).map(i64::from_le_bytes)
    }

    /// Reads a four-byte binary floating-point number.
    pub(super) fn f32(&mut self, what: &str) -> Result<f64> {
        self.array(what).map(f32::from_le_bytes).map(f64::from)
    }

    /// Reads an eight-byte binary floating-point number.
    pub(super) fn f64(&mut self, what: &str) -> Result<f64> {
        self.array(what).map(f64::from_le_bytes)
    }

    /// The position of a node; its coordinates are the first three numbers of `words`.
    pub(super) fn point(&self, words: &[f64]) -> Result<DVec3> {
        match words {
            [x, y, z, ..] if words[..3].iter().all(|c| c.is_finite() && c.abs() <= LARGEST) => {
                Ok(DVec3::new(*x, *y, *z))
            }
            [_, _, _, ..] => Err(self.error("a node's coordinate is not a finite number in range")),
            _ => Err(self.error("a node needs three coordinates")),
        }
    }

    /// Converts a number that must not be negative; `what` says what the number is, such as a count or an index.
    pub(super) fn natural(&self, number: i64, what: &str) -> Result<u64> {
        u64::try_from(number).map_err(|_| self.error(format!("{number} is not valid for {what}")))
    }
}
