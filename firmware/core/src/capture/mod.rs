//! Captures: values of counters, registers and sample rings become positions and instants.
//!
//! Hardware counts in few bits, remembers a few events and can be late to be
//! asked. This room computes what that means in 64 bits, once for all boards and
//! without a board: values of registers come in, positions and instants go out.
//!
//! | file | idea |
//! | --- | --- |
//! | [`unwrap`] | a counter of few bits to 64, without the race with its overflow |
//! | [`stamp`] | a count at an edge to an instant, an instant to nanoseconds |
//! | [`sample_ring`] | which sample of a ring belongs to an instant; whether one was lost |
//! | [`join_timers`] | which captures of several timers belong to one edge |
//!
//! # Design
//!
//! An *instant* ([`Cycles`](crate::units::Cycles)) counts the clock that the board latches
//! with, from its start; a *position* ([`Counts`](crate::units::Counts)) counts encoder steps. Both
//! last longer than any board: 2⁶³ cycles at 240 MHz are 1,200 years.
//!
//! What cannot be known has a name and is counted: a sample that is gone, an
//! edge that was missed, a pulse that came too fast. Nothing here panics,
//! allocates or loops without a bound.

pub mod direction;
pub mod join_timers;
pub mod sample_ring;
pub mod stamp;
pub mod unwrap;
