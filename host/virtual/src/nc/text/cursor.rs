//! A line of a program as its reader sees it: without comments, in capital letters,
//! every character at its column.

use crate::nc::memory::alarm::{Checked, Fault};
use crate::nc::memory::settings::ControlFamily;

/// The longest line, bytes. It also bounds how deep an expression can be.
pub(crate) const MAX_LINE: usize = 1000;

/// A line without comments.
#[derive(Clone, Debug)]
pub(crate) struct Line {
    /// As it was loaded.
    pub raw: Vec<u8>,
    /// Capital letters; blanks where comments were.
    pub clean: Vec<u8>,
    /// The comments, without brackets.
    pub comments: Vec<String>,
    /// Whether small letters stand outside comments and printed text.
    pub has_small_letters: bool,
}

impl Line {
    /// Takes the comments out. What `DPRNT` and `BPRNT` print is left alone.
    pub fn new(text: &str, dialect: ControlFamily) -> Checked<Self> {
        if text.len() > MAX_LINE {
            return Err(Fault::new(format!(
                "line longer than {MAX_LINE} characters: split it"
            )));
        }
        let raw = text.as_bytes().to_vec();
        let mut clean = raw.to_ascii_uppercase();
        let mut comments = Vec::new();
        let mut has_small_letters = false;
        let mut at = 0;
        while let Some(byte) = clean.get(at).copied() {
            if byte == b'(' {
                let end = find(&clean, at, b')')
                    .ok_or_else(|| Fault::new("comment not closed: write `)`").at(at))?;
                comments.push(text_of(&raw, at + 1, end));
                blank(&mut clean, at, end + 1);
                at = end + 1;
            } else if byte == b';' {
                if dialect.is_macro_b() {
                    let rest = clean.get(at + 1..).unwrap_or_default();
                    if !rest.iter().all(u8::is_ascii_whitespace) {
                        return Err(Fault::new(
                            "text behind the end of block `;`: write it on the next line",
                        )
                        .at(at));
                    }
                }
                let end = clean.len();
                blank(&mut clean, at, end);
                at = end;
            } else if dialect.is_macro_b() && is_print(&clean, at) {
                at = end_of_brackets(&clean, at + 5);
            } else {
                has_small_letters |= raw.get(at).is_some_and(u8::is_ascii_lowercase);
                if byte == b'\t' || byte == b'\r' || byte == 0 {
                    blank(&mut clean, at, at + 1);
                } else if !(0x20..0x7F).contains(&byte) {
                    return Err(Fault::new(
                        "character that no control reads: remove it, or move it into a comment",
                    )
                    .at(at));
                }
                at += 1;
            }
        }
        Ok(Self {
            raw,
            clean,
            comments,
            has_small_letters,
        })
    }
}

fn is_print(clean: &[u8], at: usize) -> bool {
    clean
        .get(at..)
        .is_some_and(|rest| rest.starts_with(b"DPRNT") || rest.starts_with(b"BPRNT"))
}

fn find(bytes: &[u8], from: usize, byte: u8) -> Option<usize> {
    let rest = bytes.get(from..)?;
    rest.iter().position(|b| *b == byte).map(|i| from + i)
}

fn blank(bytes: &mut [u8], from: usize, to: usize) {
    if let Some(part) = bytes.get_mut(from..to) {
        part.fill(b' ');
    }
}

fn text_of(bytes: &[u8], from: usize, to: usize) -> String {
    String::from_utf8_lossy(bytes.get(from..to).unwrap_or_default()).into_owned()
}

/// The index behind the bracket that closes the first one from here on; the end of
/// the line if it is not closed.
fn end_of_brackets(bytes: &[u8], from: usize) -> usize {
    let mut depth = 0u32;
    for (i, byte) in bytes.iter().enumerate().skip(from) {
        match byte {
            b'[' => depth += 1,
            b']' => {
                depth = depth.saturating_sub(1);
                if depth == 0 {
                    return i + 1;
                }
            }
            _ => {}
        }
    }
    bytes.len()
}

/// A place in a line.
#[derive(Clone, Debug)]
pub(crate) struct Cursor<'a> {
    line: &'a Line,
    at: usize,
}

impl<'a> Cursor<'a> {
    pub fn new(line: &'a Line) -> Self {
        Self { line, at: 0 }
    }

    /// The index of the next character.
    pub fn at(&mut self) -> usize {
        self.skip_blanks();
        self.at
    }

    /// How many characters have been taken.
    pub fn used(&self) -> usize {
        self.at
    }

    fn skip_blanks(&mut self) {
        while self.line.clean.get(self.at) == Some(&b' ') {
            self.at += 1;
        }
    }

    /// The next character that is not blank.
    pub fn peek(&mut self) -> Option<u8> {
        self.skip_blanks();
        self.line.clean.get(self.at).copied()
    }

    /// Takes the next character that is not blank.
    pub fn next(&mut self) -> Option<u8> {
        let byte = self.peek()?;
        self.at += 1;
        Some(byte)
    }

    /// Takes this character if it is the next.
    pub fn take(&mut self, byte: u8) -> bool {
        let is_next = self.peek() == Some(byte);
        if is_next {
            self.at += 1;
        }
        is_next
    }

    /// Takes this word if it is the next; blanks between its letters do not matter to
    /// a control, but nobody writes them.
    pub fn take_word(&mut self, word: &str) -> bool {
        self.skip_blanks();
        let is_next = self
            .line
            .clean
            .get(self.at..)
            .is_some_and(|rest| rest.starts_with(word.as_bytes()));
        if is_next {
            self.at += word.len();
        }
        is_next
    }

    /// Takes this character or says what is expected.
    pub fn expect(&mut self, byte: u8, number: u32, what: &str) -> Checked<()> {
        let at = self.at();
        if self.take(byte) {
            Ok(())
        } else {
            Err(Fault::ps(number, format!("`{}` expected {what}", byte as char)).at(at))
        }
    }

    /// Takes the letters that stand here.
    pub fn letters(&mut self) -> String {
        self.skip_blanks();
        let mut letters = String::new();
        while let Some(byte) = self
            .line
            .clean
            .get(self.at)
            .filter(|b| b.is_ascii_alphabetic())
        {
            letters.push(*byte as char);
            self.at += 1;
        }
        letters
    }

    /// Takes the text up to this character, and that.
    pub fn up_to(&mut self, byte: u8) -> Option<&'a [u8]> {
        let end = find(&self.line.clean, self.at, byte)?;
        let text = self.line.clean.get(self.at..end)?;
        self.at = end + 1;
        Some(text)
    }

    /// The character under the cursor as it was loaded, blanks included; takes it.
    pub fn next_raw(&mut self) -> Option<u8> {
        let byte = self.line.raw.get(self.at).copied()?;
        self.at += 1;
        Some(byte)
    }

    /// The character under the cursor as it was loaded, blanks included.
    pub fn peek_raw(&self) -> Option<u8> {
        self.line.raw.get(self.at).copied()
    }

    /// Takes an unsigned decimal number as it is written; none if there is none.
    pub fn digits(&mut self) -> Option<Digits> {
        self.skip_blanks();
        let start = self.at;
        let mut count = 0;
        let mut has_point = false;
        while let Some(byte) = self.line.clean.get(self.at) {
            match byte {
                b'0'..=b'9' => count += 1,
                b'.' if !has_point => has_point = true,
                _ => break,
            }
            self.at += 1;
        }
        if count == 0 {
            self.at = start;
            return None;
        }
        let text = self.line.clean.get(start..self.at)?;
        let value = std::str::from_utf8(text).ok()?.parse().ok()?;
        let leading = text.iter().take_while(|b| **b == b'0').count();
        Some(Digits {
            value,
            has_point,
            significant: count - leading.min(count),
            at: start,
        })
    }
}

/// A number as it is written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Digits {
    /// Its value.
    pub value: f64,
    /// Whether it has a decimal point.
    pub has_point: bool,
    /// Digits without leading zeros.
    pub significant: usize,
    /// Index of its first character.
    pub at: usize,
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Comments go, columns stay, what is printed is not touched.
    #[test]
    fn comments() {
        let line = Line::new("g1 (one)X1.(two)", ControlFamily::Fanuc).expect("closed");
        assert_eq!(line.clean, b"G1      X1.     ");
        assert_eq!(line.comments, ["one", "two"]);
        assert!(line.has_small_letters);
        let line = Line::new("DPRNT[a (b) #1[33]](c)", ControlFamily::Haas).expect("closed");
        assert_eq!(line.clean, b"DPRNT[A (B) #1[33]]   ");
        assert_eq!(line.comments, ["c"]);
        assert!(Line::new("G1 (open", ControlFamily::Fanuc).is_err());
        assert!(Line::new("G1 X\u{e9}", ControlFamily::Fanuc).is_err());
    }

    /// Numbers with and without a point; a lone point is none.
    #[test]
    fn numbers() {
        let line = Line::new("007.50 .5 5. .", ControlFamily::Fanuc).expect("plain");
        let mut cursor = Cursor::new(&line);
        let first = cursor.digits().expect("a number");
        assert_eq!(
            (first.value, first.significant, first.has_point),
            (7.5, 3, true)
        );
        assert_eq!(cursor.digits().map(|d| d.value), Some(0.5));
        assert_eq!(cursor.digits().map(|d| d.value), Some(5.0));
        assert_eq!(cursor.digits(), None);
        assert_eq!(cursor.peek(), Some(b'.'));
    }
}
