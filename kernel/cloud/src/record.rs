//! Numbers of a declared kind, at a declared place.

use crate::Fault;

/// A kind of number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Number {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
}

impl Number {
    pub(crate) fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I64 | Self::U64 | Self::F64 => 8,
        }
    }

    /// The number at the start of some bytes.
    pub(crate) fn read(self, bytes: &[u8], little: bool) -> Option<f64> {
        let mut raw = [0_u8; 8];
        let n = self.size();
        raw[..n].copy_from_slice(bytes.get(..n)?);
        if !little {
            raw[..n].reverse();
        }
        let word = u64::from_le_bytes(raw);
        Some(match self {
            Self::I8 => f64::from(word as i8),
            Self::U8 => f64::from(word as u8),
            Self::I16 => f64::from(word as i16),
            Self::U16 => f64::from(word as u16),
            Self::I32 => f64::from(word as i32),
            Self::U32 => f64::from(word as u32),
            Self::I64 => word as i64 as f64,
            Self::U64 => word as f64,
            Self::F32 => f64::from(f32::from_bits(word as u32)),
            Self::F64 => f64::from_bits(word),
        })
    }
}

/// A count from a header.
pub(crate) fn count(word: &str, line: usize, what: &str) -> Result<usize, Fault> {
    word.parse().map_err(|_| Fault::at(line, format!("'{}' is not a number of {what}", excerpt(word))))
}

/// The start of a text, for messages.
pub(crate) fn excerpt(text: &str) -> String {
    text.chars().filter(|c| !c.is_control()).take(40).collect()
}
