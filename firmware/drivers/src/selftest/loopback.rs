//! The control's line by the application's driver, its output led back to its input inside the
//! chip: so nothing need be connected, and what the pins do is not tested.

use embassy_futures::join::join;
use embassy_futures::select::{Either, select};
use umi_app::board::{Broken, Clock, CncInput, CncRx, CncTx, LinkTx};
use umi_core::units::Micros;
use umi_protocol::serial::{Cts, LineSettings};

use super::table::Table;

/// Characters of a test.
pub const CHARACTERS: u32 = 256;
/// The speeds of a test, baud.
pub const FAST_BAUD: u32 = 115_200;
/// The slower one.
pub const SLOW_BAUD: u32 = 19_200;
/// From the place behind the line to the next one.
const TIMED: u32 = CHARACTERS - 1;
const BITS: u32 = 10;

/// What became of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Heard {
    /// Those that came as they were sent, in their order.
    pub right: u32,
    /// Those that the driver counts as lost.
    pub lost: u32,
    /// How far their time is off that of the speed, microseconds.
    pub off_us: u32,
}

/// A line that listens to nobody.
#[must_use]
pub const fn line(baud: u32) -> LineSettings {
    LineSettings {
        baud,
        cts: Cts::Ignored,
        ..LineSettings::DEFAULT
    }
}

/// How long the characters take at a speed, microseconds: from the first to the last one's begin.
const fn time_us(baud: u32) -> u32 {
    TIMED * BITS * 1_000_000 / baud
}

/// Half a percent of that, the most that a speed may be off.
const fn most_off_us(baud: u32) -> i64 {
    time_us(baud) as i64 / 200
}

/// Tells what became of the characters at both speeds.
///
/// # Errors
/// The link is broken.
pub async fn tell<L: LinkTx>(
    fast: Heard,
    slow: Heard,
    table: &mut Table<'_, L>,
) -> Result<(), Broken> {
    let right = fast.right.min(slow.right).into();
    table
        .exactly("characters that come back", CHARACTERS.into(), right, "")
        .await?;
    let lost = i64::from(fast.lost) + i64::from(slow.lost);
    table.exactly("characters lost", 0, lost, "").await?;
    for (name, baud, heard) in [
        ("their time at 115200 baud", FAST_BAUD, fast),
        ("their time at 19200 baud", SLOW_BAUD, slow),
    ] {
        table
            .at_most(name, most_off_us(baud), heard.off_us.into(), "us off")
            .await?;
    }
    Ok(())
}

/// Sends all characters at this speed, and hears them.
pub async fn run(
    receiver: &mut impl CncRx,
    transmitter: &mut impl CncTx,
    clock: &impl Clock,
    baud: u32,
) -> Heard {
    let mut heard = Heard {
        right: 0,
        lost: 0,
        off_us: 0,
    };
    let now_us = || clock.now().0;
    let send = async {
        let mut began_us = None;
        for byte in 0..CHARACTERS {
            if transmitter.write(byte as u8).await.is_err() {
                break;
            }
            // The place behind the line is free: the character has begun.
            began_us.get_or_insert_with(now_us);
        }
        now_us().saturating_sub(began_us.unwrap_or(0))
    };
    // Thrice the time that they take: what does not come is no reason to wait for ever.
    let patience_us = now_us().saturating_add(3 * u64::from(time_us(baud)));
    let hear = async {
        let mut next = 0_u32;
        let mut buffer = [0; 64];
        let all = async {
            while next < CHARACTERS {
                match receiver.read(&mut buffer).await {
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
        match select(all, clock.wait_until(Micros(patience_us))).await {
            Either::First(()) | Either::Second(()) => {}
        }
    };
    let (took_us, ()) = join(send, hear).await;
    heard.off_us = u32::try_from(took_us)
        .unwrap_or(u32::MAX)
        .abs_diff(time_us(baud));
    heard
}
