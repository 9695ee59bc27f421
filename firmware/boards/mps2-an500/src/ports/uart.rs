//! The CMSDK's UARTs: no FIFO, an interrupt for every byte.
//!
//! # Design
//!
//! To send, a byte is put into the holding register when that is free: one byte is on the
//! line then and one behind it, which is what the ten-character rule leaves room for.
//!
//! What comes in goes into a ring. A ring that is full does one of two things
//! ([`Full`]): what comes from a control is taken and counted as lost, since a control
//! must never be held, and the count takes the lost bytes' place in the stream; what
//! comes from a host stays in the UART, and holds it.
//!
//! # Limitations
//!
//! QEMU's lines are as fast as their reader: the divider is set and holds nothing up. The
//! tests' control keeps the pace of the job's line itself.

use core::cell::RefCell;
use core::future::poll_fn;
use core::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use core::task::Poll;

use critical_section::Mutex;
use embassy_sync::waitqueue::AtomicWaker;
use heapless::Deque;
use umi_app::board::CncInput;

use crate::chip::{CLOCK_HZ, Register};

/// Bytes that can wait: 44 ms at 115200 baud.
const RING: usize = 512;

/// Of all lines but the control's, whose job says it.
const BAUD: u32 = 115_200;

const HOLDING_IS_FULL: u32 = 1 << 0;
const RECEIVED: u32 = 1 << 1;
const OVERRUN: u32 = 1 << 3;
const TRANSMIT_INTERRUPT: u32 = 1 << 0;
const RECEIVE_INTERRUPT: u32 = 1 << 1;
/// Both directions, and their interrupts.
const ENABLE: u32 = 0b1111;

/// What a full ring does.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Full {
    /// Takes and counts what comes.
    Counts,
    /// Leaves it in the UART, which holds the sender.
    Holds,
}

/// A UART and its ring.
pub struct Uart {
    data: Register,
    state: Register,
    control: Register,
    interrupts: Register,
    divider: Register,
    full: Full,
    ring: Mutex<RefCell<Deque<u8, RING>>>,
    readable: AtomicWaker,
    /// Bytes lost behind what is in the ring; nothing goes into it meanwhile.
    lost: AtomicU32,
    /// All that ever came.
    received: AtomicU32,
    /// All that were ever lost.
    overruns: AtomicU32,
    /// A byte was left in the UART.
    left: AtomicBool,
    writable: AtomicWaker,
}

impl Uart {
    /// The UART at this address.
    pub const fn new(base: usize, full: Full) -> Self {
        Self {
            data: Register::new(base, 0x00),
            state: Register::new(base, 0x04),
            control: Register::new(base, 0x08),
            interrupts: Register::new(base, 0x0C),
            divider: Register::new(base, 0x10),
            full,
            ring: Mutex::new(RefCell::new(Deque::new())),
            readable: AtomicWaker::new(),
            lost: AtomicU32::new(0),
            received: AtomicU32::new(0),
            overruns: AtomicU32::new(0),
            left: AtomicBool::new(false),
            writable: AtomicWaker::new(),
        }
    }

    /// Starts it: 8 data bits, no parity, 1 stop bit, as the UART always has.
    pub fn start(&self) {
        self.set_baud(BAUD);
        self.control.write(ENABLE);
    }

    /// The speed of its line, both ways, 1 to 1.5 million.
    pub fn set_baud(&self, baud: u32) {
        self.divider.write(CLOCK_HZ / baud.max(1));
    }

    /// A byte has come, which the interrupt hands over.
    pub fn take(&self) -> u8 {
        self.interrupts.write(RECEIVE_INTERRUPT);
        // All eight bits above are zero.
        self.data.read() as u8
    }

    /// A byte has come: into the ring with it.
    pub fn on_receive(&self) {
        if self.state.read() & OVERRUN != 0 {
            self.state.write(OVERRUN);
            self.count(1);
        }
        if self.full == Full::Holds && self.with_ring(|ring| ring.is_full()) != Some(false) {
            self.interrupts.write(RECEIVE_INTERRUPT);
            self.left.store(true, Ordering::Relaxed);
            return;
        }
        let byte = self.take();
        self.received.fetch_add(1, Ordering::Relaxed);
        let push = |ring: &mut Deque<u8, RING>| ring.push_back(byte).is_ok();
        if self.lost.load(Ordering::Relaxed) > 0 || self.with_ring(push) != Some(true) {
            self.count(1);
        }
        self.readable.wake();
    }

    fn count(&self, lost: u32) {
        self.lost.fetch_add(lost, Ordering::Relaxed);
        self.overruns.fetch_add(lost, Ordering::Relaxed);
    }

    /// The holding register is free.
    pub fn on_writable(&self) {
        self.interrupts.write(TRANSMIT_INTERRUPT);
        self.writable.wake();
    }

    /// Waits for bytes, at least one, or for what was lost in their place.
    pub async fn read(&self, buffer: &mut [u8]) -> CncInput {
        poll_fn(|context| {
            self.readable.register(context.waker());
            // What is in the ring came before what was lost.
            let count = self.with_ring(|ring| take_front(ring, buffer));
            if let Some(count) = count.filter(|count| *count > 0) {
                self.fetch_what_was_left();
                return Poll::Ready(CncInput::Bytes(count));
            }
            match self.lost.swap(0, Ordering::Relaxed) {
                0 => Poll::Pending,
                lost => Poll::Ready(CncInput::Lost(lost)),
            }
        })
        .await
    }

    /// The ring, if nobody has it: nobody can, in a critical section.
    fn with_ring<R>(&self, work: impl FnOnce(&mut Deque<u8, RING>) -> R) -> Option<R> {
        critical_section::with(|section| {
            let mut ring = self.ring.borrow(section).try_borrow_mut().ok()?;
            Some(work(&mut ring))
        })
    }

    /// There is room now for the byte that was left in the UART.
    fn fetch_what_was_left(&self) {
        critical_section::with(|_| {
            if self.left.swap(false, Ordering::Relaxed) && self.state.read() & RECEIVED != 0 {
                self.on_receive();
            }
        });
    }

    /// Forgets what has come in.
    pub fn clear(&self) {
        self.with_ring(Deque::clear);
        self.fetch_what_was_left();
    }

    /// Bytes that ever came, lost or not.
    pub fn received(&self) -> u32 {
        self.received.load(Ordering::Relaxed)
    }

    /// Bytes that were ever lost.
    pub fn overruns(&self) -> u32 {
        self.overruns.load(Ordering::Relaxed)
    }

    /// Sends a byte, as soon as at most one is before it.
    pub async fn write(&self, byte: u8) {
        poll_fn(|context| {
            self.writable.register(context.waker());
            if self.state.read() & HOLDING_IS_FULL != 0 {
                return Poll::Pending;
            }
            self.data.write(u32::from(byte));
            Poll::Ready(())
        })
        .await;
    }

    /// Sends text and waits for it, at the start, when nothing else can run yet.
    pub fn print(&self, text: &str) {
        for byte in text.bytes() {
            // A line that does not move would hold the board.
            for _ in 0..CLOCK_HZ / 100 {
                if self.state.read() & HOLDING_IS_FULL == 0 {
                    break;
                }
            }
            self.data.write(u32::from(byte));
        }
    }
}

/// As many of the first bytes as there are, or as the buffer holds.
fn take_front(ring: &mut Deque<u8, RING>, buffer: &mut [u8]) -> usize {
    let mut taken = 0_usize;
    for place in buffer {
        let Some(byte) = ring.pop_front() else { break };
        *place = byte;
        taken = taken.saturating_add(1);
    }
    taken
}
