//! Text from a control or a file, made visible: its characters never steer the page or the
//! terminal that shows it.

/// Control characters become visible, characters that reorder text become a
/// replacement mark.
pub fn visible(text: &str) -> String {
    text.chars().map(visible_char).collect()
}

/// The same, but line ends stay (for programs).
pub fn visible_lines(text: &str) -> String {
    text.chars()
        .map(|c| if c == '\n' { c } else { visible_char(c) })
        .collect()
}

fn visible_char(c: char) -> char {
    match c {
        // The Unicode control pictures stand in the order of the codes.
        '\0'..='\x1f' => char::from_u32(0x2400 + u32::from(c)).unwrap_or('\u{fffd}'),
        '\x7f' => '\u{2421}',
        '\u{80}'..='\u{9f}'
        | '\u{200b}'..='\u{200f}'
        | '\u{2028}'..='\u{202e}'
        | '\u{2060}'..='\u{206f}'
        | '\u{feff}'
        | '\u{fff0}'..='\u{fffb}'
        | '\u{fffe}'..='\u{ffff}' => '\u{fffd}',
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An escape sequence or a reordering mark in a name is shown, not obeyed.
    #[test]
    fn control_characters_are_shown() {
        assert_eq!(visible("\x1b[31mA\0\x7f"), "\u{241b}[31mA\u{2400}\u{2421}");
        assert_eq!(visible("a\u{202e}b\n"), "a\u{fffd}b\u{240a}");
        assert_eq!(visible_lines("%\nO1\r\n"), "%\nO1\u{240d}\n");
    }
}
