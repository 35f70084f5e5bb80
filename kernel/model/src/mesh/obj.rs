//! Wavefront OBJ: the `v` and `f` lines. Faces of more corners are cut into a fan; materials, normals and textures are
//! passed over. An index counts from 1, or backwards from the last vertex if it is negative.

use super::stl::three_numbers;
use super::{MeshError, TRIANGLES, TriangleMesh, Welder};

pub(super) fn parse(bytes: &[u8]) -> Result<TriangleMesh, MeshError> {
    let text = std::str::from_utf8(bytes).map_err(|_| "is not text, as an OBJ is".to_owned())?;
    let mut vertices: Vec<[f64; 3]> = Vec::new();
    let mut welder = Welder::default();
    for (i, line) in text.lines().enumerate() {
        let fail = |message: String| MeshError { line: Some(i + 1), message };
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => vertices.push(three_numbers(words).map_err(fail)?),
            Some("f") => {
                let corners = words.map(|w| corner(w, &vertices)).collect::<Result<Vec<_>, _>>().map_err(fail)?;
                let Some((&first, rest)) = corners.split_first().filter(|(_, rest)| rest.len() >= 2) else {
                    return Err(fail(format!("a face has {} corners; it needs at least 3", corners.len())));
                };
                for pair in rest.windows(2) {
                    welder.triangle([first, pair[0], pair[1]]).map_err(fail)?;
                }
            }
            _ => {}
        }
        if vertices.len() > 3 * TRIANGLES {
            return Err(fail(format!("has more than the {} vertices that are read; make it coarser", 3 * TRIANGLES)));
        }
    }
    Ok(welder.finish()?)
}

/// A face's corner: `7`, `7/1`, `7//3` or `7/1/3`; the first number is the vertex.
fn corner(word: &str, vertices: &[[f64; 3]]) -> Result<[f64; 3], String> {
    let shown = || word.chars().take(24).collect::<String>();
    let index: i64 = word.split('/').next().and_then(|n| n.parse().ok()).ok_or_else(|| format!("'{}' is not a face's corner", shown()))?;
    let count = vertices.len() as i64;
    let from_zero = if index < 0 { count.checked_add(index) } else { index.checked_sub(1) };
    from_zero
        .and_then(|i| usize::try_from(i).ok())
        .and_then(|i| vertices.get(i).copied())
        .ok_or_else(|| format!("the corner '{}' names a vertex that does not exist; {count} stand before it", shown()))
}
