//! Consistent overhead byte stuffing: takes every zero out of a frame, so that
//! a zero can only be a delimiter.
//!
//! S. Cheshire, M. Baker: Consistent Overhead Byte Stuffing, IEEE/ACM
//! Transactions on Networking 7 (1999) 159-172. A block is a code byte and
//! `code - 1` bytes that are not zero; between blocks stands a zero, except
//! after a code of 255. The overhead is one byte and one more for each full 254.

/// Bytes that stuffing adds at most to `len` bytes.
pub(crate) const fn max_overhead(len: usize) -> usize {
    1 + len / 254
}

/// The caller's buffer is full.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Full;

/// Stuffs bytes into the caller's buffer.
pub(crate) struct Stuffer<'b> {
    out: &'b mut [u8],
    /// Where the next byte goes.
    at: usize,
    /// Where the open block's code byte goes.
    code_at: usize,
    /// The open block's code so far.
    code: u8,
}

impl<'b> Stuffer<'b> {
    /// Begins at `at` of the buffer.
    pub(crate) fn new(out: &'b mut [u8], at: usize) -> Self {
        Self {
            out,
            at: at + 1,
            code_at: at,
            code: 1,
        }
    }

    /// Takes one byte.
    pub(crate) fn push(&mut self, byte: u8) -> Result<(), Full> {
        if byte != 0 {
            *self.out.get_mut(self.at).ok_or(Full)? = byte;
            self.at += 1;
            self.code += 1;
        }
        if byte == 0 || self.code == u8::MAX {
            self.close_block()?;
            self.code_at = self.at;
            self.at += 1;
            self.code = 1;
        }
        Ok(())
    }

    /// Takes the byte that stands at `from` of the buffer, which stuffing must not have reached.
    pub(crate) fn push_from(&mut self, from: usize) -> Result<(), Full> {
        debug_assert!(self.at <= from, "written over before it was read");
        let byte = *self.out.get(from).ok_or(Full)?;
        self.push(byte)
    }

    /// Ends the last block. Returns the buffer and where the next byte would go.
    pub(crate) fn finish(mut self) -> Result<(&'b mut [u8], usize), Full> {
        self.close_block()?;
        Ok((self.out, self.at))
    }

    fn close_block(&mut self) -> Result<(), Full> {
        *self.out.get_mut(self.code_at).ok_or(Full)? = self.code;
        Ok(())
    }
}

/// Undoes stuffing, one byte at a time. Zeros are the caller's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Unstuffer {
    /// Bytes of the open block still to come.
    left: u8,
    /// Whether a zero stands between this block and the next.
    zero_next: bool,
}

impl Unstuffer {
    /// Before the first byte.
    pub(crate) const fn new() -> Self {
        Self {
            left: 0,
            zero_next: false,
        }
    }

    /// Takes one byte that is not zero; returns the byte that it gives, if any.
    pub(crate) const fn push(&mut self, byte: u8) -> Option<u8> {
        if self.left > 0 {
            self.left -= 1;
            return Some(byte);
        }
        let zero = self.zero_next;
        self.left = byte.saturating_sub(1);
        self.zero_next = byte != u8::MAX;
        if zero { Some(0) } else { None }
    }

    /// Whether the bytes may end here: the open block is complete.
    pub(crate) const fn is_complete(&self) -> bool {
        self.left == 0
    }
}

#[cfg(test)]
mod tests;
