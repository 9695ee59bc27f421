//! Signed images that a host brings while this one runs.
//!
//! # Design
//!
//! The boot loader has verified this image and started it; on a Pico 2 it is the chip's boot ROM. It opens the images as
//! that has, takes the next into the other place, and, on trial, confirms itself when it has worked for [`TRIAL`]: measuring
//! answers, the journal keeps entries, the watchdog is fed. One that has not by [`PATIENCE`] resets the board, and the
//! one before starts again.

use embassy_rp::Peri;
use embassy_rp::peripherals::FLASH;
use embassy_time::{Duration, Instant, Timer};
use umi_app::App;
use umi_core::trust::access::update::slots::Slots;
use umi_core::units::Micros;
use umi_protocol::message::ResetReason;
#[cfg(not(feature = "slot-ab"))]
use umi_protocol::update::ImagePlace;
use umi_protocol::update::ImageVersion;

#[cfg(feature = "slot-ab")]
use super::ab_images::take_over;
#[cfg(not(feature = "slot-ab"))]
use super::images;
use super::{FoundImages, Part};
use crate::safety::guard;
use crate::time::clock::BoardClock;

/// What an image on trial works before it is confirmed.
const TRIAL: Duration = Duration::from_secs(3);
/// From one try to confirm it to the next.
const TURN: Duration = Duration::from_secs(1);
/// One that is not confirmed by then is given up.
const PATIENCE: Duration = Duration::from_secs(30);

/// Where this image is linked for.
#[cfg(not(feature = "slot-ab"))]
const PLACE: ImagePlace = if cfg!(feature = "slot-a") {
    ImagePlace::A
} else {
    ImagePlace::B
};

/// The image that runs, as far as it knows itself.
pub struct RunningImage {
    /// None: the images cannot be read, and none is taken.
    slots: Option<Slots<Part>>,
    /// First half of its SHA-512; zeros: it cannot be read.
    pub digest: [u8; 32],
    /// By its signed header; none: it cannot be read.
    pub version: Option<ImageVersion>,
    /// The image whose trial the boot loader has ended before this start: its version.
    reverted: Option<ImageVersion>,
}

/// The images as the boot loader has left them.
#[cfg(not(feature = "slot-ab"))]
fn take_over(flash: &Peri<'static, FLASH>) -> Option<FoundImages> {
    let reverted = images::take_reverted();
    let opened = images::open(flash, Part::Chip);
    let slots = opened.and_then(|mut slots| slots.resume(PLACE).map(|()| slots));
    Some(FoundImages {
        slots: slots.ok(),
        reverted,
    })
}

/// Opens the images and finds itself among them: before anything that cannot wait. None: this image may not run.
pub fn resume(flash: &Peri<'static, FLASH>) -> Option<RunningImage> {
    let FoundImages {
        mut slots,
        reverted,
    } = take_over(flash)?;
    if slots.is_none() {
        defmt::error!("the images cannot be read: none is taken");
    }
    Some(RunningImage {
        version: slots.as_mut().map(|slots| slots.info().version),
        digest: slots.as_ref().and_then(Slots::digest).unwrap_or_default(),
        slots,
        reverted,
    })
}

impl RunningImage {
    /// Why the board started: the boot ROM restarts by the watchdog what it was asked to try.
    pub fn reason(&self, seen: ResetReason) -> ResetReason {
        let is_tried = self.slots.as_ref().is_some_and(|of| of.trial().is_some());
        let is_asked = cfg!(feature = "slot-ab") && is_tried;
        match seen {
            ResetReason::Watchdog if is_asked => ResetReason::Software,
            seen => seen,
        }
    }

    /// Lets the application take images: before its start.
    pub fn enter(&mut self, app: &App<Part>) {
        if let Some(slots) = self.slots.take() {
            // No task has begun.
            let _ = app.takes_images(slots);
        }
    }

    /// The application has started: what became of the trial before is journaled.
    pub fn tell(&self, app: &App<Part>, now: Micros) {
        if let Some(to) = self.reverted {
            let _ = app.tell_reverted(now, to);
        }
    }
}

/// Ends the trial of this image, if it is on trial.
pub async fn end_trial(app: &App<Part>) {
    Timer::after(TRIAL).await;
    while !app.confirm(&BoardClock).await {
        if Instant::now().as_ticks() > PATIENCE.as_ticks() {
            defmt::error!("this image does not work here: the one before runs again");
            guard::reset_now()
        }
        Timer::after(TURN).await;
    }
}
