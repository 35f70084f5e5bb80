//! A scanner for the small part of XML that URDF needs. It runs before any other parser sees a text: it bounds size,
//! depth and number of elements, refuses document types and entities of one's own (the ways in which XML parsers are
//! made to run out of time or memory, for example RUSTSEC-2026-0194 and -0195), and remembers on which line each
//! element stands, so that later messages can say where.

/// Greatest depth of elements; URDF needs six.
const DEPTH: usize = 32;
/// Greatest number of elements.
const ELEMENTS: usize = 200_000;
/// Greatest number of attributes of an element.
const ATTRIBUTES: usize = 64;

/// One element, in the order of the text.
#[derive(Debug)]
pub(crate) struct Element {
    pub(crate) name: String,
    pub(crate) attributes: Vec<(String, String)>,
    /// Counted from 1.
    pub(crate) line: usize,
    /// Index of the element around it.
    pub(crate) parent: Option<usize>,
}

impl Element {
    pub(crate) fn attribute(&self, name: &str) -> Option<&str> {
        self.attributes.iter().find(|(n, _)| n == name).map(|(_, v)| v.as_str())
    }
}

/// What is wrong, and on which line.
#[derive(Debug)]
pub(crate) struct XmlError {
    pub(crate) line: usize,
    pub(crate) message: String,
}

struct Scanner<'a> {
    text: &'a str,
    at: usize,
    line: usize,
}

/// Scans a whole document.
pub(crate) fn scan(text: &str) -> Result<Vec<Element>, XmlError> {
    let mut s = Scanner { text, at: 0, line: 1 };
    let mut elements: Vec<Element> = Vec::new();
    let mut open: Vec<usize> = Vec::new();
    loop {
        let line = s.line;
        let content = s.until('<');
        if open.is_empty() && !content.trim().is_empty() {
            let line = line + content.bytes().take_while(u8::is_ascii_whitespace).filter(|b| *b == b'\n').count();
            return Err(XmlError { line, message: format!("'{}' stands outside the document's element", excerpt(content)) });
        }
        s.decode(content)?;
        if s.rest().is_empty() {
            break;
        }
        if s.skip("<!--") {
            s.through("-->", "a comment is not closed; end it with '-->'")?;
        } else if s.skip("<?") {
            s.through("?>", "a processing instruction is not closed; end it with '?>'")?;
        } else if s.rest().starts_with("<!") {
            return Err(s.error("document types, entities and CDATA are not read; remove the '<!...' part".into()));
        } else if s.skip("</") {
            let name = s.name()?;
            s.whitespace();
            s.expect('>')?;
            match open.pop() {
                Some(i) if elements[i].name == name => {}
                Some(i) => {
                    let Element { name: opened, line, .. } = &elements[i];
                    return Err(s.error(format!("</{name}> closes <{opened}> of line {line}; close that one first")));
                }
                None => return Err(s.error(format!("</{name}> closes nothing"))),
            }
        } else {
            let line = s.line;
            s.expect('<')?;
            let name = s.name()?;
            if open.is_empty() && !elements.is_empty() {
                return Err(s.error(format!("<{name}> stands after the end of the document's element; there can be only one")));
            }
            let (attributes, closed) = s.attributes(&name)?;
            if elements.len() == ELEMENTS || open.len() == DEPTH {
                return Err(s.error(format!("has more than {ELEMENTS} elements, or more than {DEPTH} inside one another")));
            }
            elements.push(Element { name, attributes, line, parent: open.last().copied() });
            if !closed {
                open.push(elements.len() - 1);
            }
        }
    }
    match open.last() {
        Some(&i) => Err(XmlError { line: elements[i].line, message: format!("<{}> is never closed", elements[i].name) }),
        None if elements.is_empty() => Err(XmlError { line: 1, message: "holds no element".into() }),
        None => Ok(elements),
    }
}

impl<'a> Scanner<'a> {
    fn rest(&self) -> &'a str {
        &self.text[self.at..]
    }

    fn error(&self, message: String) -> XmlError {
        XmlError { line: self.line, message }
    }

    fn advance(&mut self, bytes: usize) -> &'a str {
        let taken = &self.rest()[..bytes];
        self.line += taken.bytes().filter(|b| *b == b'\n').count();
        self.at += bytes;
        taken
    }

    fn until(&mut self, stop: char) -> &'a str {
        self.advance(self.rest().find(stop).unwrap_or(self.rest().len()))
    }

    fn skip(&mut self, prefix: &str) -> bool {
        let found = self.rest().starts_with(prefix);
        if found {
            self.advance(prefix.len());
        }
        found
    }

    fn through(&mut self, end: &str, otherwise: &str) -> Result<(), XmlError> {
        let length = self.rest().find(end).ok_or_else(|| self.error(otherwise.into()))?;
        self.advance(length + end.len());
        Ok(())
    }

    fn whitespace(&mut self) -> bool {
        let length = self.rest().len() - self.rest().trim_start_matches([' ', '\t', '\r', '\n']).len();
        self.advance(length);
        length > 0
    }

    fn expect(&mut self, c: char) -> Result<(), XmlError> {
        if self.rest().starts_with(c) {
            self.advance(c.len_utf8());
            return Ok(());
        }
        Err(self.error(format!("expected '{c}', found '{}'", excerpt(self.rest()))))
    }

    fn name(&mut self) -> Result<String, XmlError> {
        let inside = |c: char| c.is_alphanumeric() || matches!(c, '_' | '-' | '.' | ':');
        let length = self.rest().find(|c| !inside(c)).unwrap_or(self.rest().len());
        let name = &self.rest()[..length];
        if !name.starts_with(|c: char| c.is_alphabetic() || c == '_') {
            return Err(self.error(format!("expected a name, found '{}'", excerpt(self.rest()))));
        }
        Ok(self.advance(length).to_owned())
    }

    /// The attributes of a start tag up to its end, and whether it closes itself.
    fn attributes(&mut self, element: &str) -> Result<(Vec<(String, String)>, bool), XmlError> {
        let mut attributes: Vec<(String, String)> = Vec::new();
        loop {
            let space = self.whitespace();
            if self.skip("/>") {
                return Ok((attributes, true));
            }
            if self.skip(">") {
                return Ok((attributes, false));
            }
            if !space || self.rest().is_empty() {
                return Err(self.error(format!("<{element}> is not closed; expected '>', found '{}'", excerpt(self.rest()))));
            }
            let name = self.name()?;
            self.whitespace();
            self.expect('=')?;
            self.whitespace();
            let quote = if self.rest().starts_with('\'') { '\'' } else { '"' };
            self.expect(quote)?;
            let start = self.line;
            let raw = self.until(quote);
            if raw.contains('<') || self.rest().is_empty() {
                return Err(XmlError { line: start, message: format!("the value of {name} in <{element}> has no closing {quote}") });
            }
            let value = self.decode(raw)?;
            self.expect(quote)?;
            if attributes.iter().any(|(n, _)| *n == name) {
                return Err(self.error(format!("<{element}> has two attributes {name}")));
            }
            if attributes.len() == ATTRIBUTES {
                return Err(self.error(format!("<{element}> has more than {ATTRIBUTES} attributes")));
            }
            attributes.push((name, value));
        }
    }

    /// Replaces the five predefined entities and character references; any other is refused.
    fn decode(&self, raw: &str) -> Result<String, XmlError> {
        if let Some(c) = raw.chars().find(|c| c.is_control() && !matches!(c, '\t' | '\r' | '\n')) {
            return Err(self.error(format!("the control character {:#x} cannot stand in XML", u32::from(c))));
        }
        let mut out = String::with_capacity(raw.len());
        let mut parts = raw.split('&');
        out.push_str(parts.next().unwrap_or(""));
        for part in parts {
            let (entity, rest) = part.split_once(';').unwrap_or((excerpt(part), ""));
            let number = |digits: &str, radix| u32::from_str_radix(digits, radix).ok().and_then(char::from_u32).filter(|c| !c.is_control());
            let c = match entity {
                "amp" => Some('&'),
                "lt" => Some('<'),
                "gt" => Some('>'),
                "quot" => Some('"'),
                "apos" => Some('\''),
                _ => match entity.strip_prefix('#') {
                    Some(n) => n.strip_prefix('x').map_or_else(|| number(n, 10), |h| number(h, 16)),
                    None => None,
                },
            };
            out.push(c.ok_or_else(|| self.error(format!("'&{entity}' is not an entity that is read; write '&' as '&amp;'")))?);
            out.push_str(rest);
        }
        Ok(out)
    }
}

/// The beginning of a text, short enough for a message.
fn excerpt(text: &str) -> &str {
    let text = text.trim_start();
    let line = text.lines().next().unwrap_or("");
    line.char_indices().nth(24).map_or(line, |(i, _)| &line[..i])
}
