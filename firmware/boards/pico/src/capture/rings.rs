//! Rings of samples in memory, written by DMA.
//!
//! # Design
//!
//! Each ring has two DMA channels that take turns: when one has made its transfers, it
//! starts the other by itself. Both wrap their addresses at the ring's end and make a
//! multiple of a ring's transfers, so that the slot of a sample depends on its number
//! alone, and the one that waits always stands at the ring's beginning.
//!
//! # Limitations
//!
//! At 125 MHz the four rings take 50 million transfers per second, less than half of what
//! the DMA can do. A machine whose FIFO runs full tells it: see [`crate::capture::pio::stalled`].

use core::sync::atomic::{AtomicU32, Ordering};

use embassy_rp::pac;
use embassy_rp::pac::dma::regs::CtrlTrig;
use embassy_rp::pac::dma::vals::{DataSize, TreqSel};

use crate::resources::{RINGS, SLOTS, TRANSFERS};

const RING_BYTES: usize = SLOTS * 4;
/// Channels of the DMA. Numbers of channels are taken modulo this, so that no interrupt has a way
/// to a panic.
const CHANNELS: usize = RINGS * 2;

/// Aligned, because the DMA wraps an address by its low bits.
#[repr(C, align(4096))]
struct Ring([AtomicU32; SLOTS]);

const _: () = assert!(align_of::<Ring>() == RING_BYTES && size_of::<Ring>() == RING_BYTES);

/// Atomic, because the DMA writes them while we read. Not zeroed with the other variables (link/ram-code.x)
/// but by [`clear`].
static MEMORY: [Ring; RINGS] = [const { Ring([const { AtomicU32::new(0) }; SLOTS]) }; RINGS];

/// What stands in a slot of a ring; 0 if there is no such slot.
#[inline(always)]
pub fn read(ring: usize, slot: u32) -> u32 {
    let word = MEMORY
        .get(ring)
        .and_then(|ring| ring.0.get(slot as usize % SLOTS));
    word.map_or(0, |word| word.load(Ordering::Relaxed))
}

/// The slot that is written next.
#[inline(always)]
pub fn write_slot(ring: usize) -> u32 {
    // The one that does not run stands at the beginning, where the other arrives when
    // it hands over: it does not matter when exactly that is.
    let ring = ring % RINGS;
    let first = pac::DMA.ch(ring * 2);
    let address = if first.ctrl_trig().read().busy() {
        first.write_addr().read()
    } else {
        pac::DMA.ch(ring * 2 + 1).write_addr().read()
    };
    address % RING_BYTES as u32 / 4
}

/// Turns of waiting for transfers on their way: a few are needed.
const ABORT_TURNS: u32 = 1000;

/// Stops all transfers. An abort may start the channel again, or the one that it is chained to
/// (RP2350 erratum E5): so each is switched off and chained to itself, which is to none, before.
/// And an abort may read as done while a transfer is still on its way (RP2040 E13): so it is
/// waited for until no channel is busy.
pub fn abort() {
    let channels = 0..RINGS * 2;
    for channel in channels.clone() {
        let dma = pac::DMA.ch(channel % CHANNELS);
        let mut control = dma.ctrl_trig().read();
        control.set_en(false);
        control.set_chain_to(channel as u8);
        // This register does not trigger.
        dma.al1_ctrl().write_value(control.0);
    }
    let all = (1_u16 << (RINGS * 2)) - 1;
    pac::DMA.chan_abort().write(|w| w.set_chan_abort(all));
    for _ in 0..ABORT_TURNS {
        let is_over = pac::DMA.chan_abort().read().chan_abort() == 0;
        let is_busy = |channel: usize| pac::DMA.ch(channel % CHANNELS).ctrl_trig().read().busy();
        if is_over && !channels.clone().any(is_busy) {
            break;
        }
    }
}

/// Zeroes the rings, once, before the first start: a start anew has no time for it.
pub fn clear() {
    for slot in MEMORY.iter().flat_map(|ring| &ring.0) {
        slot.store(0, Ordering::Relaxed);
    }
}

/// Sets the channels up for a start at slot 0, when all are stopped. They wait for the
/// first word of their machine.
pub fn arm() {
    for (ring, memory) in MEMORY.iter().enumerate() {
        let ring = ring % RINGS;
        for (channel, partner) in [(ring * 2 + 1, ring * 2), (ring * 2, ring * 2 + 1)] {
            let dma = pac::DMA.ch(channel % CHANNELS);
            dma.read_addr()
                .write_value(pac::PIO0.rxf(ring).as_ptr() as u32);
            dma.write_addr().write_value(memory.0.as_ptr() as u32);
            #[cfg(not(feature = "rp2350"))]
            dma.trans_count().write_value(TRANSFERS);
            #[cfg(feature = "rp2350")]
            dma.trans_count().write(|w| w.set_count(TRANSFERS));
            let mut control = CtrlTrig(0);
            control.set_en(true);
            control.set_high_priority(true);
            control.set_data_size(DataSize::SIZE_WORD);
            control.set_incr_write(true);
            control.set_ring_sel(true);
            control.set_ring_size(RING_BYTES.trailing_zeros() as u8);
            control.set_chain_to(partner as u8);
            control.set_treq_sel(request_of(ring));
            control.set_irq_quiet(true);
            if channel == ring * 2 {
                dma.ctrl_trig().write_value(control);
            } else {
                dma.al1_ctrl().write_value(control.0);
            }
        }
    }
}

fn request_of(ring: usize) -> TreqSel {
    const PIO0_RX0: u8 = TreqSel::PIO0_RX0 as u8;
    TreqSel::from_bits(PIO0_RX0 + ring as u8)
}
