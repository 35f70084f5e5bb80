//! Points as lines of text.

use nalgebra::Point3;

use crate::Fault;
use crate::record::excerpt;

/// A number as people's programs write it: C's on Windows writes `-nan(ind)`, `1.#QNAN` and `1.#INF`.
fn number(word: &str) -> Option<f64> {
    let odd = word.contains("nan(") || word.contains(".#");
    if odd { Some(f64::NAN) } else { word.parse().ok() }
}

/// How many lines hold anything.
pub(crate) fn held(body: &[u8]) -> usize {
    body.split(|b| *b == b'\n').filter(|l| !l.trim_ascii().is_empty()).count()
}

/// Reads `count` points of `width` words a line, of which three are the coordinates, starting with the line after `line`; `after` lines may
/// follow them.
pub(crate) fn points(
    body: &[u8],
    line: usize,
    (count, after): (usize, usize),
    width: usize,
    at: [usize; 3],
) -> Result<Vec<Point3<f64>>, Fault> {
    let mut points = Vec::new();
    let mut used = 0;
    for (index, raw) in body.split(|b| *b == b'\n').enumerate() {
        if points.len() == count {
            break;
        }
        used += raw.len() + 1;
        let here = line + index + 1;
        let text = std::str::from_utf8(raw).map_err(|_| Fault::at(here, "is not text; is the file binary?"))?;
        if text.trim().is_empty() {
            continue;
        }
        let mut p = [f64::NAN; 3];
        let mut words = 0;
        for (i, word) in text.split_ascii_whitespace().enumerate() {
            words += 1;
            for (slot, place) in p.iter_mut().zip(at) {
                if place == i {
                    *slot = number(word).ok_or_else(|| Fault::at(here, format!("'{}' is not a number", excerpt(word))))?;
                }
            }
        }
        if words < width {
            return Err(Fault::at(here, format!("has {words} of the {width} values that the header announces")));
        }
        points.push(Point3::from(p));
    }
    if points.len() < count {
        return Err(Fault::new(format!("is cut off: it says that it has {count} points, but holds {}", points.len())));
    }
    let left = held(&body[used.min(body.len())..]);
    if left > after { Err(Fault::more(count, &format!("{} lines", left - after))) } else { Ok(points) }
}
