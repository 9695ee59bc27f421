//! The control's line by the application's driver, its output led back to its input inside the
//! chip: so nothing need be connected, and what the pins do is not tested.

use embassy_futures::join::join;
use embassy_futures::select::{Either, select};
use embassy_rp::pac;
use embassy_time::{Duration, Timer};
use umi_app::board::{CncInput, CncRx as _, CncTx as _};
use umi_protocol::serial::{Cts, LineSettings};

use crate::time::clock;
use crate::uart::{self, Receiver, Transmitter};

/// Characters of a test.
pub const CHARACTERS: u32 = 256;
/// From the place behind the line to the next one.
const TIMED: u32 = CHARACTERS - 1;
const BITS: u32 = 10;

/// What became of them.
pub struct Heard {
    /// Those that came as they were sent, in their order.
    pub right: u32,
    /// Those that the driver counts as lost.
    pub lost: u32,
    /// How far their time is off that of the speed, microseconds.
    pub off_us: u32,
}

const fn line(baud: u32) -> LineSettings {
    LineSettings {
        baud,
        cts: Cts::Ignored,
        ..LineSettings::DEFAULT
    }
}

/// Starts the port.
pub fn start() {
    uart::start(line(LineSettings::DEFAULT.baud));
}

/// Sends all characters at this speed, and hears them.
pub async fn run(baud: u32) -> Heard {
    Transmitter.set_line(line(baud)).await;
    let back = |on| pac::UART0.uartcr().modify(|w| w.set_lbe(on));
    back(true);
    let mut heard = Heard {
        right: 0,
        lost: 0,
        off_us: 0,
    };
    let promised_us = TIMED * BITS * 1_000_000 / baud;
    let send = async {
        let mut began_us = None;
        for byte in 0..CHARACTERS {
            if Transmitter.write(byte as u8).await.is_err() {
                break;
            }
            // The place behind the line is free: the character has begun.
            began_us.get_or_insert_with(clock::now_us);
        }
        clock::now_us().saturating_sub(began_us.unwrap_or(0))
    };
    let hear = async {
        let mut next = 0_u32;
        let mut buffer = [0; 64];
        // Thrice the time that they take: what does not come is no reason to wait for ever.
        let patience = Duration::from_micros(3 * u64::from(promised_us));
        let all = async {
            while next < CHARACTERS {
                match Receiver.read(&mut buffer).await {
                    CncInput::Bytes(count) => {
                        for byte in buffer.iter().take(count) {
                            heard.right += u32::from(*byte == next as u8);
                            next += 1;
                        }
                    }
                    CncInput::Lost(count) => heard.lost = heard.lost.saturating_add(count),
                    CncInput::End => break,
                }
            }
        };
        match select(all, Timer::after(patience)).await {
            Either::First(()) | Either::Second(()) => {}
        }
    };
    let (took_us, ()) = join(send, hear).await;
    back(false);
    heard.off_us = u32::try_from(took_us)
        .unwrap_or(u32::MAX)
        .abs_diff(promised_us);
    heard
}
