//! The board's own key, the keys of people, and the jumper that makes the first owner.
//!
//! # Design
//!
//! No pin is left, so the jumper shares the journal's MISO: 4.7 kΩ from GP4 to 0 V. While the chip is
//! not selected it drives nothing, and the pull-up reads high without the jumper, low with it. While it
//! is selected it drives against 0.7 mA, which it does not feel. Nobody is asked while it is: whoever
//! asks holds the lock of the measuring, which alone uses the chip. Neither the control's line nor USB
//! reaches that pin.

use embassy_rp::pac;
use static_cell::StaticCell;
use umi_app::access::Keeper;
use umi_app::measure::trust::heads::HeadSigner;
use umi_core::trust::board_key::BoardKey;
use umi_core::units::Micros;

use super::chip_flash::ChipFlash;
use super::{Part, noise};
use crate::resources::CLOCK_HZ;

/// MISO of the journal's chip, and its select line, low while it is selected.
const JUMPER: usize = 4;
const SELECT: usize = 5;

/// The pull-up charges some 50 pF by 80 kΩ in 4 us.
const SETTLES_US: u32 = 20;

/// Pulls the jumper's pin up: behind the set-up of the line, which has it otherwise.
pub fn pull_up_jumper() {
    pac::PADS_BANK0.gpio(JUMPER).modify(|pad| {
        pad.set_pde(false);
        pad.set_pue(true);
    });
}

/// Whether the jumper is closed now. Not while the chip is selected: then it is nobody's.
fn jumper_is_closed() -> bool {
    let is_low = || {
        let pins = pac::SIO.gpio_in(0).read();
        pins >> JUMPER & 1 == 0 && pins >> SELECT & 1 == 1
    };
    // Three times: a spike closes nothing.
    (0..3).all(|_| {
        cortex_m::asm::delay(CLOCK_HZ / 1_000_000 * SETTLES_US);
        is_low()
    })
}

/// Takes up the board's key, or draws one at the first start; none: the board signs nothing and cannot
/// be claimed. To be called before anything that cannot wait, and no more once there is one.
/// `image` is the first half of the SHA-512 of the signed image that runs; zeros: it was not signed.
/// Where the board is being wiped (`is_wiping`), a key that cannot be read is drawn anew.
pub fn signer(
    flash: &mut ChipFlash,
    image: [u8; 32],
    is_wiping: bool,
) -> Option<&'static HeadSigner> {
    static SIGNING: StaticCell<HeadSigner> = StaticCell::new();
    let opened = match is_wiping {
        true => BoardKey::renew(flash, noise::draw),
        false => BoardKey::open(flash, noise::draw),
    };
    match opened {
        Ok(key) => Some(SIGNING.init(HeadSigner::new(key, image))),
        Err(_) => {
            defmt::error!("the board has no key: it signs nothing");
            None
        }
    }
}

/// The keys of people.
pub fn keeper(access: Part, signer: Option<&'static HeadSigner>, now: Micros) -> Keeper<Part> {
    Keeper::open(access, jumper_is_closed, signer, noise::draw, now)
}
