//! LZF, the compression of PCD (Lehmann's liblzf): runs of literal bytes, and copies of what was written before.

use crate::Fault;

/// Unpacks to exactly `length` bytes.
pub(crate) fn unpack(packed: &[u8], length: usize) -> Result<Vec<u8>, Fault> {
    let broken = || Fault::new("its compressed data is broken: it does not unpack to the length that it announces");
    // A copy takes 3 bytes and makes at most 264.
    if length > packed.len().saturating_mul(264) {
        return Err(broken());
    }
    let mut out: Vec<u8> = Vec::with_capacity(length);
    let mut rest = packed.iter().copied();
    while let Some(control) = rest.next() {
        let control = usize::from(control);
        if control < 32 {
            for _ in 0..=control {
                out.push(rest.next().ok_or_else(broken)?);
            }
        } else {
            let mut run = control >> 5;
            if run == 7 {
                run += usize::from(rest.next().ok_or_else(broken)?);
            }
            let back = ((control & 31) << 8) + usize::from(rest.next().ok_or_else(broken)?) + 1;
            let from = out.len().checked_sub(back).ok_or_else(broken)?;
            for i in 0..run + 2 {
                out.push(out[from + i]);
            }
        }
        if out.len() > length {
            return Err(broken());
        }
    }
    if out.len() == length { Ok(out) } else { Err(broken()) }
}
