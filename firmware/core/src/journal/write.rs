//! Programming flash so that what is acknowledged has been seen to be there.

use super::error::JournalError;
use super::flash::{ERASED, Flash, LARGEST_WRITE};

/// The buffer that programs go through: most entries need one program.
#[repr(C, align(4))]
pub(crate) struct Buffer(pub [u8; LARGEST_WRITE]);

/// Collects pieces and programs them in aligned units, in order.
pub(super) struct Stage<'f, F: Flash> {
    flash: &'f mut F,
    addr: u32,
    align: u32,
    buffer: Buffer,
    len: usize,
}

impl<'f, F: Flash> Stage<'f, F> {
    /// Starts at `addr`, which is a multiple of `align`.
    pub fn new(flash: &'f mut F, addr: u32, align: u32) -> Self {
        Self {
            flash,
            addr,
            align,
            buffer: Buffer([ERASED; LARGEST_WRITE]),
            len: 0,
        }
    }

    pub fn push(&mut self, mut bytes: &[u8]) -> Result<(), JournalError<F::Error>> {
        while !bytes.is_empty() {
            let (_, free) = self.buffer.0.split_at_mut(self.len);
            let n = bytes.len().min(free.len());
            let (now, later) = bytes.split_at(n);
            let (place, _) = free.split_at_mut(n);
            place.copy_from_slice(now);
            self.len += n;
            bytes = later;
            if self.len == LARGEST_WRITE {
                self.program(LARGEST_WRITE)?;
            }
        }
        Ok(())
    }

    /// Programs what is left, padded with the erased value: padding that a power
    /// cut tears off does no harm.
    pub fn finish(mut self) -> Result<(), JournalError<F::Error>> {
        let padded = self
            .len
            .next_multiple_of(self.align as usize)
            .min(LARGEST_WRITE);
        if padded > 0 {
            self.program(padded)
        } else {
            Ok(())
        }
    }

    fn program(&mut self, len: usize) -> Result<(), JournalError<F::Error>> {
        let (bytes, _) = self.buffer.0.split_at(len);
        program_kept(self.flash, self.addr, bytes)?;
        self.addr += len as u32;
        self.buffer.0.fill(ERASED);
        self.len = 0;
        Ok(())
    }
}

/// Programs and reads back. The driver's word is not enough for a record that is
/// acknowledged: worn cells fail without a report.
pub(crate) fn program_kept<F: Flash>(
    flash: &mut F,
    addr: u32,
    bytes: &[u8],
) -> Result<(), JournalError<F::Error>> {
    flash.program(addr, bytes).map_err(JournalError::Flash)?;
    let mut buffer = [0; 64];
    let mut at = addr;
    for wanted in bytes.chunks(buffer.len()) {
        let (piece, _) = buffer.split_at_mut(wanted.len());
        flash.read(at, piece).map_err(JournalError::Flash)?;
        if let Some(bad) = piece.iter().zip(wanted).position(|(is, want)| is != want) {
            return Err(JournalError::NotKept {
                addr: at + bad as u32,
            });
        }
        at += wanted.len() as u32;
    }
    Ok(())
}
