//! The board's own key, the keys of people, and the jumper that makes the first owner.
//!
//! # Design
//!
//! The jumper leads PF8 to 0 V; the chip pulls the pin up. Neither the control's line nor USB reaches that pin.

use embassy_stm32::gpio::{Input, Pull};
use embassy_stm32::peripherals::PF8;
use embassy_stm32::{Peri, pac};
use static_cell::StaticCell;
use umi_app::access::Keeper;
use umi_app::measure::trust::heads::HeadSigner;
use umi_core::trust::board_key::BoardKey;
use umi_core::units::Micros;

use super::chip_flash::{ChipFlash, KEPT};
use super::{Part, noise};
use crate::resources::CORE_HZ;

/// PF8.
const JUMPER: usize = 8;

/// The pull-up charges some 50 pF by 50 kΩ in 3 us.
const SETTLES_US: u32 = 20;

/// Pulls the jumper's pin up, for ever.
pub fn pull_up_jumper(pin: Peri<'static, PF8>) {
    core::mem::forget(Input::new(pin, Pull::Up));
}

/// Whether the jumper is closed now.
fn jumper_is_closed() -> bool {
    // Three times: a spike closes nothing.
    (0..3).all(|_| {
        cortex_m::asm::delay(CORE_HZ / 1_000_000 * SETTLES_US);
        pac::GPIOF.idr().read().0 >> JUMPER & 1 == 0
    })
}

/// Takes up the board's key, or draws one at the first start; none: the board signs nothing and cannot
/// be claimed. To be called before anything that cannot wait, and no more once there is one: now and then a sector is erased, for two seconds.
/// Where the board is being wiped (`is_wiping`), one that cannot be read is drawn anew, and nothing of the images counts any more.
pub fn board_key(is_wiping: bool) -> Option<BoardKey> {
    let flash = ChipFlash::new(KEPT);
    let opened = match is_wiping {
        true => BoardKey::renew(flash, noise::draw),
        false => BoardKey::open(flash, noise::draw),
    };
    if opened.is_err() {
        defmt::error!("the board has no key: it signs nothing");
    }
    opened.ok()
}

/// What signs by this key. To be called once.
/// `image` is the first half of the SHA-512 of the signed image that runs; zeros: it was not signed.
pub fn signer(key: Option<BoardKey>, image: [u8; 32]) -> Option<&'static HeadSigner> {
    static SIGNING: StaticCell<HeadSigner> = StaticCell::new();
    key.map(|key| &*SIGNING.init(HeadSigner::new(key, image)))
}

/// The keys of people.
pub fn keeper(access: Part, signer: Option<&'static HeadSigner>, now: Micros) -> Keeper<Part> {
    Keeper::open(access, jumper_is_closed, signer, noise::draw, now)
}
