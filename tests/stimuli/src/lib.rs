//! What a test bench tells a board that runs in QEMU, and what it is told: QEMU's machine
//! has no encoders, inputs and outputs, so a UART carries them.
//!
//! ```text
//! bench ─► Stimulus, Stimulus, … ─► board
//!       ◄─ BenchState ◄───────────
//! ```
//!
//! # Design
//!
//! The bench lays a path of the axes ahead of the board's clock, and then edges at
//! instants on it: so an edge has one right answer, whenever the board comes to it. The
//! board tells its state whenever that has changed. Stimuli are numbered by counting
//! them: the state says how many were taken in, so a bench that waits for its own number
//! knows that everything before is done.
//!
//! Both are postcard in COBS, a zero behind each. There is no check value: a socket does
//! not damage bytes.
#![no_std]

use heapless::Vec;
use serde::{Deserialize, Serialize, de::DeserializeOwned};
use umi_protocol::latch::{LatchCause, MAX_AXES};
use umi_protocol::message::ResetReason;

pub use postcard::accumulator::{CobsAccumulator, FeedResult};

/// Bytes of an encoded frame with the zero behind it, at most.
pub const MAX_FRAME: usize = 96;

/// Frames as they come in.
pub type StimulusDecoder = CobsAccumulator<MAX_FRAME>;

/// What a bench does to a board.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Stimulus {
    /// Nothing: the answer tells the state.
    Look,
    /// Nothing, but the state is told once more when this time has come.
    Wait {
        /// The board's clock then.
        until_ns: u64,
    },
    /// The axes stand, then move evenly, then stand. Paths follow each other in time.
    Path {
        /// The board's clock when they begin to move.
        from_ns: u64,
        /// The board's clock when they have come.
        to_ns: u64,
        /// Encoder counts where they have come to. Axes that are not named stay.
        counts: Vec<i64, MAX_AXES>,
    },
    /// An edge at an input.
    Edge {
        /// Which.
        cause: LatchCause,
        /// The board's clock at the edge.
        t_ns: u64,
    },
    /// The host's cable is plugged in, or pulled out. It is in when the board starts.
    Host {
        /// Plugged in.
        connected: bool,
    },
    /// The control lets the board send by its CTS line.
    Clear {
        /// So many characters and no more; none: as many as come.
        characters: Option<u32>,
    },
    /// The firmware panics.
    Panic,
    /// Measuring never answers again.
    Hang,
    /// The firmware's stack overflows.
    Overflow,
}

/// How a board stands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct BenchState {
    /// Stimuli taken in since the start.
    pub taken: u32,
    /// Frames that were none, and stimuli that could not be.
    pub refused: u32,
    /// The board's clock.
    pub t_ns: u64,
    /// Why the board started.
    pub reset: ResetReason,
    /// The outputs to the machine.
    pub busy: bool,
    /// The latest verdict is OK.
    pub ok: bool,
    /// The latest verdict is NG.
    pub ng: bool,
    /// The storage refuses.
    pub trouble: bool,
    /// A scanner's laser is enabled.
    pub laser: bool,
    /// Bytes that have come from the control.
    pub from_control: u32,
    /// Those of them that found no room and are lost.
    pub overruns: u32,
    /// The outputs of a distance sensor's station: skip line, number of the answered line odd,
    /// carried out, no signal.
    pub sensor: [bool; 4],
    /// When it triggers the sensor.
    pub triggers: SensorTriggers,
}

/// When a board triggers its distance sensor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum SensorTriggers {
    /// Never.
    #[default]
    Off,
    /// At a time interval.
    Every {
        /// From pulse to pulse.
        interval_us: u32,
    },
    /// Where an axis crosses lines.
    Lines {
        /// Which axis.
        axis: u8,
        /// A line.
        origin_counts: i64,
        /// From line to line.
        interval_counts: u32,
    },
}

/// Puts a message into a frame.
///
/// # Errors
/// It is longer than [`MAX_FRAME`].
pub fn encode<'b>(
    message: &impl Serialize,
    into: &'b mut [u8; MAX_FRAME],
) -> Result<&'b [u8], postcard::Error> {
    Ok(postcard::to_slice_cobs(message, into)?)
}

/// Takes bytes in and hands over what they complete; returns how many frames were none.
pub fn decode<M: DeserializeOwned>(
    decoder: &mut StimulusDecoder,
    mut bytes: &[u8],
    mut take: impl FnMut(M),
) -> u32 {
    let mut damaged = 0;
    while !bytes.is_empty() {
        bytes = match decoder.feed(bytes) {
            FeedResult::Consumed => &[],
            FeedResult::OverFull(rest) | FeedResult::DeserError(rest) => {
                damaged += 1;
                rest
            }
            FeedResult::Success { data, remaining } => {
                take(data);
                remaining
            }
        };
    }
    damaged
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The longest messages find room, and come out as they went in, whatever stands
    /// between them.
    #[test]
    fn longest_messages_pass() {
        let mut decoder = StimulusDecoder::new();
        let mut buffer = [0; MAX_FRAME];
        let path = Stimulus::Path {
            from_ns: u64::MAX,
            to_ns: u64::MAX,
            counts: [i64::MIN; MAX_AXES].into_iter().collect(),
        };
        let mut came = heapless::Vec::<Stimulus, 4>::new();
        let damaged = decode(&mut decoder, &[0x55, 0x10, 0], |stimulus| {
            let _ = came.push(stimulus);
        });
        assert_eq!(damaged, 1);
        let frame = encode(&path, &mut buffer).unwrap();
        let damaged = decode(&mut decoder, frame, |stimulus| {
            let _ = came.push(stimulus);
        });
        assert_eq!((damaged, came.as_slice()), (0, &[path][..]));

        let state = BenchState {
            taken: u32::MAX,
            refused: u32::MAX,
            t_ns: u64::MAX,
            reset: ResetReason::Panic,
            from_control: u32::MAX,
            overruns: u32::MAX,
            ..BenchState::default()
        };
        let mut told = None;
        let frame = encode(&state, &mut buffer).unwrap();
        decode(&mut StimulusDecoder::new(), frame, |state: BenchState| {
            told = Some(state)
        });
        assert_eq!(told, Some(state));
    }
}
