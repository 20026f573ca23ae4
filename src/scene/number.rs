//! Types of the numbers in binary mesh files.

use super::cursor::{Cursor, Order};
use crate::Result;

/// A type of number.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Number {
    /// A whole number.
    Whole {
        /// Its size, at most eight bytes.
        bytes: usize,
        /// Whether it may be negative.
        signed: bool,
    },
    /// A number of single precision.
    Float,
    /// A number of double precision.
    Double,
}

impl Number {
    /// Its size, bytes.
    pub fn bytes(self) -> usize {
        match self {
            Number::Whole { bytes, .. } => bytes,
            Number::Float => 4,
            Number::Double => 8,
        }
    }

    /// The number with these bytes, the least significant first.
    pub fn of(self, bytes: &[u8]) -> f64 {
        let bits = bytes.iter().rev().fold(0_u64, |bits, byte| bits << 8 | u64::from(*byte));
        match self {
            Number::Float => f64::from(f32::from_bits(bits as u32)),
            Number::Double => f64::from_bits(bits),
            Number::Whole { signed: false, .. } => bits as f64,
            Number::Whole { bytes, signed: true } => {
                let unused = 64 - 8 * bytes as u32;
                ((bits << unused) as i64 >> unused) as f64
            }
        }
    }

    /// Reads a number of a binary file; `what` is what it belongs to, for use in an error.
    pub fn read(self, cursor: &mut Cursor, what: &str) -> Result<f64> {
        let mut bytes = [0; 8];
        let bytes = &mut bytes[..self.bytes()];
        bytes.copy_from_slice(cursor.take(self.bytes(), what)?);
        if cursor.order == Some(Order::Big) {
            bytes.reverse();
        }
        Ok(self.of(bytes))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_every_type() {
        let whole = |bytes, signed| Number::Whole { bytes, signed };
        for (number, bytes, value) in [
            (whole(1, true), &[0xfb][..], -5.0),
            (whole(1, false), &[0xfb], 251.0),
            (whole(2, true), &[0xfb, 0xff], -5.0),
            (whole(4, false), &[1, 2, 0, 0], 513.0),
            (whole(8, true), &[0xfb, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff], -5.0),
            (Number::Float, &0.25_f32.to_le_bytes(), 0.25),
            (Number::Double, &(-1.5_f64).to_le_bytes(), -1.5),
        ] {
            assert_eq!((number.bytes(), number.of(bytes)), (bytes.len(), value), "{number:?}");
        }
    }
}
