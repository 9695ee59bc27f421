//! What the control's line brings, on its way to memory: each character with its error bits, by DMA.
//!
//! # Design
//!
//! The port has no FIFO, so a character must be taken before the next one is whole. The DMA does
//! that within a microsecond, whatever runs in the core: two channels start each other, and each
//! makes one transfer. So characters lie in turn in two rings, and each of them asks for an
//! interrupt that stays asked for. An interrupt that is late finds more than one of them, and loses
//! none before [`WORDS`] of them wait: 11 ms of the fastest line.
//!
//! A place that is read is marked as empty again: a word of the port has twelve bits. Where no place
//! was empty, characters have been written over others, nobody knows how many: one is told as lost.

use core::sync::atomic::{AtomicU16, AtomicUsize, Ordering};

use embassy_rp::pac;
use embassy_rp::pac::dma::Channel;
use embassy_rp::pac::dma::regs::CtrlTrig;
use embassy_rp::pac::dma::vals::{DataSize, TreqSel};

use crate::resources::LINE_CHANNELS;

/// Places of a ring.
const SLOTS: usize = 64;
/// Characters that can wait.
pub const WORDS: usize = 2 * SLOTS;
const RING_BYTES: usize = 2 * SLOTS;
const EMPTY: u16 = 0xFFFF;

/// Aligned, because the DMA wraps an address by its low bits.
#[repr(C, align(128))]
struct Ring([AtomicU16; SLOTS]);

const _: () = assert!(align_of::<Ring>() == RING_BYTES && size_of::<Ring>() == RING_BYTES);

/// Atomic, because the DMA writes them while we read. Filled before it starts.
static RINGS: [Ring; 2] = [const { Ring([const { AtomicU16::new(0) }; SLOTS]) }; 2];
/// How many have been taken, modulo all places.
static TAKEN: AtomicUsize = AtomicUsize::new(0);

/// The channels' bits.
const OURS: u32 = 1 << LINE_CHANNELS[0] | 1 << LINE_CHANNELS[1];

/// Starts to take what this port brings. Once.
pub fn start(port: pac::uart::Uart) {
    for ring in &RINGS {
        for place in &ring.0 {
            place.store(EMPTY, Ordering::Relaxed);
        }
    }
    pac::DMA.inte(0).write_value(OURS);
    let [number, other] = LINE_CHANNELS;
    let first = pac::DMA.ch(const { LINE_CHANNELS[0] as usize });
    let second = pac::DMA.ch(const { LINE_CHANNELS[1] as usize });
    let [memory, others] = &RINGS;
    // The one that is started last waits for the first character.
    arm(second, port, others, number, false);
    arm(first, port, memory, other, true);
    port.uartdmacr().write(|w| w.set_rxdmae(true));
}

/// Sets a channel up for one character, behind which it starts the other.
fn arm(dma: Channel, port: pac::uart::Uart, memory: &'static Ring, next: u8, starts: bool) {
    dma.read_addr().write_value(port.uartdr().as_ptr() as u32);
    dma.write_addr().write_value(memory.0.as_ptr() as u32);
    #[cfg(not(feature = "rp2350"))]
    dma.trans_count().write_value(1);
    #[cfg(feature = "rp2350")]
    dma.trans_count().write(|w| w.set_count(1));
    let mut control = CtrlTrig(0);
    control.set_en(true);
    // The axes go first: a character has time.
    control.set_high_priority(false);
    // The character, and its errors above it.
    control.set_data_size(DataSize::SIZE_HALFWORD);
    control.set_incr_write(true);
    control.set_ring_sel(true);
    control.set_ring_size(RING_BYTES.trailing_zeros() as u8);
    control.set_chain_to(next);
    control.set_treq_sel(TreqSel::UART0_RX);
    match starts {
        true => dma.ctrl_trig().write_value(control),
        // This register does not trigger.
        false => dma.al1_ctrl().write_value(control.0),
    }
}

/// Takes all that has come, in its order, for the interrupt of the DMA. Returns whether places were
/// written over.
#[inline(always)]
pub fn take(mut word: impl FnMut(u16)) -> bool {
    // What comes from here on asks again.
    pac::DMA.ints(0).write_value(OURS);
    let mut taken = TAKEN.load(Ordering::Relaxed);
    let mut is_full = true;
    for _ in 0..WORDS {
        let ring = RINGS.get(taken % 2);
        let Some(place) = ring.and_then(|ring| ring.0.get(taken / 2 % SLOTS)) else {
            break;
        };
        let found = place.load(Ordering::Relaxed);
        if found == EMPTY {
            is_full = false;
            break;
        }
        place.store(EMPTY, Ordering::Relaxed);
        taken = taken.wrapping_add(1) % WORDS;
        word(found);
    }
    TAKEN.store(taken, Ordering::Relaxed);
    is_full
}
