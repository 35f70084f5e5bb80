//! The records of an MCAP file, one after another, as far as the file goes.
//!
//! MCAP (mcap.dev/spec): eight bytes of magic, records (an opcode, a length of 64 bits, a body), the magic again. Messages stand in
//! chunks that may be packed with LZ4 or zstd. A file that was cut off has no footer and no index: it is read from the front.

use std::io::Read;

use mcap::records::{Record, op};
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};
use mcap::{MAGIC, McapError, parse_record};

/// No chunk is larger than this when it is unpacked, bytes.
const LARGEST_CHUNK: usize = 256 << 20;

/// Where a file ends too early.
#[derive(Debug, Clone, PartialEq)]
pub struct Cut {
    /// Byte at which the last record that is not whole begins.
    pub offset: u64,
    /// What is missing.
    pub message: String,
}

/// Hands every record of a file to `take`, those inside chunks in place of the chunks, each with the byte at which it or its chunk
/// begins. Says where the file ends too early, if it does.
///
/// Errors: those of `take`, and what `broken` makes of the byte and the sentence that tell what is wrong with the file.
pub fn records<E>(
    bytes: &[u8],
    broken: impl Fn(u64, String) -> E,
    mut take: impl FnMut(Record<'_>, u64) -> Result<(), E>,
) -> Result<Option<Cut>, E> {
    if !bytes.starts_with(MAGIC) {
        let message = if MAGIC.starts_with(bytes) {
            "the file ends before it has begun; the run was stopped as it started".to_owned()
        } else {
            "this is not an MCAP file: its first eight bytes are not the format's magic".to_owned()
        };
        return Err(broken(0, message));
    }
    let mut at = MAGIC.len();
    loop {
        let rest = &bytes[at..];
        if rest == MAGIC {
            return Ok(None);
        }
        let offset = at as u64;
        let cut = |message: String| Ok(Some(Cut { offset, message }));
        let Some((&opcode, body)) = rest.split_first() else { return cut("the closing magic is missing".into()) };
        let length = body.get(..8).and_then(|l| l.try_into().ok()).map(u64::from_le_bytes);
        let Some(length) = length else { return cut("the file ends in the length of a record".into()) };
        let body = &body[8..];
        let Some(body) = usize::try_from(length).ok().and_then(|l| body.get(..l)) else {
            let message = format!("a record of {length} bytes ends after {}", body.len());
            if opcode == op::CHUNK
                && let Ok(chunk) = ChunkRecords::new(rest, false)
            {
                // What a chunk that is cut off still gives.
                for inner in chunk.map_while(Result::ok) {
                    take(inner, offset)?;
                }
            }
            return cut(message);
        };
        let record = parse_record(opcode, body).map_err(|e| broken(offset, format!("a record cannot be read: {e}")))?;
        let is_footer = matches!(record, Record::Footer(_));
        match record {
            Record::Chunk { .. } => {
                let bad = |e: McapError| broken(offset, format!("a chunk cannot be read: {e}"));
                for inner in ChunkRecords::new(&rest[..9 + body.len()], true).map_err(|m| broken(offset, m))? {
                    take(inner.map_err(bad)?, offset)?;
                }
            }
            other => take(other, offset)?,
        }
        at += 9 + body.len();
        if is_footer && &bytes[at..] != MAGIC {
            return Ok(Some(Cut { offset: at as u64, message: "the closing magic is missing or wrong".into() }));
        }
    }
}

/// The records inside one chunk. Lengths that the file claims are bounded before anything is reserved for them.
struct ChunkRecords<'a> {
    rest: std::borrow::Cow<'a, [u8]>,
    at: usize,
    reader: LinearReader,
}

impl<'a> ChunkRecords<'a> {
    /// `record` is the chunk's whole record, from its opcode on. If it is whole, its checksum is checked first.
    fn new(record: &'a [u8], is_whole: bool) -> Result<Self, String> {
        let mut options =
            LinearReaderOptions::default().with_skip_start_magic(true).with_skip_end_magic(true).with_record_length_limit(LARGEST_CHUNK);
        options.prevalidate_chunk_crcs = is_whole;
        let rest = match Packed::of(record) {
            Some(packed) if packed.compression == "zstd" => packed.unpacked(is_whole)?.into(),
            Some(packed) if !["", "lz4"].contains(&packed.compression) => {
                return Err(format!(
                    "a chunk is packed with '{}'; LZ4, zstd and no packing are read: pack it anew with 'mcap compress --compression lz4'",
                    packed.compression
                ));
            }
            _ => record.into(),
        };
        Ok(Self { rest, at: 0, reader: LinearReader::new_with_options(options) })
    }
}

impl Iterator for ChunkRecords<'_> {
    type Item = Result<Record<'static>, McapError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            match self.reader.next_event()? {
                Ok(LinearReadEvent::ReadRequest(need)) => {
                    let now = &self.rest[self.at..];
                    let count = need.min(now.len());
                    self.reader.insert(count).copy_from_slice(&now[..count]);
                    self.reader.notify_read(count);
                    self.at += count;
                }
                Ok(LinearReadEvent::Record { data, opcode }) => return Some(parse_record(opcode, data).map(Record::into_owned)),
                Err(e) => return Some(Err(e)),
            }
        }
    }
}

/// What stands around a chunk's packed bytes: opcode and length (9 bytes), two times, unpacked size, checksum (28), the name of the
/// packing, the packed size, the bytes.
struct Packed<'a> {
    numbers: &'a [u8],
    compression: &'a str,
    data: &'a [u8],
}

impl<'a> Packed<'a> {
    fn of(record: &'a [u8]) -> Option<Self> {
        let numbers = record.get(9..37)?;
        let length = u32::from_le_bytes(record.get(37..41)?.try_into().ok()?) as usize;
        let compression = std::str::from_utf8(record.get(41..41usize.checked_add(length)?)?).ok()?;
        Some(Self { numbers, compression, data: record.get(41 + length + 8..)? })
    }

    /// The same chunk without packing. mcap's own reader then checks and reads it; its zstd would be a large build in C.
    fn unpacked(&self, is_whole: bool) -> Result<Vec<u8>, String> {
        let mut data = Vec::new();
        let bad = |e: &dyn std::fmt::Display| format!("a chunk that is packed with zstd cannot be unpacked: {e}");
        let read = ruzstd::decoding::StreamingDecoder::new(self.data)
            .map_err(|e| bad(&e))
            .and_then(|d| d.take(LARGEST_CHUNK as u64).read_to_end(&mut data).map_err(|e| bad(&e)));
        if is_whole {
            read?;
        }
        let length = if is_whole { data.len() } else { LARGEST_CHUNK / 2 } as u64;
        let mut record = vec![op::CHUNK];
        record.extend((self.numbers.len() as u64 + 4 + 8 + length).to_le_bytes());
        record.extend(self.numbers);
        record.extend(0u32.to_le_bytes());
        record.extend(length.to_le_bytes());
        record.extend(data);
        Ok(record)
    }
}
