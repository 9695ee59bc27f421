//! Signed images in two slots of the flash: the code that a board's updates run by, with a payload of
//! text in place of machine code.
//!
//! ```text
//! umi-virtual-image
//! confirms = true
//! ```
//!
//! # Limitations
//!
//! QEMU starts what it was given, whatever the slots hold: what is tried here is how an image comes, is
//! verified, tried, kept and given up on this core, not a boot loader. That is the emulated Pico's.

use core::fmt::Write as _;

use embassy_time::{Duration, Instant, Timer};
use umi_app::App;
use umi_core::trust::access::update::slots::{ImageKind, Maker, Slots};
use umi_core::units::Micros;
use umi_protocol::job::Name;
use umi_protocol::update::ImageVersion;

use super::{Region, SlotRegions};
use crate::clock::BoardClock;
use crate::crash_note;

/// An image on trial works for so long before it is looked at, and looked at again.
const LOOK: Duration = Duration::from_millis(200);

/// One that is not confirmed by then is given up.
const TRIAL: Duration = Duration::from_secs(1);

/// Who has the answer of a board that starts anew needs so long to read it.
const ANSWER: Duration = Duration::from_millis(200);

/// What this program is where no slot holds an image.
const BUILT_IN: ImageVersion = [
    number(env!("CARGO_PKG_VERSION_MAJOR")),
    number(env!("CARGO_PKG_VERSION_MINOR")),
    number(env!("CARGO_PKG_VERSION_PATCH")),
];

/// A number of the package's version: they have few digits.
const fn number(text: &str) -> u16 {
    let mut digits = text.as_bytes();
    let mut number = 0;
    while let Some((digit, rest)) = digits.split_first() {
        number = number * 10 + (*digit - b'0') as u16;
        digits = rest;
    }
    number
}

/// What runs from a start on.
pub struct RunningImage {
    /// Until the application has them; none: what counts cannot be read, and no image is taken.
    slots: Option<Slots<Region>>,
    version: ImageVersion,
    /// First half of its SHA-512; zeros: it is built in.
    pub digest: [u8; 32],
    on_trial: bool,
    confirms: bool,
    reverted: Option<ImageVersion>,
}

impl RunningImage {
    /// Verifies what is to run.
    pub fn start(areas: SlotRegions) -> Self {
        let SlotRegions {
            state,
            slots,
            maker,
        } = areas;
        let kind = ImageKind {
            boards: ["mps2-an500"; 2],
            built_in: Some(BUILT_IN),
        };
        let maker = Maker::First((maker != [0; 32]).then_some(maker));
        let mut image = Self {
            slots: None,
            version: BUILT_IN,
            digest: [0; 32],
            on_trial: false,
            confirms: false,
            reverted: None,
        };
        let Ok(mut slots) = Slots::open(state, slots, kind, maker) else {
            return image;
        };
        let Ok(started) = slots.start() else {
            return image;
        };
        let mut room = [0; 256];
        image.confirms = confirms(slots.payload(&mut room).unwrap_or_default());
        image.version = slots.info().version;
        image.digest = slots.digest().unwrap_or_default();
        (image.on_trial, image.reverted) = (started.on_trial, started.reverted);
        // Without a maker's key nothing could be taken.
        image.slots = slots.has_maker().then_some(slots);
        image
    }

    /// Its version.
    pub fn version(&self) -> Name {
        let [major, minor, patch] = self.version;
        let mut text = Name::new();
        // There is room for three numbers.
        let _ = write!(text, "{major}.{minor}.{patch}");
        text
    }

    /// The application is this image: before its start.
    pub fn enter(&mut self, app: &App<Region>) {
        if let Some(slots) = self.slots.take() {
            // No task has begun.
            let _ = app.takes_images(slots);
        }
    }

    /// The application has started: what became of the trial before is journaled.
    pub fn tell(&self, app: &App<Region>, now: Micros) {
        if let Some(to) = self.reverted {
            let _ = app.tell_reverted(now, to);
        }
    }

    /// The trial that has to end; none: this image is not on trial.
    pub fn trial(&self) -> Option<ImageTrial> {
        let confirms = self.confirms;
        self.on_trial.then_some(ImageTrial { confirms })
    }
}

/// Of an image that has to confirm itself.
#[derive(Clone, Copy)]
pub struct ImageTrial {
    /// Whether it says that it works.
    confirms: bool,
}

impl ImageTrial {
    /// Confirms the image where it works; else the board starts anew, and the one before runs.
    pub async fn end(self, app: &App<Region>) {
        while Instant::now() < Instant::MIN + TRIAL {
            Timer::after(LOOK).await;
            if self.confirms && app.confirm(&BoardClock).await {
                return;
            }
        }
        crash_note::restart()
    }
}

/// Starts the board anew when its host has asked for it and has its answer.
pub async fn restart_when_asked(app: &App<Region>) -> ! {
    app.restarts().await;
    Timer::after(ANSWER).await;
    crash_note::restart()
}

/// Whether a payload is one that works.
fn confirms(payload: &[u8]) -> bool {
    payload.starts_with(b"umi-virtual-image\nconfirms = true\n")
}
