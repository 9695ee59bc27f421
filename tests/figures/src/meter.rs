//! Who counts, what work is called, and the flash that it is done on.

use core::convert::Infallible;

use umi_core::journal::{ERASED, Flash, Geometry};

/// Work that did not come to its result: its count would mean nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Failed(pub &'static str);

/// Who counts: given the name of the work, how many units of it are done in one go, and
/// what does it.
pub trait Meter {
    /// Does it, once, and counts.
    fn measure(&mut self, work: &'static str, units: u32, run: &mut dyn FnMut());
}

/// Does something a few times and counts it; `what` says whether it worked.
pub(crate) fn repeated(
    meter: &mut impl Meter,
    work: &'static str,
    times: u32,
    mut what: impl FnMut() -> bool,
) -> Result<(), Failed> {
    let mut all_worked = true;
    meter.measure(work, times, &mut || {
        for _ in 0..times {
            all_worked &= what();
        }
    });
    all_worked.then_some(()).ok_or(Failed(work))
}

/// The name and the work go together, and a test that holds the count names it.
pub mod names {
    /// A byte of DPRNT text.
    pub const BYTE: &str = "DPRNT text, a byte";
    /// A sphere of five hits.
    pub const SPHERE_5: &str = "sphere of 5 points with covariance";
    /// A best fit of a scan.
    pub const SPHERE_500: &str = "sphere of 500 points with covariance";
    /// Three datum features.
    pub const REGISTRATION_3: &str = "registration of 3 pairs with covariance";
    /// Five datum features.
    pub const REGISTRATION_5: &str = "registration of 5 pairs with covariance";
    /// A best fit of a scan to its nominal points.
    pub const REGISTRATION_500: &str = "registration of 500 pairs with covariance";
    /// A journal entry.
    pub const APPEND: &str = "journal entry of 64 bytes";
    /// From the last hit's line to the correction.
    pub const VERDICT: &str = "last hit of a setup: its sphere, registration, verdict, correction";
    /// A tool path on its way to a control: what it was.
    pub const LACES: &str = "tool path of lines rewritten, a byte read";
    /// A tool path on its way to a control: what it becomes.
    pub const CHORDS: &str = "tool path of arcs rewritten as chords, a byte written";
    /// A point sensor on a ball: the paper's spiral.
    pub const CALIBRATION_100: &str = "calibration of a point sensor by 100 readings";
    /// P = Q + t + γ g a.
    pub const PLACE: &str = "point of a reading of a point sensor";
    /// Text, pairing and average of a capture at rest.
    pub const READING: &str =
        "reading of a point sensor, its text of 27 bytes paired with its capture";
    /// A head, as the board signs it.
    pub const SIGN: &str = "Ed25519 signature of a head";
    /// The header of an image, as each start verifies it.
    pub const VERIFY: &str = "Ed25519 verification of an image's header";
    /// A host's key is proven, but for the board's own signature: two products on X25519's curve, a
    /// verification, two keys.
    pub const SESSION: &str = "session opened: X25519, Ed25519 verification, HKDF";
    /// A frame of a session.
    pub const SEAL: &str = "seal of a frame of 100 bytes, HMAC-SHA-256";
    /// An image, as each start verifies it.
    pub const DIGEST: &str = "SHA-512 of an image, a byte";
    /// All of it.
    pub const SETUP: &str = "setup of 15 hits, from its first byte to its correction";
}

const SECTOR: usize = 4096;
const SECTORS: usize = 4;
const RAM: usize = SECTORS * SECTOR;

/// Flash that takes no time: the journal's own work is counted.
pub(crate) struct Ram([u8; RAM]);

impl Ram {
    /// New flash.
    pub const fn new() -> Self {
        Self([ERASED; RAM])
    }
}

impl Flash for Ram {
    type Error = Infallible;

    fn geometry(&self) -> Geometry {
        Geometry {
            sectors: SECTORS as u16,
            sector_size: SECTOR as u32,
            write_size: 1,
            page_size: 256,
        }
    }

    fn read(&mut self, addr: u32, into: &mut [u8]) -> Result<(), Infallible> {
        if let Some(cells) = self.0.get(addr as usize..addr as usize + into.len()) {
            into.copy_from_slice(cells);
        }
        Ok(())
    }

    fn program(&mut self, addr: u32, bytes: &[u8]) -> Result<(), Infallible> {
        let cells = self.0.get_mut(addr as usize..addr as usize + bytes.len());
        if let Some(cells) = cells {
            cells.copy_from_slice(bytes);
        }
        Ok(())
    }

    fn erase(&mut self, sector: u32) -> Result<(), Infallible> {
        let at = sector as usize * SECTOR;
        if let Some(cells) = self.0.get_mut(at..at + SECTOR) {
            cells.fill(ERASED);
        }
        Ok(())
    }
}
