//! Colours of a text for a terminal, and everything else of it that would steer the terminal
//! made harmless.
//!
//! A name of a program, a greeting of a board and a line of a control come from elsewhere, and
//! stand beside words that are coloured on purpose. So a colour is not written as the escape
//! code that it becomes: a mark stands in its place that nobody outside of this process can
//! know. [`shown`] makes escape codes of the marks, and of every other character that steers a
//! terminal the words `\u001b`: legible, and still the same text in JSON and TOML.

use std::hash::{BuildHasher as _, RandomState};
use std::sync::LazyLock;

/// Stands for the escape character of a colour. The two characters around it are in no text that
/// is exchanged; what is between them differs from run to run.
static MARK: LazyLock<String> = LazyLock::new(|| {
    let drawn = RandomState::new().hash_one(0);
    format!("\u{fdd0}{drawn:016x}\u{fdd1}")
});

/// Text with a colour's codes around it, as `1;31` (SGR, ECMA-48 8.3.117).
#[must_use]
pub fn coloured(codes: &str, text: &str) -> String {
    let mark = MARK.as_str();
    format!("{mark}[{codes}m{text}{mark}[0m")
}

/// What goes out to a terminal: with its colours, and nothing else that steers it.
#[must_use]
pub fn shown(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for (place, piece) in text.split(MARK.as_str()).enumerate() {
        if place > 0 {
            out.push('\u{1b}');
        }
        harmless(piece, &mut out);
    }
    out
}

/// What goes out to a file: without colours, and nothing in it that steers a terminal later.
#[must_use]
pub fn plain(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for (place, piece) in text.split(MARK.as_str()).enumerate() {
        let codes = if place > 0 { piece.find('m') } else { None };
        let piece = codes.map_or(piece, |end| piece.split_at(end + 1).1);
        harmless(piece, &mut out);
    }
    out
}

fn harmless(text: &str, out: &mut String) {
    let mut rest = text.chars().peekable();
    while let Some(c) = rest.next() {
        // A carriage return overwrites what stands before it, unless the line ends there.
        let is_line_end = c == '\n' || (c == '\r' && rest.peek() == Some(&'\n'));
        if is_line_end || c == '\t' || !steers(c) {
            out.push(c);
        } else {
            for unit in c.encode_utf16(&mut [0; 2]) {
                out.push_str(&format!("\\u{unit:04x}"));
            }
        }
    }
}

/// Whether a character is obeyed and not shown: control codes of both sets, and what hides or
/// reorders other characters.
#[must_use]
pub fn steers(c: char) -> bool {
    c.is_control()
        || matches!(
            c,
            '\u{ad}'
                | '\u{61c}'
                | '\u{180e}'
                | '\u{200b}'..='\u{200f}'
                | '\u{2028}'..='\u{202e}'
                | '\u{2060}'..='\u{206f}'
                | '\u{fdd0}'..='\u{fdef}'
                | '\u{feff}'
                | '\u{fff0}'..='\u{fffb}'
                | '\u{fffe}'..='\u{ffff}'
                | '\u{e0000}'..='\u{e007f}'
        )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A colour of our own goes out, also around text that holds one of a stranger: that is
    /// shown in letters. So is every other character that steers a terminal.
    #[test]
    fn only_our_colours_steer_the_terminal() {
        let hostile = "\u{1b}]0;owned\u{7}\u{9b}2J\u{202e}\u{7f}\r";
        let text = format!("{} {hostile}\r\n", coloured("1;31", hostile));
        let letters = r"\u001b]0;owned\u0007\u009b2J\u202e\u007f\u000d";
        assert_eq!(
            shown(&text),
            format!("\u{1b}[1;31m{letters}\u{1b}[0m {letters}\r\n")
        );
        assert_eq!(plain(&text), format!("{letters} {letters}\r\n"));
    }

    /// A mark that is guessed is no mark, and JSON stays the same JSON.
    #[test]
    fn a_guessed_mark_is_shown() {
        let guessed = "\u{fdd0}0123456789abcdef\u{fdd1}[31m";
        assert_eq!(shown(guessed), r"\ufdd00123456789abcdef\ufdd1[31m");
        let value = serde_json::json!({"name": "\u{9b}31m \u{e0041} \u{1b}"});
        let line = shown(&value.to_string());
        assert!(!line.chars().any(steers), "{line}");
        assert_eq!(
            serde_json::from_str::<serde_json::Value>(&line).unwrap(),
            value
        );
    }
}
