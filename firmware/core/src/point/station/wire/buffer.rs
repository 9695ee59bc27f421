//! The characters of a line as they come.

/// Up to `N` characters of a line; of a longer one it is known that it was longer.
#[derive(Debug)]
pub(super) struct LineBuffer<const N: usize> {
    bytes: [u8; N],
    length: usize,
    is_too_long: bool,
}

/// The line had more characters than there is room for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct TooLong;

impl<const N: usize> Default for LineBuffer<N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const N: usize> LineBuffer<N> {
    /// Nothing has come.
    pub const fn new() -> Self {
        Self {
            bytes: [0; N],
            length: 0,
            is_too_long: false,
        }
    }

    /// What has come of a line.
    pub fn so_far(&self) -> &[u8] {
        self.bytes.get(..self.length).unwrap_or_default()
    }

    /// The next character.
    pub const fn push(&mut self, byte: u8) {
        match self.bytes.split_at_mut_checked(self.length) {
            Some((_, [place, ..])) => {
                *place = byte;
                self.length += 1;
            }
            _ => self.is_too_long = true,
        }
    }

    /// Something of the line is lost: it is as good as too long.
    pub const fn spoil(&mut self) {
        self.is_too_long = true;
    }

    /// The line is over: its characters. The next one begins.
    pub fn end(&mut self) -> Result<&[u8], TooLong> {
        let length = core::mem::take(&mut self.length);
        if core::mem::take(&mut self.is_too_long) {
            return Err(TooLong);
        }
        Ok(self.bytes.get(..length).unwrap_or_default())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A line as long as the room is whole, one character more is too long, and the next is whole.
    #[test]
    fn a_long_line_harms_no_other() {
        let mut line = LineBuffer::<3>::default();
        for (text, expected) in [
            (&b"abc"[..], Ok(&b"abc"[..])),
            (b"abcd", Err(TooLong)),
            (b"", Ok(b"")),
            (b"x", Ok(b"x")),
        ] {
            text.iter().for_each(|byte| line.push(*byte));
            assert_eq!(line.end(), expected);
        }
    }
}
