//! The cache of the flash that the code runs from: whether it counts, and what a line costs that is
//! not in it. Every figure of the README rests on that (`tests/rp2040/cache.js`).

use embassy_rp::pac;

/// Lines of eight bytes: a quarter of the cache.
pub const LINES: u32 = 512;
const LINE_BYTES: u32 = 8;
const WORD_BYTES: u32 = 4;
/// Reads of a line.
pub const WORDS: u32 = LINE_BYTES / WORD_BYTES;
/// Flash that no image reaches, and that nobody else reads.
const AWAY: u32 = 0x1010_0000;
/// Other such flash: what is read there takes the place of everything in the cache.
#[cfg(feature = "rp2350")]
const ELSEWHERE: u32 = 0x1014_0000;
#[cfg(feature = "rp2350")]
const FILLING_LINES: u32 = 8192;

/// What the counters say of lines that were read twice, first when none was in the cache.
pub struct Seen {
    /// Reads.
    pub reads: u32,
    /// Of them, those that the cache answered.
    pub hits: u32,
    /// How much longer the first time took, microseconds.
    pub longer_us: u32,
}

/// Reads the lines twice. It runs from RAM (`link/ram-code.x`), with all interrupts off for 0.3 ms: so
/// nothing else is fetched.
#[inline(never)]
pub fn measure() -> Seen {
    cortex_m::interrupt::free(|_| {
        let counters = pac::XIP_CTRL;
        forget();
        counters.ctr_hit().write_value(0);
        counters.ctr_acc().write_value(0);
        let first_us = read(AWAY, LINES);
        let second_us = read(AWAY, LINES);
        Seen {
            reads: counters.ctr_acc().read(),
            hits: counters.ctr_hit().read(),
            longer_us: first_us.wrapping_sub(second_us),
        }
    })
}

/// Nothing is in the cache.
#[inline(always)]
fn forget() {
    #[cfg(not(feature = "rp2350"))]
    {
        let flush = pac::XIP_CTRL.flush();
        flush.write(|w| w.set_flush(true));
        // It answers when it is done.
        flush.read();
    }
    #[cfg(feature = "rp2350")]
    read(ELSEWHERE, FILLING_LINES);
}

/// Reads both words of each of these lines: a miss may fetch one of them alone. Returns how long that took, microseconds.
#[inline(always)]
fn read(from: u32, lines: u32) -> u32 {
    #[cfg(not(feature = "rp2350"))]
    let timer = pac::TIMER;
    #[cfg(feature = "rp2350")]
    let timer = pac::TIMER0;
    let began_us = timer.timerawl().read();
    for word in 0..lines.wrapping_mul(WORDS) {
        let address = from.wrapping_add(word.wrapping_mul(WORD_BYTES));
        // SAFETY: the window of the flash is 16 MB long, whatever flash there is, and aligned.
        let _ = unsafe { (address as *const u32).read_volatile() };
    }
    timer.timerawl().read().wrapping_sub(began_us)
}
