//! Signed images that a host brings while this one runs, on boards with a boot loader.
//!
//! # Design
//!
//! The boot loader has verified this image and started it; on a Pico 2 it is the chip's boot ROM. It opens the images as
//! that has, takes the next into the other place, and, on trial, confirms itself when it has worked for [`TRIAL`]: measuring
//! answers, the journal keeps entries, the watchdog is fed. One that has not by [`PATIENCE`] resets the board, and the
//! one before starts again.

use embassy_time::{Duration, Instant, Timer};
use umi_app::App;
use umi_core::trust::access::update::slots::{Slots, UpdateError};
use umi_core::units::Micros;
use umi_protocol::update::{ImagePlace, ImageVersion};

use super::Part;
use crate::time::clock::BoardClock;

/// What an image on trial works before it is confirmed.
const TRIAL: Duration = Duration::from_secs(3);
/// From one try to confirm it to the next.
const TURN: Duration = Duration::from_secs(1);
/// One that is not confirmed by then is given up.
const PATIENCE: Duration = Duration::from_secs(30);

/// Where this image is linked for.
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

/// An image that a boot loader has started finds itself among the images.
///
/// # Errors
/// [`UpdateError`]: it does not stand where it is linked for.
#[allow(dead_code, reason = "a boot ROM's image is told where it stands")]
pub fn found(mut slots: Slots<Part>) -> Result<Slots<Part>, UpdateError> {
    slots.resume(PLACE)?;
    Ok(slots)
}

/// The image that runs, by the images as it has found them: before anything that cannot wait. With the version of the image
/// whose trial was ended before this start.
pub fn running(
    slots: Result<Slots<Part>, UpdateError>,
    reverted: Option<ImageVersion>,
) -> RunningImage {
    if slots.is_err() {
        defmt::error!("the images cannot be read: none is taken");
    }
    let mut slots = slots.ok();
    RunningImage {
        version: slots.as_mut().map(|slots| slots.info().version),
        digest: slots.as_ref().and_then(Slots::digest).unwrap_or_default(),
        slots,
        reverted,
    }
}

impl RunningImage {
    /// Whether it still has to show that it works.
    #[allow(
        dead_code,
        reason = "a boot ROM restarts what it is to try by the watchdog"
    )]
    pub fn is_on_trial(&self) -> bool {
        self.slots.as_ref().is_some_and(|of| of.trial().is_some())
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

/// Ends the trial of this image, if it is on trial: it is confirmed, or given up by a reset.
pub async fn end_trial(app: &App<Part>, give_up: fn() -> !) {
    Timer::after(TRIAL).await;
    while !app.confirm(&BoardClock).await {
        if Instant::now().as_ticks() > PATIENCE.as_ticks() {
            defmt::error!("this image does not work here: the one before runs again");
            give_up()
        }
        Timer::after(TURN).await;
    }
}
