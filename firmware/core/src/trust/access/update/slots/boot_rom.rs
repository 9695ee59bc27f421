//! A chip whose boot ROM chooses between two places by itself, as the RP2350's does (its data sheet, 5.1).
//!
//! # Design
//!
//! There is no boot loader: the ROM verifies its own seal around the code and starts the newest image that is not marked as
//! on trial, or the marked one that a restart has named. The image that it starts does the rest, before anything else runs:
//!
//! ```text
//! the ROM starts ─► take_over ─┬─► nothing waits ─────────────► it goes on
//!                              ├─► the other one waits ───────► kept as tried, then the ROM is asked to start that
//!                              ├─► it is on trial ────────────► it goes on, and buys itself when it works
//!                              └─► it is older than what counts ─► nothing runs
//! ```
//!
//! *To buy* takes the mark of a trial off, in flash; from then on the ROM starts the image. It comes before the trial's end
//! is kept here, so whatever a power cut leaves between the two, the ROM has an image that it starts: one that was bought
//! and not kept is kept at its next start; one whose mark was torn is gone, and the one before runs.
//!
//! The mark is one bit within the signed payload. It reads here as it was signed ([`as_signed`]), bought or not.
//!
//! # Limitations
//!
//! An older image says by itself that it is too old. The ROM holds that only where its owner has burned the fuses for it.

use umi_protocol::update::{ImagePlace, ImageVersion, UpdateState};

use super::{Kept, Slots, UpdateError, place};
use crate::journal::Flash;

/// Where an image's place has the mark of a trial, in bytes; the ROM's seal stands behind the header, and the mark in the
/// last byte of its second word.
pub const TRIAL_MARK_AT: u32 = umi_protocol::update::IMAGE_HEADER as u32 + 7;
/// The mark.
pub const TRIAL_MARK: u8 = 0x80;

/// Bytes of an image's place as its maker has signed them: all images are signed with the mark.
pub fn as_signed(addr: u32, read: &mut [u8]) {
    let at = TRIAL_MARK_AT.checked_sub(addr);
    if let Some(byte) = at.and_then(|at| read.get_mut(at as usize)) {
        *byte |= TRIAL_MARK;
    }
}

/// How the boot ROM has started the image that asks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RomStart {
    /// Where it stands.
    pub place: ImagePlace,
    /// It is marked as on trial, and was named by the restart.
    pub to_be_bought: bool,
}

/// What comes next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Onwards {
    /// The image goes on.
    Runs {
        /// The version of an image whose trial is over, and has failed.
        reverted: Option<ImageVersion>,
    },
    /// The ROM is to start the image in this place on trial.
    Try(ImagePlace),
    /// Nobody here has asked for this trial: a plain restart ends it.
    Restart,
    /// Nothing runs: the image is not the maker's, or older than what counts.
    Stop,
}

impl<F: Flash> Slots<F> {
    /// The slots of a chip whose boot ROM has to be told that an image is confirmed.
    #[must_use]
    pub fn bought_by(self, buy: fn() -> Result<(), UpdateError>) -> Self {
        Self { buy, ..self }
    }

    /// The image that the ROM has started takes over: verified once more, and by what counts here.
    ///
    /// # Errors
    /// [`UpdateError::Flash`]: the flash cannot be read, or does not keep what counts.
    pub fn take_over(&mut self, rom: RomStart) -> Result<Onwards, UpdateError> {
        let slot = rom.place == ImagePlace::B;
        let header = match self.verified(slot) {
            Ok(header) => header,
            Err(UpdateError::Flash) => return Err(UpdateError::Flash),
            Err(UpdateError::Refused(_)) if rom.to_be_bought => return Ok(Onwards::Restart),
            Err(UpdateError::Refused(_)) => return Ok(Onwards::Stop),
        };
        let (version, counter) = (header.version, header.counter);
        self.running = Some((rom.place, header));
        let mut reverted = None;
        match self.kept.trial {
            Some((tried, true)) if tried == slot => {
                self.on_trial = true;
                if !rom.to_be_bought {
                    // It was bought, and the power went before that was kept.
                    self.keep_confirmed()?;
                }
            }
            _ if rom.to_be_bought => return Ok(Onwards::Restart),
            Some((tried, has_started)) => {
                let image = self.verified(tried);
                if let (Ok(_), false) = (&image, has_started) {
                    let trial = Some((tried, true));
                    self.keep(Kept { trial, ..self.kept })?;
                    return Ok(Onwards::Try(place(tried)));
                }
                reverted = Some(image.map_or([0; 3], |header| header.version));
                self.keep(Kept {
                    trial: None,
                    latest: UpdateState::Reverted,
                    ..self.kept
                })?;
            }
            None if self.kept.active.is_none() => self.keep(Kept {
                active: Some(slot),
                version,
                counter,
                ..self.kept
            })?,
            None => {}
        }
        Ok(Onwards::Runs { reverted })
    }
}

#[cfg(test)]
mod tests;
