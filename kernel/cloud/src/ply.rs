//! PLY (Turk 1994): a text header that declares elements and their properties, then the elements.

use std::io::Write;
use std::path::Path;

use nalgebra::Point3;

use crate::record::{Number, count, excerpt};
use crate::{CloudError, Fault, POINTS, ascii};

#[derive(Debug, Clone, Copy, PartialEq)]
enum Format {
    Ascii,
    Binary { little: bool },
}

#[derive(Debug)]
enum Property {
    Scalar(String, Number),
    List { count: Number, item: Number },
}

#[derive(Debug)]
struct Element {
    name: String,
    count: usize,
    properties: Vec<Property>,
}

fn number(word: &str, line: usize) -> Result<Number, Fault> {
    Ok(match word {
        "char" | "int8" => Number::I8,
        "uchar" | "uint8" => Number::U8,
        "short" | "int16" => Number::I16,
        "ushort" | "uint16" => Number::U16,
        "int" | "int32" => Number::I32,
        "uint" | "uint32" => Number::U32,
        "float" | "float32" => Number::F32,
        "double" | "float64" => Number::F64,
        other => return Err(Fault::at(line, format!("'{}' is not a kind of number of PLY", excerpt(other)))),
    })
}

/// The header: format, elements, the number of its lines, and where the body begins.
fn header(bytes: &[u8]) -> Result<(Format, Vec<Element>, usize, usize), Fault> {
    let mut format = None;
    let mut elements: Vec<Element> = Vec::new();
    let (mut at, mut line) = (0, 0);
    loop {
        let rest = bytes.get(at..).unwrap_or_default();
        let Some(end) = rest.iter().take(4096).position(|b| *b == b'\n') else {
            return Err(Fault::new("has no 'end_header'; the file is cut off or not a PLY"));
        };
        let text = String::from_utf8_lossy(&rest[..end]);
        at += end + 1;
        line += 1;
        if line > 1000 {
            return Err(Fault::new("has a header of more than 1000 lines"));
        }
        let words: Vec<&str> = text.split_ascii_whitespace().collect();
        match words[..] {
            ["ply"] | ["comment" | "obj_info", ..] | [] => {}
            ["format", kind, ..] => {
                format = Some(match kind {
                    "ascii" => Format::Ascii,
                    "binary_little_endian" => Format::Binary { little: true },
                    "binary_big_endian" => Format::Binary { little: false },
                    other => return Err(Fault::at(line, format!("the format '{}' is not read", excerpt(other)))),
                });
            }
            ["element", name, n] => {
                elements.push(Element { name: name.to_owned(), count: count(n, line, "elements")?, properties: Vec::new() })
            }
            ["property", ref property @ ..] => {
                let Some(element) = elements.last_mut() else { return Err(Fault::at(line, "a property stands before any element")) };
                element.properties.push(match *property {
                    ["list", count, item, _] => Property::List { count: number(count, line)?, item: number(item, line)? },
                    [kind, name] => Property::Scalar(name.to_owned(), number(kind, line)?),
                    _ => return Err(Fault::at(line, "a property is 'property KIND NAME' or 'property list KIND KIND NAME'")),
                });
            }
            ["end_header"] => {
                let format = format.ok_or_else(|| Fault::at(line, "the header names no format"))?;
                return Ok((format, elements, line, at));
            }
            _ => return Err(Fault::at(line, format!("'{}' is not a line of a PLY header", excerpt(&text)))),
        }
    }
}

pub(crate) fn parse(bytes: &[u8]) -> Result<Vec<Point3<f64>>, Fault> {
    let (format, elements, mut line, at) = header(bytes)?;
    let mut body = bytes.get(at..).unwrap_or_default();
    for element in &elements {
        if element.name == "vertex" {
            let cut = |held: usize| Fault::new(format!("is cut off: it says that it has {} points, but holds {held}", element.count));
            if element.count > POINTS {
                let held = match (format, record(element)) {
                    (Format::Ascii, _) | (_, None) => ascii::held(body),
                    (Format::Binary { .. }, Some(size)) => body.len() / size.max(1),
                };
                return Err(match element.count > held {
                    true => cut(held),
                    false => Fault::new(format!("has {} points; at most {POINTS} are read", element.count)),
                });
            }
            let place = |name: &str| element.properties.iter().position(|p| matches!(p, Property::Scalar(n, _) if n == name));
            let (Some(x), Some(y), Some(z)) = (place("x"), place("y"), place("z")) else {
                return Err(Fault::new("its vertices have no x, y and z"));
            };
            if format == Format::Ascii {
                if element.properties.iter().any(|p| matches!(p, Property::List { .. })) {
                    return Err(Fault::new("its vertices hold lists, which are not read in text"));
                }
                let rows = after(&elements).map(|e| e.count).fold(0, usize::saturating_add);
                return ascii::points(body, line, (element.count, rows), element.properties.len(), [x, y, z]);
            }
            let Format::Binary { little } = format else { return Err(Fault::new("has no format")) };
            let Some(size) = record(element) else { return Err(Fault::new("its vertices hold lists, which are not read")) };
            if body.len() / size.max(1) < element.count {
                return Err(cut(body.len() / size.max(1)));
            }
            // Faces that are cut off are none of ours; what follows all that was announced is.
            let left = after(&elements).try_fold(&body[size * element.count..], |body, e| skip(body, e, little)).map_or(0, <[u8]>::len);
            if left >= size.max(1) {
                return Err(Fault::more(element.count, &format!("{left} bytes")));
            }
            let offsets = [x, y, z].map(|k| {
                let before =
                    element.properties[..k].iter().map(|p| if let Property::Scalar(_, n) = p { n.size() } else { 0 }).sum::<usize>();
                let kind = if let Property::Scalar(_, n) = &element.properties[k] { *n } else { Number::F32 };
                (before, kind)
            });
            let read = |r: &[u8], (o, n): (usize, Number)| r.get(o..).and_then(|b| n.read(b, little)).unwrap_or(f64::NAN);
            return Ok(body.chunks_exact(size).take(element.count).map(|r| Point3::from(offsets.map(|o| read(r, o)))).collect());
        }
        // Step over what stands before the vertices.
        match format {
            Format::Ascii => {
                for _ in 0..element.count {
                    let Some(end) = body.iter().position(|b| *b == b'\n') else {
                        return Err(Fault::new(format!("is cut off within its '{}'", excerpt(&element.name))));
                    };
                    body = &body[end + 1..];
                    line += 1;
                }
            }
            Format::Binary { little } => body = skip(body, element, little)?,
        }
    }
    Err(Fault::new("has no element 'vertex'"))
}

/// The elements behind the vertices.
fn after(elements: &[Element]) -> impl Iterator<Item = &Element> {
    elements.iter().skip_while(|e| e.name != "vertex").skip(1)
}

/// Bytes of one element, if it is always the same.
fn record(element: &Element) -> Option<usize> {
    element.properties.iter().map(|p| if let Property::Scalar(_, n) = p { Some(n.size()) } else { None }).sum()
}

fn skip<'a>(mut body: &'a [u8], element: &Element, little: bool) -> Result<&'a [u8], Fault> {
    let cut = || Fault::new(format!("is cut off within its '{}'", excerpt(&element.name)));
    if let Some(size) = record(element) {
        return body.get(size.checked_mul(element.count).ok_or_else(cut)?..).ok_or_else(cut);
    }
    for _ in 0..element.count {
        for property in &element.properties {
            let size = match property {
                Property::Scalar(_, n) => n.size(),
                Property::List { count, item } => {
                    let n = count.read(body, little).filter(|n| *n >= 0.0).ok_or_else(cut)?;
                    body = body.get(count.size()..).ok_or_else(cut)?;
                    (n as usize).checked_mul(item.size()).ok_or_else(cut)?
                }
            };
            body = body.get(size..).ok_or_else(cut)?;
        }
    }
    Ok(body)
}

/// Writes points with an integer `part` each, as a binary PLY: in the order given, all of them.
///
/// Errors: a file that cannot be written.
pub fn write_parts(path: &Path, points: &[Point3<f64>], parts: &[i32]) -> Result<(), CloudError> {
    let write = || {
        let mut out = std::io::BufWriter::new(std::fs::File::create(path)?);
        let n = points.len();
        write!(
            out,
            "ply\nformat binary_little_endian 1.0\nelement vertex {n}\nproperty double x\nproperty double y\nproperty double z\nproperty int part\nend_header\n"
        )?;
        for (p, part) in points.iter().zip(parts.iter().chain(std::iter::repeat(&-1))) {
            for k in 0..3 {
                out.write_all(&p[k].to_le_bytes())?;
            }
            out.write_all(&part.to_le_bytes())?;
        }
        out.flush()
    };
    write().map_err(|source| CloudError::File { path: path.to_owned(), source })
}
