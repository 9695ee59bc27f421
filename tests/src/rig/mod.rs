//! A board under test, whichever it is: what the conformance suite needs of it.

mod virtual_board;

use std::time::Duration;

use umi::link::Transport;
use umi_app::board::Lights;

pub use virtual_board::VirtualRig;

/// A board with all that stands around it on a machine: the control, a host, encoders,
/// a probe, a scanner, and the power switch.
pub trait Rig {
    /// The kind of board, as it calls itself.
    fn name(&self) -> &'static str;

    /// How much longer things take than on a real board: a test that waits a second of
    /// the board's time waits this many seconds, at most.
    fn slowness(&self) -> u32;

    /// Plugs the host's cable in. What was plugged in before is not any more.
    fn connect(&mut self) -> Box<dyn Transport>;

    /// Pulls the host's cable out.
    fn unplug(&mut self);

    /// The control sends bytes, as fast as its line takes them.
    fn control_sends(&mut self, bytes: &[u8]);

    /// The next byte for the control; none if there is none in this time.
    fn control_receives(&mut self, patience: Duration) -> Option<u8>;

    /// Moves the axes until their encoders have counted to here, faster than any
    /// machine but no faster than the board promises to follow.
    fn move_to(&mut self, counts: &[i64]);

    /// The probe's skip line rises and falls while the axes stand.
    fn skip(&mut self);

    /// The scanner's trigger line rises and falls while the axes stand.
    fn trigger(&mut self);

    /// What the outputs show.
    fn lights(&mut self) -> Lights;

    /// Whether the board enables a scanner's laser.
    fn laser_is_on(&mut self) -> bool;

    /// Takes the power away and gives it back. What is in flash stays.
    fn power_cycle(&mut self);
}
