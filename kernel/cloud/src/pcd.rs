//! PCD, the point cloud library's format, versions 0.6 and 0.7.

use nalgebra::Point3;

use crate::record::{Number, count, excerpt};
use crate::{Fault, POINTS, ascii, lzf};

struct Field {
    name: String,
    number: Number,
    count: usize,
}

pub(crate) fn parse(bytes: &[u8]) -> Result<Vec<Point3<f64>>, Fault> {
    let (mut names, mut sizes, mut kinds, mut counts): (Vec<String>, Vec<usize>, Vec<String>, Vec<usize>) = Default::default();
    let (mut width, mut height, mut points) = (None, None, None);
    let (mut at, mut line) = (0, 0);
    let data = loop {
        let rest = bytes.get(at..).unwrap_or_default();
        let Some(end) = rest.iter().take(65_536).position(|b| *b == b'\n') else {
            return Err(Fault::new("has no line 'DATA'; the file is cut off or not a PCD"));
        };
        let text = String::from_utf8_lossy(&rest[..end]).into_owned();
        at += end + 1;
        line += 1;
        if line > 100 {
            return Err(Fault::new("has a header of more than 100 lines"));
        }
        let words: Vec<&str> = text.split_ascii_whitespace().collect();
        let numbers = |what: &str| words[1..].iter().map(|w| count(w, line, what)).collect::<Result<Vec<_>, _>>();
        match words[..] {
            [] | ["VERSION" | "VIEWPOINT", ..] => {}
            [first, ..] if first.starts_with('#') => {}
            ["FIELDS" | "COLUMNS", ..] => names = words[1..].iter().map(|w| (*w).to_owned()).collect(),
            ["SIZE", ..] => sizes = numbers("bytes")?,
            ["TYPE", ..] => kinds = words[1..].iter().map(|w| (*w).to_owned()).collect(),
            ["COUNT", ..] => counts = numbers("values")?,
            ["WIDTH", n] => width = Some(count(n, line, "points")?),
            ["HEIGHT", n] => height = Some(count(n, line, "points")?),
            ["POINTS", n] => points = Some(count(n, line, "points")?),
            ["DATA", kind] => break kind.to_owned(),
            _ => return Err(Fault::at(line, format!("'{}' is not a line of a PCD header", excerpt(&text)))),
        }
    };
    let n = match (points, width, height) {
        (Some(n), Some(w), Some(h)) if w.checked_mul(h) != Some(n) => {
            return Err(Fault::new(format!("contradicts itself: WIDTH {w} times HEIGHT {h} is not POINTS {n}")));
        }
        (Some(n), ..) => n,
        (None, Some(w), h) => w.checked_mul(h.unwrap_or(1)).ok_or_else(|| Fault::new("has a WIDTH and HEIGHT beyond all bounds"))?,
        _ => return Err(Fault::new("says neither POINTS nor WIDTH")),
    };
    if counts.is_empty() {
        counts = vec![1; names.len()];
    }
    if names.is_empty() || sizes.len() != names.len() || kinds.len() != names.len() || counts.len() != names.len() {
        return Err(Fault::new("has FIELDS, SIZE, TYPE and COUNT of different lengths"));
    }
    let mut fields = Vec::new();
    for i in 0..names.len() {
        let number = match (kinds[i].as_str(), sizes[i]) {
            ("F", 4) => Number::F32,
            ("F", 8) => Number::F64,
            ("I", 1) => Number::I8,
            ("I", 2) => Number::I16,
            ("I", 4) => Number::I32,
            ("I", 8) => Number::I64,
            ("U", 1) => Number::U8,
            ("U", 2) => Number::U16,
            ("U", 4) => Number::U32,
            ("U", 8) => Number::U64,
            (kind, size) => return Err(Fault::new(format!("has a field of TYPE {} and SIZE {size}, which is not read", excerpt(kind)))),
        };
        if counts[i] > 4096 {
            return Err(Fault::new(format!("has a field with a COUNT of {}", counts[i])));
        }
        fields.push(Field { name: names[i].clone(), number, count: counts[i] });
    }
    let place = |name: &str| fields.iter().position(|f| f.name == name && f.count > 0);
    let (Some(x), Some(y), Some(z)) = (place("x"), place("y"), place("z")) else {
        return Err(Fault::new("its FIELDS have no x, y and z"));
    };
    let body = bytes.get(at..).unwrap_or_default();
    let cut = |held: usize| Fault::new(format!("is cut off: it says that it has {n} points, but holds {held}"));
    let size: usize = fields.iter().map(|f| f.number.size() * f.count).sum();
    if n > POINTS {
        let held = match data.as_str() {
            "ascii" => ascii::held(body),
            "binary" => body.len() / size.max(1),
            // What is packed says so itself; more points than bytes it cannot hold.
            _ => body.len(),
        };
        return Err(if n > held { cut(held) } else { Fault::new(format!("has {n} points; at most {POINTS} are read")) });
    }
    let before = |k: usize| fields[..k].iter().map(|f| f.number.size() * f.count).sum::<usize>();
    match data.as_str() {
        "ascii" => {
            let word = |k: usize| fields[..k].iter().map(|f| f.count).sum::<usize>();
            let width = fields.iter().map(|f| f.count).sum();
            ascii::points(body, line, (n, 0), width, [word(x), word(y), word(z)])
        }
        "binary" => {
            if body.len() / size.max(1) < n {
                return Err(cut(body.len() / size.max(1)));
            }
            if body.len() >= (n + 1) * size.max(1) {
                return Err(Fault::more(n, &format!("{} bytes", body.len() - n * size)));
            }
            let read = |r: &[u8], k: usize| r.get(before(k)..).and_then(|b| fields[k].number.read(b, true)).unwrap_or(f64::NAN);
            Ok(body.chunks_exact(size).take(n).map(|r| Point3::new(read(r, x), read(r, y), read(r, z))).collect())
        }
        "binary_compressed" => {
            let word = |o: usize| body.get(o..o + 4).and_then(|b| b.try_into().ok()).map(u32::from_le_bytes).map(|n| n as usize);
            let (Some(packed), Some(unpacked)) = (word(0), word(4)) else { return Err(cut(0)) };
            let Some(bytes) = body.get(8..).and_then(|b| b.get(..packed)) else {
                let held = body.len().saturating_sub(8);
                return Err(Fault::new(format!("is cut off: it says that it has {packed} compressed bytes, but holds {held}")));
            };
            if size.checked_mul(n) != Some(unpacked) {
                return Err(Fault::new(format!(
                    "contradicts itself: {n} points of {size} bytes are not the {unpacked} bytes that it unpacks to"
                )));
            }
            let columns = lzf::unpack(bytes, unpacked)?;
            // Field by field, not point by point.
            let read = |i: usize, k: usize| {
                let start = before(k) * n + i * fields[k].number.size() * fields[k].count;
                columns.get(start..).and_then(|b| fields[k].number.read(b, true)).unwrap_or(f64::NAN)
            };
            Ok((0..n).map(|i| Point3::new(read(i, x), read(i, y), read(i, z))).collect())
        }
        other => Err(Fault::new(format!("has DATA '{}'; ascii, binary and binary_compressed are read", excerpt(other)))),
    }
}
