//! The chip's source of noise: a ring oscillator, of which [`umi_core::trust::entropy`] makes keys.
//!
//! # Design
//!
//! RP2040: RANDOMBIT is the level of the ring oscillator, which nothing else uses (the chip runs from
//! its crystal). It is looked at each [`SAMPLE_US`], as the maker's own library does it (pico-sdk,
//! pico_rand), so that its jitter adds up. RP2350: the TRNG samples a ring of its own and tests it.
//!
//! # Limitations
//!
//! The maker says of RANDOMBIT that it does not meet the requirements of randomness for security
//! systems, because it can be compromised (RP2040 data sheet, 2.17.5): whoever can feed a frequency into
//! the board's supply may know it. It has been tried in an emulator only, which has a generator in its
//! place. On a board whose source fails its tests no key is made.

use core::cell::RefCell;

use critical_section::Mutex;
use embassy_rp::pac;
use umi_core::trust::board_key::NoEntropy;
use umi_core::trust::entropy::EntropyPool;

#[cfg(not(feature = "rp2350"))]
use crate::resources::CLOCK_HZ;

static POOL: Mutex<RefCell<EntropyPool>> = Mutex::new(RefCell::new(EntropyPool::new()));

/// Fills 32 bytes. Takes ten milliseconds, in which higher interrupts go on.
///
/// # Errors
/// [`NoEntropy`]: the source is broken.
pub fn draw(into: &mut [u8; 32]) -> Result<(), NoEntropy> {
    // Only one task draws: it is never lent twice.
    let mut pool = critical_section::with(|cs| {
        let place = POOL.borrow(cs).try_borrow_mut().map_err(|_| NoEntropy);
        place.map(|mut pool| core::mem::take(&mut *pool))
    })?;
    let mut source = Source::start();
    let drawn = pool.draw(into, || source.bit());
    critical_section::with(|cs| POOL.borrow(cs).replace(pool));
    drawn.and(source.end())
}

/// The ring oscillator.
#[cfg(not(feature = "rp2350"))]
struct Source;

#[cfg(not(feature = "rp2350"))]
impl Source {
    /// Time from bit to bit.
    const SAMPLE_US: u32 = 10;

    /// It runs from the reset on.
    fn start() -> Self {
        Self
    }

    /// Its level now.
    fn bit(&mut self) -> bool {
        cortex_m::asm::delay(CLOCK_HZ / 1_000_000 * Self::SAMPLE_US);
        pac::ROSC.randombit().read().randombit()
    }

    fn end(self) -> Result<(), NoEntropy> {
        Ok(())
    }
}

/// The TRNG: six words at a time, behind its own three tests (RP2350 data sheet, 12.12).
#[cfg(feature = "rp2350")]
struct Source {
    words: [u32; 6],
    /// Bits of them that were given.
    given: usize,
    failed: bool,
}

#[cfg(feature = "rp2350")]
impl Source {
    const BITS: usize = 192;
    /// Clocks from sample to sample, with the shortest ring but one: what the data sheet names for
    /// two milliseconds a block.
    const SAMPLE_CLOCKS: u32 = 25;
    const RING: u8 = 1;
    /// Looks at the TRNG, each of which takes some ten cycles: a hundred times as long as a block.
    const MOST_LOOKS: u32 = 2_000_000;

    fn start() -> Self {
        pac::TRNG
            .rng_imr()
            .write(|w| w.set_ehr_valid_int_mask(true));
        pac::TRNG
            .trng_config()
            .write(|w| w.set_rnd_src_sel(Self::RING));
        pac::TRNG.sample_cnt1().write_value(Self::SAMPLE_CLOCKS);
        pac::TRNG.trng_debug_control().write(|_| {});
        pac::TRNG
            .rnd_source_enable()
            .write(|w| w.set_rnd_src_en(true));
        Self {
            words: [0; 6],
            given: Self::BITS,
            failed: false,
        }
    }

    /// The next bit; anything where the TRNG gives none.
    fn bit(&mut self) -> bool {
        if self.given == Self::BITS {
            self.given = 0;
            self.failed |= self.fill().is_err();
        }
        let word = self.words.get(self.given / 32).copied().unwrap_or_default();
        let bit = word >> (self.given % 32) & 1 == 1;
        self.given += 1;
        bit
    }

    /// Waits for a block. A test of the TRNG's own that fails stops it: then there is none.
    fn fill(&mut self) -> Result<(), NoEntropy> {
        let is_there = || pac::TRNG.trng_valid().read().ehr_valid();
        (!self.failed && (0..Self::MOST_LOOKS).any(|_| is_there()))
            .then_some(())
            .ok_or(NoEntropy)?;
        self.words = [
            pac::TRNG.ehr_data0(),
            pac::TRNG.ehr_data1(),
            pac::TRNG.ehr_data2(),
            pac::TRNG.ehr_data3(),
            pac::TRNG.ehr_data4(),
            // Reading the last one begins the next block.
            pac::TRNG.ehr_data5(),
        ]
        .map(|register| register.read());
        Ok(())
    }

    fn end(self) -> Result<(), NoEntropy> {
        pac::TRNG
            .rnd_source_enable()
            .write(|w| w.set_rnd_src_en(false));
        if self.failed { Err(NoEntropy) } else { Ok(()) }
    }
}
