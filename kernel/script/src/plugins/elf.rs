//! Is a shared library as long as its own header says?
//!
//! The system's loader maps the segments that the program header names without comparing them with the file's length; the
//! first touch of a page behind the end raises SIGBUS, which nothing can catch. So the lengths are compared here first.
//! Layout: System V ABI, chapter 4 "Object files", with the 64-bit sizes of the ELF-64 object file format.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

const PT_LOAD: u32 = 1;
/// Sizes of a file header and of a program header.
const HEADER: usize = 64;
const PROGRAM_HEADER: usize = 56;

/// `Err` says what is wrong. A library of another format than 64-bit little-endian ELF is left to the system's loader.
pub(super) fn check_whole(path: &Path) -> Result<(), String> {
    let mut file = File::open(path).map_err(|e| format!("cannot be read: {e}"))?;
    let length = file.metadata().map_err(|e| format!("cannot be read: {e}"))?.len();
    let short = |needed: u64| format!("is cut short: it has {length} bytes and needs {needed}");
    let mut header = [0; HEADER];
    if length < HEADER as u64 {
        return Err(short(HEADER as u64));
    }
    file.read_exact(&mut header).map_err(|e| format!("cannot be read: {e}"))?;
    // 0x7f 'E' 'L' 'F', class 2 (64 bits), data 1 (little-endian).
    if header[..6] != [0x7f, b'E', b'L', b'F', 2, 1] {
        return Ok(());
    }
    // The section headers mostly stand last: a file that ends before them was cut, though it might still run.
    let sections = word64(&header, 40).saturating_add(u64::from(word16(&header, 58)) * u64::from(word16(&header, 60)));
    if sections > length {
        return Err(short(sections));
    }
    let table = word64(&header, 32);
    let (size, count) = (word16(&header, 54), word16(&header, 56));
    let end = table.saturating_add(u64::from(size) * u64::from(count));
    if (size as usize) < PROGRAM_HEADER || end > length {
        return Err(short(end));
    }
    file.seek(SeekFrom::Start(table)).map_err(|e| format!("cannot be read: {e}"))?;
    for _ in 0..count {
        let mut entry = vec![0; size as usize];
        file.read_exact(&mut entry).map_err(|e| format!("cannot be read: {e}"))?;
        let end = word64(&entry, 8).saturating_add(word64(&entry, 32));
        if word32(&entry, 0) == PT_LOAD && end > length {
            return Err(short(end));
        }
    }
    Ok(())
}

fn word16(bytes: &[u8], at: usize) -> u16 {
    u16::from_le_bytes(array(bytes, at))
}

fn word32(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(array(bytes, at))
}

fn word64(bytes: &[u8], at: usize) -> u64 {
    u64::from_le_bytes(array(bytes, at))
}

fn array<const N: usize>(bytes: &[u8], at: usize) -> [u8; N] {
    let mut word = [0; N];
    word.copy_from_slice(&bytes[at..at + N]);
    word
}
