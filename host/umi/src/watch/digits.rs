//! Large digits for a terminal, made of half blocks: two dots in a character, one
//! above the other.

/// Dots of a digit: five rows of three, the highest bit left.
const fn dots(character: char) -> Option<[u8; 5]> {
    Some(match character {
        '0' => [0b111, 0b101, 0b101, 0b101, 0b111],
        '1' => [0b010, 0b110, 0b010, 0b010, 0b111],
        '2' => [0b111, 0b001, 0b111, 0b100, 0b111],
        '3' => [0b111, 0b001, 0b111, 0b001, 0b111],
        '4' => [0b101, 0b101, 0b111, 0b001, 0b001],
        '5' => [0b111, 0b100, 0b111, 0b001, 0b111],
        '6' => [0b111, 0b100, 0b111, 0b101, 0b111],
        '7' => [0b111, 0b001, 0b010, 0b010, 0b010],
        '8' => [0b111, 0b101, 0b111, 0b101, 0b111],
        '9' => [0b111, 0b101, 0b111, 0b001, 0b111],
        '-' => [0b000, 0b000, 0b111, 0b000, 0b000],
        ' ' => [0; 5],
        _ => return None,
    })
}

/// How large.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Size {
    /// Ordinary text, one line.
    Text,
    /// Three lines, four columns for a digit.
    Middle,
    /// Five lines, seven columns for a digit.
    Large,
}

impl Size {
    /// Lines of a number.
    #[must_use]
    pub const fn height(self) -> usize {
        match self {
            Self::Text => 1,
            Self::Middle => 3,
            Self::Large => 5,
        }
    }

    /// Columns of a text.
    #[must_use]
    pub fn width(self, text: &str) -> usize {
        let columns = |character| match (self, character) {
            (Self::Text, _) => 1,
            (Self::Middle, '.') => 2,
            (Self::Middle, _) => 4,
            (Self::Large, '.') => 3,
            (Self::Large, _) => 7,
        };
        text.chars().map(columns).sum()
    }

    /// The lines of a number: digits, minus, point and blanks; other characters are blank.
    #[must_use]
    pub fn lines(self, text: &str) -> Vec<String> {
        let mut lines = vec![String::new(); self.height()];
        for character in text.chars() {
            for (row, line) in lines.iter_mut().enumerate() {
                line.push_str(&self.piece(character, row));
            }
        }
        lines
    }

    fn piece(self, character: char, row: usize) -> String {
        let last = row + 1 == self.height();
        match (self, character) {
            (Self::Text, _) => return character.into(),
            (Self::Middle, '.') => return if last { "▀ " } else { "  " }.into(),
            (Self::Large, '.') => return if last { "██ " } else { "   " }.into(),
            _ => {}
        }
        let dots = dots(character).unwrap_or_default();
        let row_of = |row: usize| dots.get(row).copied().unwrap_or(0);
        let mut piece = String::new();
        for column in [0b100, 0b010, 0b001] {
            if self == Self::Large {
                piece.push_str(if row_of(row) & column > 0 {
                    "██"
                } else {
                    "  "
                });
                continue;
            }
            let above = row_of(2 * row) & column > 0;
            let below = row_of(2 * row + 1) & column > 0;
            piece.push(match (above, below) {
                (true, true) => '█',
                (true, false) => '▀',
                (false, true) => '▄',
                (false, false) => ' ',
            });
        }
        piece.push(' ');
        piece
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers look like numbers, and are as wide as they say.
    #[test]
    fn digits_are_drawn() {
        let shown = Size::Middle.lines("-12.07");
        assert_eq!(
            shown,
            [
                "    ▄█  ▀▀█   █▀█ ▀▀█ ",
                "▀▀▀  █  █▀▀   █ █  █  ",
                "    ▀▀▀ ▀▀▀ ▀ ▀▀▀  ▀  "
            ]
        );
        for size in [Size::Text, Size::Middle, Size::Large] {
            let text = "-0123456789.5 ";
            let lines = size.lines(text);
            assert_eq!(lines.len(), size.height());
            for line in lines {
                assert_eq!(line.chars().count(), size.width(text), "{size:?} {line:?}");
            }
        }
    }

    /// No two digits look the same.
    #[test]
    fn digits_differ() {
        for a in '0'..='9' {
            for b in '0'..a {
                assert_ne!(
                    Size::Middle.lines(&a.to_string()),
                    Size::Middle.lines(&b.to_string())
                );
            }
        }
    }
}
