//! Two slots for images, of which one runs: receive, try, confirm, or go back.
//!
//! # Design
//!
//! ```text
//! begin ─► pieces ─► end: verified in its slot ─► trial kept ─► start ─► trial begun ─► confirm
//!                                                                 └── the next start without it: back
//! ```
//!
//! What counts stands in one entry of a small journal, so that it changes whole or not at all
//! (`state`). The slot that runs is never written. An image is verified (board, signature, SHA-512, version and
//! counter) before it is kept for trial, and the one that is to run again at every start: one that
//! was changed meanwhile does not run, but the other slot's does, if that is right and not older
//! than the counter allows; else what was built in. An image that comes may not be older than what runs either, so that an
//! older copy of what counts takes no older image; nor, where nothing counts any more, than a whole one in a slot.
//!
//! A board whose images are built for the place that they stand in has a boot loader: it calls
//! [`Slots::start`], and the image that it has started goes on by [`Slots::resume`]. Nothing is built in
//! there: the first start takes the newest image that stands in a slot.
//!
//! A sector is erased when its first byte comes, so that no piece waits for more than one. Where the flash fails at a
//! piece, the image begins anew: flash with check values takes no word twice.
//!
//! # Limitations
//!
//! An image is as trusted as the flash of the key that it is verified by. Who puts older copies of what counts and of both
//! slots back at once has the board that they are of.

pub mod boot_rom;

use sha2::{Digest as _, Sha512};
use umi_protocol::update::{
    IMAGE_HEADER, ImageInfo, ImagePlace, ImageVersion, UpdateRefusal, UpdateState,
};

use super::image::ImageHeader;
use super::state::{Kept, StateNotKept, StateRing};
use crate::journal::{ERASED, Flash};

/// Bytes that are hashed or programmed at once.
const PIECE: usize = 256;

/// What is hashed or programmed at once: flash wants it aligned, and copies words of it four times as fast.
#[repr(align(4))]
struct Page([u8; PIECE]);

/// What runs from this start on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StartedImage {
    /// Where it stands.
    pub place: ImagePlace,
    /// It has to confirm itself.
    pub on_trial: bool,
    /// An image on trial has not confirmed itself, or that or the confirmed one was changed: its version; zeros,
    /// if it cannot be read any more.
    pub reverted: Option<ImageVersion>,
}

/// The flash, or why an image is not taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UpdateError {
    /// Why it is not taken.
    Refused(UpdateRefusal),
    /// The flash does not keep it.
    Flash,
}

impl From<UpdateRefusal> for UpdateError {
    fn from(refusal: UpdateRefusal) -> Self {
        Self::Refused(refusal)
    }
}

impl From<StateNotKept> for UpdateError {
    fn from(StateNotKept: StateNotKept) -> Self {
        Self::Flash
    }
}

/// An image on its way.
#[derive(Clone)]
struct Receiving {
    slot: bool,
    header: ImageHeader,
    offset: u32,
}

/// What images a board runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ImageKind {
    /// The kind of board that an image names, slot by slot: one that is built for one place runs
    /// in no other.
    pub boards: [&'static str; 2],
    /// The version of what is built in, and runs where no slot does; none: nothing is.
    pub built_in: Option<ImageVersion>,
}

/// Whose images a board takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Maker {
    /// The key stands where neither an image nor a host can change it.
    Fixed([u8; 32]),
    /// The first one that is named counts, for ever.
    First(Option<[u8; 32]>),
}

/// The slots.
pub struct Slots<F: Flash> {
    /// None: it is damaged, and nothing can be kept.
    state: Option<StateRing<F>>,
    slots: [F; 2],
    kind: ImageKind,
    kept: Kept,
    receiving: Option<Receiving>,
    running: Option<(ImagePlace, ImageHeader)>,
    on_trial: bool,
    /// Whatever else has to know that an image is confirmed.
    buy: fn() -> Result<(), UpdateError>,
}

const fn place(slot: bool) -> ImagePlace {
    match slot {
        false => ImagePlace::A,
        true => ImagePlace::B,
    }
}

impl<F: Flash> Slots<F> {
    /// Opens the slots.
    ///
    /// # Errors
    /// [`UpdateError::Flash`]: what counts cannot be read or kept.
    pub fn open(
        state: F,
        slots: [F; 2],
        kind: ImageKind,
        maker: Maker,
    ) -> Result<Self, UpdateError> {
        Self::open_where(state, false, slots, kind, maker)
    }

    /// The same where what counts stands in the journal of the board's key, behind that (`state`): the key has been
    /// opened before, and nobody writes it meanwhile.
    ///
    /// # Errors
    /// [`UpdateError::Flash`]: what counts cannot be read or kept, or a key that was there is damaged.
    pub fn open_behind_key(
        state: F,
        slots: [F; 2],
        kind: ImageKind,
        maker: Maker,
    ) -> Result<Self, UpdateError> {
        Self::open_where(state, true, slots, kind, maker)
    }

    fn open_where(
        state: F,
        behind_key: bool,
        slots: [F; 2],
        kind: ImageKind,
        maker: Maker,
    ) -> Result<Self, UpdateError> {
        let (state, kept) = StateRing::open(state, behind_key, Kept::new(kind.built_in))?;
        let mut opened = Self {
            state: Some(state),
            kept,
            ..Self::with(slots, kind, None)
        };
        match maker {
            Maker::Fixed(key) => opened.kept.maker = Some(key),
            Maker::First(maker) if kept.maker.is_none() && maker.is_some() => {
                opened.keep(Kept { maker, ..kept })?;
            }
            Maker::First(_) => {}
        }
        Ok(opened)
    }

    /// The slots where what counts cannot be read: a start runs the newest image that is right, and
    /// none is taken, as nobody knows which counter has been.
    pub fn stateless(slots: [F; 2], kind: ImageKind, maker: Maker) -> Self {
        let (Maker::Fixed(key) | Maker::First(Some(key))) = maker else {
            return Self::with(slots, kind, None);
        };
        Self::with(slots, kind, Some(key))
    }

    fn with(slots: [F; 2], kind: ImageKind, maker: Option<[u8; 32]>) -> Self {
        Self {
            state: None,
            slots,
            kind,
            kept: Kept {
                maker,
                ..Kept::new(kind.built_in)
            },
            receiving: None,
            running: None,
            on_trial: false,
            buy: || Ok(()),
        }
    }

    fn keep(&mut self, kept: Kept) -> Result<(), UpdateError> {
        self.state.as_mut().ok_or(UpdateError::Flash)?.keep(&kept)?;
        self.kept = kept;
        Ok(())
    }

    /// Whether there is a key to verify by: without one nothing is taken.
    #[must_use]
    pub fn has_maker(&self) -> bool {
        self.kept.maker.is_some()
    }

    fn flash(&mut self, slot: bool) -> &mut F {
        let [a, b] = &mut self.slots;
        if slot { b } else { a }
    }

    /// The slot that the next image goes to: never the one that runs.
    fn next_slot(&self) -> bool {
        let running = self.running.as_ref().map(|(place, _)| *place);
        running == Some(ImagePlace::A)
    }

    /// Bytes of a payload that a slot takes.
    fn most_bytes(&mut self, slot: bool) -> u32 {
        let geometry = self.flash(slot).geometry();
        let size = u32::from(geometry.sectors).saturating_mul(geometry.sector_size);
        size.saturating_sub(IMAGE_HEADER as u32)
    }

    /// The image of a slot, if it is whole, right and not older than what has been.
    fn verified(&mut self, slot: bool) -> Result<ImageHeader, UpdateError> {
        let mut bytes = [0; IMAGE_HEADER];
        let read = self.flash(slot).read(0, &mut bytes);
        read.map_err(|_| UpdateError::Flash)?;
        let header = self.admissible(slot, &bytes)?;
        let mut hash = Sha512::new();
        self.pieces(slot, header.length, |piece| hash.update(piece))?;
        match <[u8; 64]>::from(hash.finalize()) == header.sha512 {
            true => Ok(header),
            false => Err(UpdateRefusal::Damaged.into()),
        }
    }

    /// A header that this board may run from a slot.
    fn admissible(
        &mut self,
        slot: bool,
        bytes: &[u8; IMAGE_HEADER],
    ) -> Result<ImageHeader, UpdateError> {
        let (header, signature) = ImageHeader::read(bytes).map_err(|_| UpdateRefusal::Damaged)?;
        let maker = self.kept.maker.ok_or(UpdateRefusal::Signature)?;
        if !header.is_signed(signature, &maker) {
            return Err(UpdateRefusal::Signature.into());
        }
        let [a, b] = self.kind.boards;
        if header.board.as_str() != if slot { b } else { a } {
            return Err(UpdateRefusal::Board.into());
        }
        let Kept {
            version, counter, ..
        } = self.kept;
        if header.counter < counter || header.version < version {
            return Err(UpdateRefusal::Rollback.into());
        }
        let most_bytes = self.most_bytes(slot);
        if header.length > most_bytes {
            return Err(UpdateRefusal::TooLong { most_bytes }.into());
        }
        Ok(header)
    }

    /// The board starts: what runs.
    ///
    /// # Errors
    /// [`UpdateError::Flash`]: what counts cannot be kept; [`Self::start_confirmed`] starts as before.
    pub fn start(&mut self) -> Result<StartedImage, UpdateError> {
        let mut reverted = None;
        if let Some((slot, has_started)) = self.kept.trial {
            let image = self.verified(slot);
            if let (Ok(header), false) = (&image, has_started) {
                let trial = Some((slot, true));
                self.keep(Kept { trial, ..self.kept })?;
                self.running = Some((place(slot), header.clone()));
                self.on_trial = true;
                return Ok(StartedImage {
                    place: place(slot),
                    on_trial: true,
                    reverted: None,
                });
            }
            reverted = Some(image.map_or([0; 3], |header| header.version));
            self.keep(Kept {
                trial: None,
                latest: UpdateState::Reverted,
                ..self.kept
            })?;
        }
        let is_first = self.kept.active.is_none();
        let started = self.start_confirmed();
        if let (true, Some((place, header))) = (is_first, &self.running)
            && self.state.is_some()
        {
            let (version, counter) = (header.version, header.counter);
            self.keep(Kept {
                active: Some(*place == ImagePlace::B),
                version,
                counter,
                ..self.kept
            })?;
        }
        let reverted = reverted.or_else(|| self.fell_back().then_some(self.kept.version));
        Ok(StartedImage {
            reverted,
            ..started
        })
    }

    /// Another image runs than the one that was confirmed: that was changed where it stands.
    fn fell_back(&self) -> bool {
        let running = self.running.as_ref().map(|(at, _)| *at);
        let active = self.kept.active.map(place);
        !self.on_trial && active.is_some_and(|active| running != Some(active))
    }

    /// The same without a trial and without keeping anything: the one that was confirmed; where it is wrong,
    /// the other, which may not be older. A board whose state cannot be written any more still starts so.
    pub fn start_confirmed(&mut self) -> StartedImage {
        self.on_trial = false;
        self.running = None;
        let first = match self.kept.active {
            None if self.kind.built_in.is_none() => self.newest(),
            active => active,
        };
        let slots = first.map(|slot| [slot, !slot]);
        for slot in slots.into_iter().flatten() {
            if let Ok(header) = self.verified(slot) {
                self.running = Some((place(slot), header));
                break;
            }
        }
        StartedImage {
            place: self.running.as_ref().map_or(ImagePlace::BuiltIn, |of| of.0),
            on_trial: false,
            reverted: None,
        }
    }

    /// The slot with the newest header that is right.
    fn newest(&mut self) -> Option<bool> {
        let mut age = |slot| {
            let mut bytes = [0; IMAGE_HEADER];
            self.flash(slot).read(0, &mut bytes).ok()?;
            let header = self.admissible(slot, &bytes).ok()?;
            Some((header.counter, header.version))
        };
        match (age(false), age(true)) {
            (None, None) => None,
            (a, b) => Some(b > a),
        }
    }

    /// The image in this slot goes on, which the boot loader has verified and started.
    ///
    /// # Errors
    /// [`UpdateError`]: no image of this board stands there.
    pub fn resume(&mut self, slot: ImagePlace) -> Result<(), UpdateError> {
        let slot = match slot {
            ImagePlace::BuiltIn => return Err(UpdateRefusal::Board.into()),
            ImagePlace::A => false,
            ImagePlace::B => true,
        };
        let mut bytes = [0; IMAGE_HEADER];
        let read = self.flash(slot).read(0, &mut bytes);
        read.map_err(|_| UpdateError::Flash)?;
        let header = self.admissible(slot, &bytes)?;
        self.running = Some((place(slot), header));
        self.on_trial = self.kept.trial == Some((slot, true));
        Ok(())
    }

    /// The payload of what runs, as far as it finds room; none: it is built in.
    pub fn payload<'b>(&mut self, room: &'b mut [u8]) -> Option<&'b [u8]> {
        let (place, header) = self.running.clone()?;
        let count = room.len().min(usize::try_from(header.length).ok()?);
        let part = room.get_mut(..count)?;
        let slot = place == ImagePlace::B;
        self.flash(slot).read(IMAGE_HEADER as u32, part).ok()?;
        Some(part)
    }

    /// The image on trial works: it is the one that starts. The version before.
    ///
    /// # Errors
    /// [`UpdateError::Flash`]: the next start goes back.
    pub fn confirm(&mut self) -> Result<Option<(ImageVersion, ImageVersion)>, UpdateError> {
        if self.on_trial {
            (self.buy)()?;
        }
        self.keep_confirmed()
    }

    /// The image on trial counts from now on. The version before.
    fn keep_confirmed(&mut self) -> Result<Option<(ImageVersion, ImageVersion)>, UpdateError> {
        let (Some((slot, true)), Some((_, header))) = (self.kept.trial, self.running.clone())
        else {
            return Ok(None);
        };
        let from = self.kept.version;
        self.keep(Kept {
            active: Some(slot),
            version: header.version,
            counter: header.counter,
            trial: None,
            latest: UpdateState::Confirmed,
            ..self.kept
        })?;
        self.on_trial = false;
        Ok(Some((from, header.version)))
    }

    /// What runs.
    pub fn info(&mut self) -> ImageInfo {
        let most_bytes = self.most_bytes(self.next_slot());
        let running = self.running.as_ref();
        let halves = |sha512: &[u8; 64]| {
            let mut halves = [[0; 32]; 2];
            for (half, part) in halves.iter_mut().zip(sha512.chunks_exact(32)) {
                half.copy_from_slice(part);
            }
            halves
        };
        ImageInfo {
            version: running.map_or(self.kind.built_in.unwrap_or_default(), |(_, of)| of.version),
            counter: running.map_or(0, |(_, of)| of.counter),
            place: running.map_or(ImagePlace::BuiltIn, |(place, _)| *place),
            confirmed: !self.on_trial,
            sha512: running.map(|(_, of)| halves(&of.sha512)),
            latest: match self.kept.trial {
                Some(_) => UpdateState::Trial,
                None if self.fell_back() => UpdateState::Reverted,
                None => self.kept.latest,
            },
            most_bytes,
        }
    }

    /// An image comes: where its next byte is wanted.
    ///
    /// # Errors
    /// [`UpdateError`].
    pub fn begin(&mut self, bytes: &[u8; IMAGE_HEADER]) -> Result<u32, UpdateError> {
        // The other slot holds what a start would go back to.
        if self.on_trial {
            return Err(UpdateRefusal::Busy.into());
        }
        let slot = self.next_slot();
        let header = self.admissible(slot, bytes)?;
        if let Some(receiving) = &self.receiving
            && receiving.header == header
            && receiving.slot == slot
        {
            return Ok(receiving.offset);
        }
        if self.is_older(&header) {
            return Err(UpdateRefusal::Rollback.into());
        }
        self.receiving = None;
        let is_fresh = self.kept.trial.is_none() && self.kept.latest == UpdateState::None;
        if !is_fresh {
            self.keep(Kept {
                trial: None,
                latest: UpdateState::None,
                ..self.kept
            })?;
        }
        self.write(slot, 0, bytes)?;
        self.receiving = Some(Receiving {
            slot,
            header,
            offset: 0,
        });
        Ok(0)
    }

    /// Whether an image is older than one that the board has, whatever is kept: than what runs; and, where nothing is kept of
    /// any image, than what stands whole in a slot. One that was given up there bars none, for that is kept.
    #[inline(never)]
    fn is_older(&mut self, header: &ImageHeader) -> bool {
        let is_older =
            |than: &ImageHeader| header.counter < than.counter || header.version < than.version;
        let knows_none = self.kept.active.is_none() && self.kept.latest == UpdateState::None;
        self.running.as_ref().is_some_and(|(_, of)| is_older(of))
            || knows_none
                && [false, true]
                    .into_iter()
                    .any(|slot| self.verified(slot).is_ok_and(|of| is_older(&of)))
    }

    /// Programs bytes, page by page: no page crosses the end of a sector, which is erased before its
    /// first.
    fn write(&mut self, slot: bool, at: u32, bytes: &[u8]) -> Result<(), UpdateError> {
        let flash = self.flash(slot);
        let geometry = flash.geometry();
        let word = (geometry.write_size as usize).max(1);
        let sector_size = geometry.sector_size.max(1);
        let mut at = at;
        let mut rest = bytes;
        while !rest.is_empty() {
            let room = PIECE - at as usize % PIECE;
            let (now, later) = rest.split_at(rest.len().min(room));
            let mut page = Page([ERASED; PIECE]);
            for (place, byte) in page.0.iter_mut().zip(now) {
                *place = *byte;
            }
            let whole = page.0.get(..now.len().next_multiple_of(word));
            let whole = whole.ok_or(UpdateError::Flash)?;
            if at.is_multiple_of(sector_size) {
                flash
                    .erase(at / sector_size)
                    .map_err(|_| UpdateError::Flash)?;
            }
            flash.program(at, whole).map_err(|_| UpdateError::Flash)?;
            at = at.saturating_add(now.len() as u32);
            rest = later;
        }
        Ok(())
    }

    /// Bytes of it: where the next is wanted. Those that stand elsewhere are not taken. All but the
    /// last piece must be a multiple of the flash's word.
    ///
    /// # Errors
    /// [`UpdateError`].
    pub fn piece(&mut self, offset: u32, bytes: &[u8]) -> Result<u32, UpdateError> {
        let receiving = self.receiving.clone().ok_or(UpdateRefusal::NotBegun)?;
        if offset != receiving.offset || bytes.is_empty() {
            return Ok(receiving.offset);
        }
        let count = u32::try_from(bytes.len()).map_err(|_| UpdateRefusal::Damaged)?;
        let end = offset.checked_add(count).ok_or(UpdateRefusal::Damaged)?;
        if end > receiving.header.length {
            return Err(UpdateRefusal::Damaged.into());
        }
        let word = self.flash(receiving.slot).geometry().write_size as usize;
        if !bytes.len().is_multiple_of(word.max(1)) && end != receiving.header.length {
            return Err(UpdateRefusal::Damaged.into());
        }
        // What is not written whole is begun anew.
        self.receiving = None;
        self.write(receiving.slot, IMAGE_HEADER as u32 + offset, bytes)?;
        self.receiving = Some(Receiving {
            offset: end,
            ..receiving
        });
        Ok(end)
    }

    /// It is whole: it is verified where it stands. It does not count before [`Self::mark`].
    ///
    /// # Errors
    /// [`UpdateError`]: what runs is as before.
    pub fn whole(&mut self) -> Result<ImageVersion, UpdateError> {
        if let (None, Some((slot, false))) = (&self.receiving, self.kept.trial) {
            // Asked twice.
            return self.verified(slot).map(|header| header.version);
        }
        let receiving = self.receiving.clone().ok_or(UpdateRefusal::NotBegun)?;
        if receiving.offset != receiving.header.length {
            return Err(UpdateRefusal::Damaged.into());
        }
        let header = self.verified(receiving.slot);
        if header.as_ref() != Ok(&receiving.header) {
            self.receiving = None;
            return Err(header.err().unwrap_or(UpdateRefusal::Damaged.into()));
        }
        Ok(receiving.header.version)
    }

    /// What [`Self::whole`] has verified runs on trial from the next start on.
    ///
    /// # Errors
    /// [`UpdateError`]: what runs is as before.
    pub fn mark(&mut self) -> Result<(), UpdateError> {
        if let (None, Some((_, false))) = (&self.receiving, self.kept.trial) {
            return Ok(());
        }
        let receiving = self.receiving.take().ok_or(UpdateRefusal::NotBegun)?;
        self.keep(Kept {
            trial: Some((receiving.slot, false)),
            latest: UpdateState::Trial,
            ..self.kept
        })
    }

    /// The version before and the one that runs on trial, if one does.
    #[must_use]
    pub fn trial(&self) -> Option<(ImageVersion, ImageVersion)> {
        let (_, header) = self.running.as_ref().filter(|_| self.on_trial)?;
        Some((self.kept.version, header.version))
    }

    /// The first half of the SHA-512 of what runs, as heads name it; none: it is built in.
    #[must_use]
    pub fn digest(&self) -> Option<[u8; 32]> {
        let (_, header) = self.running.as_ref()?;
        header.sha512.first_chunk().copied()
    }

    /// Reads a payload, piece by piece.
    fn pieces(
        &mut self,
        slot: bool,
        length: u32,
        mut take: impl FnMut(&[u8]),
    ) -> Result<(), UpdateError> {
        let mut page = Page([0; PIECE]);
        let mut at = 0;
        while at < length {
            let count = (length - at).min(PIECE as u32);
            let piece = page.0.get_mut(..count as usize).unwrap_or_default();
            let read = self.flash(slot).read(IMAGE_HEADER as u32 + at, piece);
            read.map_err(|_| UpdateError::Flash)?;
            take(piece);
            at += count;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
