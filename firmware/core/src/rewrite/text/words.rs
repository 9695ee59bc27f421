//! A line of a program as words: letter, value, and where they stand in the text.

use heapless::Vec;

use crate::rewrite::refusal::RewriteRefusal;

/// Words of one block, at most; a control takes about as many characters in a block as
/// four times this.
pub(in crate::rewrite) const MAX_WORDS: usize = 48;

/// A decimal number as it is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::rewrite) struct Number {
    /// All digits as one whole number, with the sign.
    pub digits: i64,
    /// How many of them stand behind the point.
    pub decimals: u8,
    pub has_point: bool,
}

/// What follows a letter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::rewrite) enum Value {
    Number(Number),
    /// `#1` or `[...]`: known to the control only.
    Expression,
}

/// A word and its place in the line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::rewrite) struct Word {
    /// Upper case; `,` for `,R` and `,C`.
    pub letter: u8,
    pub value: Value,
    pub start: usize,
    pub end: usize,
}

/// The words of a line.
pub(in crate::rewrite) type Words = Vec<Word, MAX_WORDS>;

/// What a line is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::rewrite) enum Kind {
    /// Blanks and comments.
    Nothing,
    /// `%`.
    Percent,
    /// `DPRNT` and its like, or a variable that no axis depends on.
    Macro,
    /// `O100 CALL`, `O<name> CALL`: a program is called by the number or name from here to here.
    Call { start: usize, end: usize },
    /// Words; `optional` if the block begins with `/`.
    Words { optional: bool },
}

/// What is wrong at which byte of the line.
pub(in crate::rewrite) type At<T> = Result<T, (usize, RewriteRefusal)>;

/// Reads a line without its end into `words`.
pub(in crate::rewrite) fn read(line: &[u8], words: &mut Words) -> At<Kind> {
    let mut at = 0;
    let mut optional = false;
    while let Some(&byte) = line.get(at) {
        // The letter of a word, and where its value may begin: words are read in one place.
        let (letter, value) = match byte {
            b'A'..=b'Z' | b'a'..=b'z' => {
                if line.get(at + 1).is_some_and(u8::is_ascii_alphabetic) {
                    return keyword(line, at, words);
                }
                (byte.to_ascii_uppercase(), at + 1)
            }
            _ if is_blank(byte) => {
                at += 1;
                continue;
            }
            b':' => (b'O', at + 1),
            b',' => {
                let letter = skip_blanks(line, at + 1);
                // Corners turn with the part; an angle (`,A`) does not, and stays a number.
                match line.get(letter).map(u8::to_ascii_uppercase) {
                    Some(b'R' | b'C') => (b',', letter + 1),
                    Some(other) if other.is_ascii_alphabetic() => {
                        return Err((at, RewriteRefusal::Comma(other as char)));
                    }
                    _ => return Err((at, RewriteRefusal::NotAWord)),
                }
            }
            b'(' => {
                let rest = line.get(at..).unwrap_or_default();
                let Some(end) = rest.iter().position(|b| *b == b')') else {
                    return Err((at, RewriteRefusal::UnclosedComment));
                };
                at += end + 1;
                continue;
            }
            b';' => break,
            // The end of a file of DOS.
            END_OF_FILE if is_end(line, at) => break,
            b'%' if words.is_empty() && !optional => return Ok(Kind::Percent),
            b'/' if !optional && is_first(words) => {
                optional = true;
                at += 1;
                // The number of the switch.
                if line.get(at).is_some_and(u8::is_ascii_digit) {
                    at += 1;
                }
                continue;
            }
            b'#' if is_first(words) => {
                assignment(line, at)?;
                return Ok(Kind::Macro);
            }
            _ => return Err((at, RewriteRefusal::NotAWord)),
        };
        if letter == b'O'
            && let Some(call) = o_word(line, at, value, words)?
        {
            return Ok(call);
        }
        at = word(line, at, letter, value, words)?;
    }
    Ok(if words.is_empty() {
        Kind::Nothing
    } else {
        Kind::Words { optional }
    })
}

/// Control-Z, with which files of DOS end.
const END_OF_FILE: u8 = 0x1A;
/// How a file in UTF-8 may begin: editors of Windows put it before the first byte.
pub(in crate::rewrite) const BYTE_ORDER_MARK: &[u8] = b"\xEF\xBB\xBF";

/// Whether nothing but ends of file stands from here on.
fn is_end(line: &[u8], at: usize) -> bool {
    let rest = line.get(at..).unwrap_or_default();
    rest.iter()
        .all(|byte| *byte == END_OF_FILE || is_blank(*byte))
}

/// Whether a text is nothing but words: a block, for a control that reads it as one. Where the
/// first of them stands.
pub(in crate::rewrite) fn is_block(text: &[u8]) -> Option<usize> {
    let mut at = 0;
    let mut first = None;
    while let Some(&byte) = text.get(at) {
        if is_blank(byte) || byte == b';' {
            at += 1;
        } else if byte == b'(' {
            at += memchr::memchr(b')', text.get(at..)?)? + 1;
        } else if byte.is_ascii_alphabetic() {
            first = first.or(Some(at));
            at = skip_blanks(text, at + 1);
            if matches!(text.get(at), Some(b'+' | b'-')) {
                at = skip_blanks(text, at + 1);
            }
            at = match text.get(at) {
                Some(b'#' | b'[') => expression(text, at).ok()?,
                _ => number(text, at, false).ok()?.1,
            };
        } else {
            return None;
        }
    }
    first
}

/// Where behind a semicolon stands what a control takes for more than a comment: words, a block that
/// may be left out, a macro; for one whose `;` ends a block, anything but a comment in brackets.
pub(in crate::rewrite) fn goes_on(text: &[u8], ends_blocks: bool) -> Option<usize> {
    let mut first = 0;
    while let Some(&byte) = text.get(first) {
        if byte == b'(' {
            first += memchr::memchr(b')', text.get(first..)?)? + 1;
        } else if is_blank(byte) || byte == b';' {
            first += 1;
        } else {
            break;
        }
    }
    let rest = text.get(first..).filter(|rest| !rest.is_empty())?;
    let is_read = || match read(rest, &mut Words::new()) {
        Ok(kind) => !matches!(kind, Kind::Nothing),
        // "IF NEEDED" is said to people.
        Err((_, RewriteRefusal::Flow)) => memchr::memchr(b'[', rest).is_some(),
        Err((_, reason)) => matches!(
            reason,
            RewriteRefusal::SystemVariable
                | RewriteRefusal::NamedCall
                | RewriteRefusal::NumberedCall(_)
        ),
    };
    (ends_blocks || is_block(rest).is_some() || is_read()).then_some(first)
}

/// Where a comment to the end of the line begins.
pub(in crate::rewrite) fn semicolon(line: &[u8]) -> Option<usize> {
    let mut at = 0;
    loop {
        let rest = line.get(at..)?;
        at += memchr::memchr2(b'(', b';', rest)?;
        if line.get(at) == Some(&b';') {
            return Some(at);
        }
        at += memchr::memchr(b')', line.get(at..)?)?;
    }
}

/// Whether a line is a program's name in angle brackets: Fanuc's `<PART>`.
pub(in crate::rewrite) fn is_name(line: &[u8]) -> bool {
    let begin = skip_blanks(line, 0);
    let rest = line.get(begin..).unwrap_or_default();
    let end = rest.iter().position(|byte| *byte == b'>');
    let behind = end.and_then(|end| rest.get(end + 1..));
    rest.first() == Some(&b'<')
        && behind.is_some_and(|behind| {
            let at = skip_blanks(behind, 0);
            behind.get(at).is_none_or(|byte| *byte == b'(')
        })
}

/// Blanks, tabs, and what tapes and serial lines leave between characters.
const fn is_blank(byte: u8) -> bool {
    matches!(byte, b' ' | b'\t' | 0x00 | 0x0F | 0x11..=0x14 | 0x7F)
}

fn is_first(words: &Words) -> bool {
    words.iter().all(|word| word.letter == b'N')
}

fn skip_blanks(line: &[u8], mut at: usize) -> usize {
    while line.get(at).copied().is_some_and(is_blank) {
        at += 1;
    }
    at
}

/// One word from `start`, whose value begins at or after `at`.
fn word(line: &[u8], start: usize, letter: u8, at: usize, words: &mut Words) -> At<usize> {
    let mut at = skip_blanks(line, at);
    let mut negative = false;
    if let Some(sign @ (b'+' | b'-')) = line.get(at) {
        negative = *sign == b'-';
        at = skip_blanks(line, at + 1);
    }
    let (value, end) = match line.get(at) {
        Some(b'#' | b'[') => (Value::Expression, expression(line, at)?),
        _ => {
            let (number, end) = number(line, at, negative).map_err(|reason| (start, reason))?;
            (Value::Number(number), end)
        }
    };
    words
        .push(Word {
            letter,
            value,
            start,
            end,
        })
        .map_err(|_| (start, RewriteRefusal::TooManyWords))?;
    Ok(end)
}

/// Digits and a point.
#[inline]
pub(in crate::rewrite) fn number(
    line: &[u8],
    begin: usize,
    negative: bool,
) -> Result<(Number, usize), RewriteRefusal> {
    let mut digits = 0;
    let point = behind_digits(line, begin, &mut digits);
    let has_point = line.get(point) == Some(&b'.');
    let (end, decimals) = if has_point {
        let end = behind_digits(line, point + 1, &mut digits);
        (end, end.saturating_sub(point + 1))
    } else {
        (point, 0)
    };
    let length = end.saturating_sub(begin);
    if length == usize::from(has_point) {
        return Err(RewriteRefusal::NotAWord);
    }
    if length > MAX_DIGITS {
        digits = many_digits(line.get(begin..end).unwrap_or_default())?;
    }
    // A run of zeros is no larger number, but a longer one.
    if decimals > MAX_DIGITS {
        return Err(RewriteRefusal::OutOfRange);
    }
    Ok((
        Number {
            digits: if negative {
                digits.wrapping_neg()
            } else {
                digits
            },
            decimals: decimals as u8,
            has_point,
        },
        end,
    ))
}

/// So many digits are a number in any case.
const MAX_DIGITS: usize = 18;

/// Takes the digits from `at` on behind those that were read; where they end. Whether it was
/// too many is looked at behind the last, not at each.
#[inline]
fn behind_digits(line: &[u8], mut at: usize, digits: &mut i64) -> usize {
    while let Some(byte) = line.get(at) {
        let digit = byte.wrapping_sub(b'0');
        if digit > 9 {
            break;
        }
        *digits = digits.wrapping_mul(10).wrapping_add(i64::from(digit));
        at += 1;
    }
    at
}

/// A number of many digits: zeros in front of it do not count.
#[cold]
fn many_digits(text: &[u8]) -> Result<i64, RewriteRefusal> {
    let mut digits: i64 = 0;
    for digit in text.iter().filter(|byte| **byte != b'.') {
        // 17 digits and one more still fit.
        if digits > 99_999_999_999_999_999 {
            return Err(RewriteRefusal::OutOfRange);
        }
        digits = digits
            .wrapping_mul(10)
            .wrapping_add(i64::from(digit.wrapping_sub(b'0')));
    }
    Ok(digits)
}

/// The end of `#12`, `#[...]` or `[...]`.
fn expression(line: &[u8], mut at: usize) -> At<usize> {
    let begin = at;
    while line.get(at) == Some(&b'#') {
        at = skip_blanks(line, at + 1);
    }
    if line.get(at) == Some(&b'<') {
        let rest = line.get(at..).unwrap_or_default();
        let end = rest.iter().position(|b| *b == b'>');
        return end
            .map(|end| at + end + 1)
            .ok_or((begin, RewriteRefusal::NotAWord));
    }
    if line.get(at) != Some(&b'[') {
        let digits = at;
        while line.get(at).is_some_and(u8::is_ascii_digit) {
            at += 1;
        }
        return if at > digits {
            Ok(at)
        } else {
            Err((begin, RewriteRefusal::NotAWord))
        };
    }
    let mut depth = 0_u32;
    while let Some(&byte) = line.get(at) {
        at += 1;
        match byte {
            b'[' => depth += 1,
            b']' => {
                depth -= 1;
                if depth == 0 {
                    return Ok(at);
                }
            }
            _ => {}
        }
    }
    Err((begin, RewriteRefusal::NotAWord))
}

/// `O100 IF`, `O<name> SUB`, `O100 CALL`: an O word that is followed by a keyword. None if it
/// is the number of a program.
fn o_word(line: &[u8], start: usize, value: usize, words: &Words) -> At<Option<Kind>> {
    let value = skip_blanks(line, value);
    let rest = line.get(value..).unwrap_or_default();
    let length = match rest.first() {
        Some(b'<') => rest.iter().position(|b| *b == b'>').map_or(0, |at| at + 1),
        _ => rest.iter().take_while(|b| b.is_ascii_digit()).count(),
    };
    let end = value + length;
    let rest = line.get(skip_blanks(line, end)..).unwrap_or_default();
    let is_keyword = rest.len() > 1 && rest.iter().take(2).all(u8::is_ascii_alphabetic);
    if line.get(value) != Some(&b'<') && !is_keyword {
        return Ok(None);
    }
    let is_call = rest
        .get(..4)
        .is_some_and(|word| word.eq_ignore_ascii_case(b"CALL"));
    if is_call && length > 0 && is_first(words) {
        return Ok(Some(Kind::Call { start: value, end }));
    }
    Err((start, RewriteRefusal::Flow))
}

/// A line that begins with a keyword of a macro language.
fn keyword(line: &[u8], at: usize, words: &Words) -> At<Kind> {
    let rest = line.get(at..).unwrap_or_default();
    let length = rest.iter().take_while(|b| b.is_ascii_alphabetic()).count();
    let name = rest.get(..length).unwrap_or_default();
    let is = |known: &[&str]| {
        known
            .iter()
            .any(|known| name.eq_ignore_ascii_case(known.as_bytes()))
    };
    if is(&["POPEN", "PCLOS", "DPRNT", "BPRNT"]) && is_first(words) {
        Ok(Kind::Macro)
    } else if is(&["IF", "THEN", "ELSE", "WHILE", "DO", "END", "GOTO"]) {
        Err((at, RewriteRefusal::Flow))
    } else {
        Err((at, RewriteRefusal::NotAWord))
    }
}

/// `#n=...` of a variable that is nothing but a variable: n up to 999, or a name.
fn assignment(line: &[u8], at: usize) -> At<()> {
    let end = expression(line, at)?;
    let name = line.get(at + 1..end).unwrap_or_default();
    let is_plain =
        name.first() == Some(&b'<') || (name.len() <= 3 && name.iter().all(u8::is_ascii_digit));
    if !is_plain {
        return Err((at, RewriteRefusal::SystemVariable));
    }
    let equals = skip_blanks(line, end);
    if line.get(equals) != Some(&b'=') {
        return Err((at, RewriteRefusal::NotAWord));
    }
    // Functions have names of two letters and more: a single letter is a word behind it.
    let mut at = equals + 1;
    while let Some(&byte) = line.get(at) {
        match byte {
            b';' | b'(' => break,
            // LinuxCNC takes several in a line.
            b'=' => return Err((at, RewriteRefusal::SystemVariable)),
            b'<' => {
                let rest = line.get(at..).unwrap_or_default();
                at += rest.iter().position(|b| *b == b'>').unwrap_or(0);
            }
            _ if byte.is_ascii_alphabetic() => {
                let rest = line.get(at..).unwrap_or_default();
                let length = rest.iter().take_while(|b| b.is_ascii_alphabetic()).count();
                if length < 2 {
                    return Err((at, RewriteRefusal::NotAWord));
                }
                at += length - 1;
            }
            _ => {}
        }
        at += 1;
    }
    Ok(())
}
