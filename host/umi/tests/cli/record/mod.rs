//! What a board has kept: events, journal, proof.

mod events;
mod replays;
mod trust;
