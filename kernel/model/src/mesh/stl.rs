//! STL: 80 bytes of anything, a count, and 50 bytes a triangle (normal, three corners, two unused bytes; little-endian
//! f32); or the same as text. The stored normals are not used: they follow from the corners.

use super::{MeshError, TRIANGLES, TriangleMesh, Welder};

pub(super) fn parse(bytes: &[u8]) -> Result<TriangleMesh, MeshError> {
    // Binary files may begin with "solid" too: the length decides.
    let count = bytes.get(80..84).and_then(|b| b.try_into().ok()).map(u32::from_le_bytes);
    let expected = count.map(|n| 84 + 50 * u64::from(n));
    if bytes.trim_ascii_start().starts_with(b"solid") && expected != Some(bytes.len() as u64) {
        return match std::str::from_utf8(bytes) {
            Ok(text) => ascii(text),
            Err(_) => Err("begins like an ascii STL, but is neither text nor a whole binary STL".to_owned().into()),
        };
    }
    let count = count.ok_or_else(|| format!("has {} bytes; even an empty STL has 84", bytes.len()))? as usize;
    if count > TRIANGLES {
        return Err(format!("says that it has {count} triangles; at most {TRIANGLES} are read").into());
    }
    let body = bytes.get(84..).unwrap_or_default();
    // Some programs append data of their own: only missing bytes are an error.
    if body.len() < count * 50 {
        let held = body.len() / 50;
        return Err(format!("is cut off: it says that it has {count} triangles, but holds {held}").into());
    }
    let mut welder = Welder::default();
    for record in body.chunks_exact(50).take(count) {
        let coordinate = |i: usize| {
            record.get(12 + 4 * i..16 + 4 * i).and_then(|b| b.try_into().ok()).map_or(f64::NAN, |b| f64::from(f32::from_le_bytes(b)))
        };
        let corner = |k: usize| [coordinate(3 * k), coordinate(3 * k + 1), coordinate(3 * k + 2)];
        welder.triangle([corner(0), corner(1), corner(2)])?;
    }
    Ok(welder.finish()?)
}

fn ascii(text: &str) -> Result<TriangleMesh, MeshError> {
    let mut welder = Welder::default();
    let mut corners: Vec<[f64; 3]> = Vec::new();
    let mut ended = false;
    for (i, line) in text.lines().enumerate() {
        let fail = |message: String| MeshError { line: Some(i + 1), message };
        let mut words = line.split_whitespace();
        match words.next() {
            Some("vertex") => corners.push(three_numbers(words).map_err(fail)?),
            Some("endfacet") => {
                let [a, b, c] = corners[..] else {
                    return Err(fail(format!("a facet has {} corners instead of 3", corners.len())));
                };
                welder.triangle([a, b, c]).map_err(fail)?;
                corners.clear();
            }
            Some("endsolid") => ended = true,
            Some("solid" | "facet" | "outer" | "endloop") | None => {}
            Some(other) => return Err(fail(format!("'{}' is not a word of an ascii STL", other.chars().take(24).collect::<String>()))),
        }
    }
    if !ended || !corners.is_empty() {
        return Err("is cut off: it has no 'endsolid'".to_owned().into());
    }
    Ok(welder.finish()?)
}

/// Exactly three numbers; more words are passed over (an OBJ's vertex may carry a colour).
pub(super) fn three_numbers<'a>(words: impl Iterator<Item = &'a str>) -> Result<[f64; 3], String> {
    let mut p = [0.0; 3];
    let mut count = 0;
    for (slot, word) in p.iter_mut().zip(words) {
        *slot = word.parse().map_err(|_| format!("'{}' is not a number", word.chars().take(24).collect::<String>()))?;
        count += 1;
    }
    if count == 3 { Ok(p) } else { Err(format!("a corner has {count} coordinates instead of 3")) }
}

pub(super) fn write(mesh: &TriangleMesh) -> Vec<u8> {
    let mut out = Vec::with_capacity(84 + 50 * mesh.triangles.len());
    out.extend_from_slice(b"binary STL, metres");
    out.resize(80, b' ');
    out.extend_from_slice(&(mesh.triangles.len() as u32).to_le_bytes());
    for t in &mesh.triangles {
        let [a, b, c] = t.map(|i| mesh.vertices[i as usize].coords);
        let normal = (b - a).cross(&(c - a)).try_normalize(0.0).unwrap_or_default();
        for v in [normal, a, b, c] {
            for x in v.iter() {
                out.extend_from_slice(&(*x as f32).to_le_bytes());
            }
        }
        out.extend_from_slice(&[0, 0]);
    }
    out
}
