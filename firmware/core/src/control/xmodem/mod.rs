//! XMODEM with check sum, as Haas controls speak it, in both directions.
//!
//! ```text
//! control          board (sender)        control            board (receiver)
//!    NAK  ───────►                          ◄───────  NAK, every 10 s
//!         ◄───────  block 1              block 1  ───────►
//!    ACK  ───────►                          ◄───────  ACK
//!         ◄───────  block 2              block 2  ───────►
//!    NAK  ───────►                          ◄───────  NAK, when the line is quiet
//!         ◄───────  block 2              block 2  ───────►
//!    ACK  ───────►                          ◄───────  ACK
//!         ◄───────  EOT                      EOT  ───────►
//!    ACK  ───────►                          ◄───────  ACK
//!
//! block: SOH, number, 255 - number, 128 bytes, sum of these modulo 256
//! ```
//!
//! # Design
//!
//! * **State machines without a line.** [`BlockSender`](sender::BlockSender) and
//!   [`BlockReceiver`](receiver::BlockReceiver) say what is to be done next, and are told what was
//!   done and what came. One task writes, reads and waits for them.
//! * **Times and counts are Christensen's** (Ward Christensen, "Modem protocol
//!   documentation", 1982, revised 1985): ten repeats of anything; a receiver asks again
//!   after 10 s; within a block the next byte comes within 1 s; a damaged block is
//!   refused when the line has been quiet for 1 s. He advises to leave repeats to the
//!   receiver, and the Haas manual calls the mode "receiver-driven": so the sender waits
//!   longer than a receiver that asks again ([`ANSWER_US`]).
//! * **An answer is what comes after the last byte of a block.** What comes before was
//!   meant for something else, and is dropped: several NAKs of a control that has waited
//!   are one. A sender that answered each sent its first block twice, and had the next one
//!   refused (capture of 2017-10-30, OpenDNC project, Haas mill with classic control). For
//!   the same reason a short pause ([`SETTLE_US`]) follows the first NAK, and each block
//!   that was repeated.
//! * **Two CAN in a row cancel**, one is noise. That Haas answered the EOT of a program of
//!   which it had acknowledged every block by three CAN: this is told as an end of its own.
//! * **Nothing is an end that may be the beginning of something.** A block counts when the
//!   line is quiet behind it ([`GUARD_US`]), so one with a byte too many never does; EOT
//!   counts when nothing follows for as long as a byte of a block may take, or a second
//!   EOT: a block whose SOH was damaged into an EOT does not end a program.
//! * **The last block is held back** by the receiver until the next begins or all ends: only
//!   then is it known whose trailing SUBs are padding.
//! * Acknowledging waits for who takes the data: a slow flash holds the control.
//!
//! # What becomes of half a program
//!
//! EOT is sent only when every block was acknowledged; who gives up sends CAN. What the
//! control then does with the blocks that it has is its own affair: the protocol leaves it
//! open, and no capture shows it. Haas' manual (96-8000, June 1999) says that the display
//! shows `RS232 ABORT`, and that data is loaded although an alarm was raised: **it must be
//! expected that the beginning of the program stays.** It lacks what the last block carries,
//! the closing `%` at least. Who needs more than that sends a program whose first line jumps to
//! its last (`GOTO`): cut anywhere, it raises an alarm before it moves.
//!
//! # Limitations
//!
//! * All eight bits are needed, and no character of flow control: the line is 8N, with XON
//!   and XOFF neither obeyed nor sent while this runs. 0x11 and 0x13 are block numbers, too.
//! * The check sum sees any damage of one byte, and a byte too few or too many. Of blocks that
//!   are damaged otherwise one in 256 passes, and swapped bytes always.
//! * An EOT that noise makes between two blocks ends a program early: who takes it looks
//!   whether it ends as programs do, and refuses it otherwise.
//! * A program whose own last byte is SUB comes without it.
//! * Haas: setting 25 (EOB pattern) at `LF ONLY`; the control works out the check sum with LF
//!   whatever it sends (OpenDNC).

pub mod receiver;
pub mod sender;
#[cfg(test)]
mod tests;

use crate::units::Micros;

/// Bytes of a program in one block.
pub const BLOCK: usize = 128;
/// What stands before them: SOH and the number twice.
const HEAD: usize = 3;
/// A block as it stands on the line.
pub const FRAME: usize = HEAD + BLOCK + 1;
/// How often anything is repeated before it is given up.
pub const REPEATS: u8 = 10;

/// A receiver asks again when nothing came for so long.
pub const ASK_US: u64 = 10_000_000;
/// Within a block the next byte comes within this, and before a NAK the line is quiet for as long.
pub const BYTE_US: u64 = 1_000_000;
/// A line that is not quiet by then is asked again all the same.
pub const PURGE_US: u64 = 10_000_000;
/// A block is over when nothing came for so long and for as long as [`GUARD_CHARACTERS`] take:
/// longer than a driver waits for more of what it hands on at once.
pub const GUARD_US: u64 = 5_000;
/// Characters of the line's speed.
pub const GUARD_CHARACTERS: u64 = 4;
/// A sender waits so long to be asked for the first block.
pub const START_US: u64 = 60_000_000;
/// A sender repeats what was not answered for so long: a receiver that asks again comes before.
pub const ANSWER_US: u64 = 15_000_000;
/// Between the first NAK and the first block, and behind a block that was repeated.
pub const SETTLE_US: u64 = 500_000;

const SOH: u8 = 0x01;
const EOT: u8 = 0x04;
/// Acknowledged.
pub const ACK: u8 = 0x06;
/// Not acknowledged: what a receiver begins with.
pub const NAK: u8 = 0x15;
/// Cancelled.
pub const CAN: u8 = 0x18;
const SUB: u8 = 0x1A;

/// Says that it is over. Two are needed, and one may be lost.
const CANCEL: [u8; 3] = [CAN; 3];

const fn after(now: Micros, span_us: u64) -> Micros {
    Micros(now.0.saturating_add(span_us))
}

fn sum(data: &[u8]) -> u8 {
    data.iter().fold(0, |sum, byte| sum.wrapping_add(*byte))
}

/// CANs that came one behind the other.
#[derive(Clone, Copy, Debug, Default)]
struct Cancels(u8);

impl Cancels {
    const fn note(&mut self, byte: u8) {
        self.0 = if byte == CAN {
            self.0.saturating_add(1)
        } else {
            0
        };
    }

    const fn enough(self) -> bool {
        self.0 >= 2
    }
}
