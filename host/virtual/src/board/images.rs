//! The image that a virtual board runs: a payload of text, in slots as the boards have them.
//!
//! ```text
//! umi-virtual-image
//! confirms = true
//! ```
//!
//! The program is the same whatever the text says. One that says `confirms = false`, or that is no
//! such text, runs on trial and never passes its self-test: the next start goes back.

use std::io;
use std::path::Path;
use std::time::Duration;

use tokio::time::{Instant, sleep, sleep_until};
use umi_app::App;
use umi_core::journal::Geometry;
use umi_core::trust::access::update::slots::{ImageKind, Maker, Slots};
use umi_core::units::Micros;
use umi_protocol::update::ImageVersion;

use super::VirtualFlash;
use super::clock::VirtualClock;

/// Which image counts.
pub const SLOTS: Geometry = Geometry {
    sectors: 4,
    sector_size: 4096,
    write_size: 1,
    page_size: 256,
};

/// A slot: 640 KiB.
pub const SLOT: Geometry = Geometry {
    sectors: 160,
    sector_size: 4096,
    write_size: 1,
    page_size: 256,
};

/// An image on trial works for so long before it is looked at.
const LOOK: Duration = Duration::from_millis(200);

/// One that is not confirmed by then is given up.
const TRIAL: Duration = Duration::from_millis(1000);

/// Flash of the images.
#[derive(Clone, Debug)]
pub struct ImageAreas {
    /// Which of them counts.
    pub state: VirtualFlash,
    /// The images.
    pub slots: [VirtualFlash; 2],
}

impl ImageAreas {
    /// New flash.
    #[must_use]
    pub fn in_memory() -> Self {
        Self {
            state: VirtualFlash::in_memory(SLOTS),
            slots: [SLOT, SLOT].map(VirtualFlash::in_memory),
        }
    }

    /// Flash in files of a folder.
    ///
    /// # Errors
    /// As [`VirtualFlash::in_file`].
    pub fn in_folder(folder: &Path) -> io::Result<Self> {
        let slot = |name| VirtualFlash::in_file(SLOT, &folder.join(name));
        Ok(Self {
            state: VirtualFlash::in_file(SLOTS, &folder.join("slots.flash"))?,
            slots: [slot("slot-a.flash")?, slot("slot-b.flash")?],
        })
    }
}

/// What runs from a start on.
pub(super) struct RunningImage {
    /// Until the application has them.
    slots: Option<Slots<VirtualFlash>>,
    version: ImageVersion,
    digest: Option<[u8; 32]>,
    on_trial: bool,
    confirms: bool,
    reverted: Option<ImageVersion>,
}

impl RunningImage {
    /// Verifies what is to run; none: the flash does not keep what counts, and what is built in runs.
    pub fn start(areas: ImageAreas, maker: Option<[u8; 32]>) -> Option<Self> {
        let version = [
            env!("CARGO_PKG_VERSION_MAJOR"),
            env!("CARGO_PKG_VERSION_MINOR"),
            env!("CARGO_PKG_VERSION_PATCH"),
        ];
        let kind = ImageKind {
            boards: ["virtual"; 2],
            built_in: Some(version.map(|part| part.parse().unwrap_or_default())),
        };
        let ImageAreas { state, slots } = areas;
        let mut slots = Slots::open(state, slots, kind, Maker::First(maker)).ok()?;
        let started = slots.start().ok()?;
        let mut room = [0; 256];
        let text = slots.payload(&mut room).unwrap_or_default();
        Some(Self {
            confirms: confirms(text),
            version: slots.info().version,
            digest: slots.digest(),
            slots: Some(slots),
            on_trial: started.on_trial,
            reverted: started.reverted,
        })
    }

    /// Its version.
    pub fn version(&self) -> String {
        let [major, minor, patch] = self.version;
        format!("{major}.{minor}.{patch}")
    }

    /// The application is this image: before its start.
    pub fn enter(&mut self, app: &App<VirtualFlash>) {
        if let Some(slots) = self.slots.take() {
            // No task has begun.
            let _ = app.takes_images(slots);
        }
    }

    /// First half of its SHA-512; none: it is built in.
    pub fn digest(&self) -> Option<[u8; 32]> {
        self.digest
    }

    /// The application has started: what became of the trial before is journaled.
    pub fn tell(&self, app: &App<VirtualFlash>, now: Micros) {
        if let Some(to) = self.reverted {
            let _ = app.tell_reverted(now, to);
        }
    }

    /// Returns when the board is to start anew, because an image on trial is not confirmed.
    pub async fn given_up(&mut self, app: &App<VirtualFlash>, clock: &VirtualClock) {
        let end = Instant::now() + TRIAL;
        while self.on_trial && Instant::now() < end {
            sleep(LOOK).await;
            if self.confirms && app.confirm(clock).await {
                self.on_trial = false;
            }
        }
        match self.on_trial {
            true => sleep_until(end).await,
            false => std::future::pending().await,
        }
    }
}

/// Whether a payload is one that works.
fn confirms(payload: &[u8]) -> bool {
    let text = String::from_utf8_lossy(payload);
    let mut lines = text.lines();
    lines.next() == Some("umi-virtual-image") && lines.next() == Some("confirms = true")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Only what says so works.
    #[test]
    fn a_payload_is_a_text() {
        assert!(confirms(b"umi-virtual-image\nconfirms = true\n"));
        for text in [
            "umi-virtual-image\nconfirms = false\n",
            "umi-virtual-image\n",
            "confirms = true\n",
            "",
        ] {
            assert!(!confirms(text.as_bytes()), "{text}");
        }
    }
}
