//! From what counters, captures and sample rings hold to positions and instants.
//!
//! Hardware counts in few bits, remembers a few events and can be late to be
//! asked. What that means in 64 bits is computed here, once for all boards, and
//! without a board: values of registers come in, positions and instants go out.
//!
//! | file | idea |
//! | --- | --- |
//! | [`extend`] | a counter of few bits to 64, without the race with its overflow |
//! | [`stamp`] | a count at an edge to an instant, an instant to nanoseconds |
//! | [`samples`] | which sample of a ring belongs to an instant; whether one was lost |
//! | [`pair`] | which captures of several timers belong to one edge |
//! | [`interval`] | when the next trigger pulse is due, along an axis or in time |
//!
//! # Design
//!
//! An *instant* is a `u64` count of cycles of the clock that the board latches
//! with, from its start; a *position* is an `i64` count of encoder steps. Both
//! last longer than any board: 2⁶³ cycles at 240 MHz are 1,200 years.
//!
//! What cannot be known has a name and is counted: a sample that is gone, an
//! edge that was missed, a pulse that came too fast. Nothing here panics,
//! allocates or loops without a bound.

pub mod extend;
pub mod interval;
pub mod pair;
pub mod samples;
pub mod stamp;
