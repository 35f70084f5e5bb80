//! Common Data Representation as ROS 2 uses it: XCDR1 (OMG DDSI-RTPS 10.2, "plain CDR").
//!
//! A message starts with four bytes: 0, then 1 if its numbers are little-endian and 0 if they are big-endian, then two that
//! say nothing about what follows. A number of n bytes stands at a multiple of n counted from after them. A text is its length
//! with the closing zero as a 32-bit number, its bytes and the zero; a sequence is its length and its elements.

const HEADER: [u8; 4] = [0, 1, 0, 0];

/// Writes one message, little-endian.
#[derive(Debug, Clone)]
pub struct Writer {
    bytes: Vec<u8>,
}

impl Default for Writer {
    fn default() -> Self {
        Self::new()
    }
}

impl Writer {
    /// A message that holds nothing yet.
    pub fn new() -> Self {
        Self { bytes: HEADER.to_vec() }
    }

    fn align(&mut self, to: usize) {
        let at = self.bytes.len() - HEADER.len();
        self.bytes.resize(HEADER.len() + at.next_multiple_of(to), 0);
    }

    /// A whole number of 4 bytes.
    pub fn u32(&mut self, value: u32) -> &mut Self {
        self.align(4);
        self.bytes.extend(value.to_le_bytes());
        self
    }

    /// A number of 8 bytes.
    pub fn f64(&mut self, value: f64) -> &mut Self {
        self.align(8);
        self.bytes.extend(value.to_le_bytes());
        self
    }

    /// A text.
    pub fn text(&mut self, value: &str) -> &mut Self {
        self.u32(value.len() as u32 + 1);
        self.bytes.extend(value.as_bytes());
        self.bytes.push(0);
        self
    }

    /// A sequence of texts.
    pub fn texts<'a>(&mut self, values: impl ExactSizeIterator<Item = &'a str>) -> &mut Self {
        self.u32(values.len() as u32);
        for value in values {
            self.text(value);
        }
        self
    }

    /// A sequence of numbers.
    pub fn f64s(&mut self, values: &[f64]) -> &mut Self {
        self.u32(values.len() as u32);
        for value in values {
            self.f64(*value);
        }
        self
    }

    /// builtin_interfaces/msg/Time, from ns.
    pub fn time(&mut self, nanoseconds: u64) -> &mut Self {
        self.u32((nanoseconds / 1_000_000_000) as u32).u32((nanoseconds % 1_000_000_000) as u32)
    }

    /// The message's bytes.
    pub fn finish(self) -> Vec<u8> {
        self.bytes
    }
}

/// Reads one message. What it says of a message that is not whole is a sentence for a person.
#[derive(Debug, Clone)]
pub struct Reader<'a> {
    bytes: &'a [u8],
    at: usize,
    is_big_endian: bool,
}

impl<'a> Reader<'a> {
    /// The message whose bytes these are.
    pub fn new(bytes: &'a [u8]) -> Result<Self, String> {
        match bytes.split_at_checked(HEADER.len()) {
            Some((&[0, kind @ (0 | 1), _, _], body)) => Ok(Self { bytes: body, at: 0, is_big_endian: kind == 0 }),
            Some((head, _)) => Err(format!("the message starts with {head:?}, which is not plain CDR")),
            None => Err(format!("the message has only {} bytes", bytes.len())),
        }
    }

    fn take(&mut self, count: usize) -> Result<&'a [u8], String> {
        let end = self.at.checked_add(count).filter(|end| *end <= self.bytes.len());
        let end =
            end.ok_or_else(|| format!("the message ends after {} bytes, {count} more were expected at {}", self.bytes.len(), self.at))?;
        let taken = &self.bytes[self.at..end];
        self.at = end;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], String> {
        self.at = self.at.next_multiple_of(N);
        self.take(N)?.try_into().map_err(|_| "the message is cut short".to_owned())
    }

    /// A whole number of 4 bytes.
    pub fn u32(&mut self) -> Result<u32, String> {
        let bytes = self.array()?;
        Ok(if self.is_big_endian { u32::from_be_bytes(bytes) } else { u32::from_le_bytes(bytes) })
    }

    /// A number of 8 bytes.
    pub fn f64(&mut self) -> Result<f64, String> {
        let bytes = self.array()?;
        Ok(if self.is_big_endian { f64::from_be_bytes(bytes) } else { f64::from_le_bytes(bytes) })
    }

    /// A text.
    pub fn text(&mut self) -> Result<String, String> {
        let length = self.u32()? as usize;
        let bytes = self.take(length)?;
        let bytes = bytes.strip_suffix(&[0]).ok_or("a text of the message has no end")?;
        String::from_utf8(bytes.to_vec()).map_err(|_| "a text of the message is not UTF-8".to_owned())
    }

    /// A sequence of texts.
    pub fn texts(&mut self) -> Result<Vec<String>, String> {
        let count = self.u32()?;
        (0..count).map(|_| self.text()).collect()
    }

    /// A sequence of numbers.
    pub fn f64s(&mut self) -> Result<Vec<f64>, String> {
        let count = self.u32()?;
        (0..count).map(|_| self.f64()).collect()
    }

    /// builtin_interfaces/msg/Time, in ns.
    pub fn time(&mut self) -> Result<u64, String> {
        Ok(u64::from(self.u32()?) * 1_000_000_000 + u64::from(self.u32()?))
    }

    /// Nothing may be left.
    pub fn finish(self) -> Result<(), String> {
        // Some writers pad a message to a multiple of four.
        let left = self.bytes.len() - self.at;
        if left < 4 { Ok(()) } else { Err(format!("{left} bytes are left over at the end of the message")) }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn numbers_stand_where_the_standard_puts_them() {
        let mut w = Writer::new();
        w.time(3_000_000_007).text("arm").f64s(&[1.5]);
        // After the header: sec at 0, nanosec at 4, length 4 at 8, "arm\0" at 12, count at 16, padding to 24.
        let expected: Vec<u8> = [
            &[0, 1, 0, 0][..],
            &[3, 0, 0, 0, 7, 0, 0, 0],
            &[4, 0, 0, 0, b'a', b'r', b'm', 0],
            &[1, 0, 0, 0, 0, 0, 0, 0],
            &1.5f64.to_le_bytes(),
        ]
        .concat();
        assert_eq!(w.finish(), expected);
    }

    #[test]
    fn a_message_of_a_big_endian_machine_reads_the_same() {
        let big: Vec<u8> = [
            &[0, 0, 0, 0][..],
            &[0, 0, 0, 3, 0, 0, 0, 7],
            &[0, 0, 0, 4, b'a', b'r', b'm', 0],
            &[0, 0, 0, 1, 0, 0, 0, 0],
            &1.5f64.to_be_bytes(),
        ]
        .concat();
        let mut r = Reader::new(&big).unwrap();
        assert_eq!((r.time().unwrap(), r.text().unwrap(), r.f64s().unwrap()), (3_000_000_007, "arm".to_owned(), vec![1.5]));
        r.finish().unwrap();
        assert!(Reader::new(&[0, 7, 0, 0]).is_err(), "XCDR2 is laid out otherwise");
    }

    #[test]
    fn a_message_cut_anywhere_is_refused_and_a_huge_count_does_not_exhaust_memory() {
        let mut w = Writer::new();
        w.time(1).texts(["a", "bcd"].into_iter()).f64s(&[1.0, -2.0]);
        let whole = w.finish();
        let read = |bytes: &[u8]| -> Result<(Vec<String>, Vec<f64>), String> {
            let mut r = Reader::new(bytes)?;
            r.time()?;
            let out = (r.texts()?, r.f64s()?);
            r.finish()?;
            Ok(out)
        };
        assert_eq!(read(&whole).unwrap(), (vec!["a".to_owned(), "bcd".to_owned()], vec![1.0, -2.0]));
        for cut in 0..whole.len() {
            assert!(read(&whole[..cut]).is_err(), "cut after {cut} bytes");
        }
        let mut huge = whole.clone();
        huge[12..16].copy_from_slice(&u32::MAX.to_le_bytes());
        assert!(read(&huge).is_err());
    }
}
