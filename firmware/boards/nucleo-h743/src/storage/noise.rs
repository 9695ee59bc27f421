//! The chip's TRNG, of which [`umi_core::trust::entropy`] makes keys.
//!
//! # Design
//!
//! The generator tests its own source and clock (RM0433, RNG, error management). Where it says that one of them was wrong, or gives
//! the zero that it gives then, nothing of this draw counts; the next draw starts it anew. The HAL's driver is not used:
//! it waits for ever where the generator's clock has stopped.
//!
//! # Limitations
//!
//! It has never been run: nobody has looked at the bits of a chip.

use core::cell::RefCell;

use critical_section::Mutex;
use embassy_stm32::{pac, peripherals, rcc};
use umi_core::trust::board_key::NoEntropy;
use umi_core::trust::entropy::EntropyPool;

static POOL: Mutex<RefCell<EntropyPool>> = Mutex::new(RefCell::new(EntropyPool::new()));

/// Fills 32 bytes.
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

/// The generator, at work.
struct Source {
    word: u32,
    /// Bits of it that were given.
    given: u32,
    failed: bool,
}

impl Source {
    /// Looks for a word, each of which takes ten cycles at least: a hundred times as long as one takes.
    const MOST_LOOKS: u32 = 100_000;

    fn start() -> Self {
        rcc::enable_and_reset::<peripherals::RNG>();
        // CED = 0: its clock is watched.
        pac::RNG.cr().write(|w| w.set_rngen(true));
        let mut source = Self {
            word: 0,
            given: u32::BITS,
            failed: false,
        };
        // The first word is not used (RM0433, RNG, operation).
        source.fill();
        source
    }

    /// The next bit; anything where there is none.
    fn bit(&mut self) -> bool {
        if self.given == u32::BITS {
            self.given = 0;
            self.fill();
        }
        let bit = self.word >> self.given & 1 == 1;
        self.given += 1;
        bit
    }

    /// Waits for a word. What was wrong once is wrong to the end of the draw.
    fn fill(&mut self) {
        let is_there = || pac::RNG.sr().read().drdy();
        let came = !self.failed && (0..Self::MOST_LOOKS).any(|_| is_there());
        self.word = if came { pac::RNG.dr().read() } else { 0 };
        let state = pac::RNG.sr().read();
        let is_wrong = state.seis() || state.secs() || state.ceis() || state.cecs();
        self.failed |= self.word == 0 || is_wrong;
    }

    fn end(self) -> Result<(), NoEntropy> {
        pac::RNG.cr().write(|w| w.set_rngen(false));
        rcc::disable::<peripherals::RNG>();
        if self.failed { Err(NoEntropy) } else { Ok(()) }
    }
}
