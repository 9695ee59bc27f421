//! What the interpreter asks of the machine under it.
//!
//! Everything here is in machine coordinates, after work offsets, rotations and
//! tool length: the position is that of the point which the axes carry (the gauge
//! line; with a tool of length zero, its tip).

use nalgebra::Vector3;
use umi_core::units::{Point, Rad};

/// One motion from where the axes stand.
#[derive(Clone, Debug, PartialEq)]
pub struct AxisMotion {
    /// Where it ends.
    pub to: Point,
    /// The way there.
    pub path: MotionPath,
    /// How fast.
    pub rate: MotionRate,
}

/// The way of a motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MotionPath {
    /// A straight line.
    Line,
    /// A circular arc or a helix.
    Arc {
        /// A point of its axis: the centre, at the height of the start.
        center: Point,
        /// Direction of its axis, a unit vector.
        axis: Vector3<f64>,
        /// Angle passed, right-handed about the axis; may be more than a turn.
        /// Travel along the axis is in proportion to it.
        sweep: Rad,
    },
}

/// How fast a motion is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MotionRate {
    /// As fast as the axes can.
    Rapid,
    /// Along the path, mm/min.
    Feed(f64),
}

/// How a motion with skip (G31) ended. The axes stand where they came to rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Skip {
    /// Whether the signal came before the end of the motion.
    pub touched: bool,
    /// The position that the control stored; the end of the motion without a touch.
    pub stored: Point,
}

/// The machine stopped: what a control shows as an alarm.
#[derive(Clone, Debug, PartialEq)]
pub struct Trip {
    /// What happened and what to do, one sentence without the program's line.
    pub message: String,
}

/// The machine under an interpreter.
///
/// A motion is complete when the call returns (exact stop).
pub trait AxisDrives {
    /// Where the axes were last sent, or came to rest after a skip.
    fn position(&self) -> Point;

    /// Where the point that the axes carry truly is, which no one at the machine sees:
    /// [`Self::position`] with what homing, scales and warmth make of it. Axes without
    /// such errors are where they say.
    fn true_position(&self) -> Point {
        self.position()
    }

    /// The reference point of G28.
    fn reference_point(&self) -> Point;

    /// Moves.
    ///
    /// # Errors
    /// The machine stopped: over-travel, collision.
    fn travel(&mut self, motion: &AxisMotion) -> Result<(), Trip>;

    /// Angles of the rotary axes, in the order of
    /// [`ControlSettings::rotary_words`](crate::nc::ControlSettings::rotary_words), degrees.
    fn turned_deg(&self) -> Vec<f64> {
        Vec::new()
    }

    /// Moves on a straight line while the rotary axes turn to these angles, all together.
    /// `block_s`: how long it takes (G93); without, the rate is along the line, or in degrees a
    /// minute where the line has no length.
    ///
    /// # Errors
    /// The machine stopped, as in [`Self::travel`], or has no rotary axes.
    fn turn(
        &mut self,
        _motion: &AxisMotion,
        _to_deg: &[f64],
        _block_s: Option<f64>,
    ) -> Result<(), Trip> {
        Err(Trip {
            message: "this machine has no rotary axes".into(),
        })
    }

    /// Where X, Y, Z would stand with all rotary axes at 0 and the tip of a tool of this length at
    /// the same place of the table; [`Self::position`] without rotary axes.
    fn unturned(&self, _length_mm: f64) -> Vector3<f64> {
        self.position().mm
    }

    /// Moves the tip of a tool of this length on a line that is straight on the table, while the
    /// rotary axes turn to these angles (`G43.4`). The motion's end is as in [`Self::unturned`];
    /// the rest as in [`Self::turn`].
    ///
    /// # Errors
    /// As [`Self::turn`].
    fn carry(
        &mut self,
        _motion: &AxisMotion,
        _to_deg: &[f64],
        _length_mm: f64,
        _block_s: Option<f64>,
    ) -> Result<(), Trip> {
        Err(Trip {
            message: "this machine has no rotary axes".into(),
        })
    }

    /// Moves on a straight line until a skip signal comes or the motion ends.
    /// `leaving` is a motion that ends when contact is lost (LinuxCNC G38.4, G38.5).
    ///
    /// # Errors
    /// The machine stopped, as in [`Self::travel`].
    fn skip(&mut self, motion: &AxisMotion, leaving: bool) -> Result<Skip, Trip>;

    /// Stands still, seconds.
    fn dwell(&mut self, seconds: f64);

    /// Takes this tool into the spindle (M6); 0 none.
    ///
    /// # Errors
    /// The magazine does not have it.
    fn change_tool(&mut self, number: u32) -> Result<(), Trip>;

    /// An M code that the interpreter does not carry out itself (spindle, coolant,
    /// orientation), its number, with the S word in force.
    ///
    /// # Errors
    /// The machine refuses it, as turning the spindle with a probe in it.
    fn auxiliary(&mut self, m: u32, s: f64) -> Result<(), Trip>;

    /// Bytes leave at the control's serial port, as they stand on the wire.
    ///
    /// # Errors
    /// The line is broken.
    fn print(&mut self, bytes: &[u8]) -> Result<(), Trip>;

    /// A program of this number from an external device (`M198`), as its bytes came; none where
    /// there is no such device.
    ///
    /// # Errors
    /// The device does not answer.
    fn external_program(&mut self, _number: u32) -> Result<Option<Vec<u8>>, Trip> {
        Ok(None)
    }

    /// Whether the skip signal is on where the axes stand.
    fn skip_is_on(&self) -> bool {
        false
    }

    /// Waits until a digital input is on or off (LinuxCNC's `M66 P`), at most so long; without
    /// one to wait for, looks at it once. What it is then; none: it did not become so.
    ///
    /// # Errors
    /// This machine has no such inputs.
    fn await_input(
        &mut self,
        number: u16,
        _wanted: Option<bool>,
        _timeout_s: f64,
    ) -> Result<Option<bool>, Trip> {
        Err(Trip {
            message: format!("digital input {number} is not wired"),
        })
    }

    /// Interface input #1000 to #1035.
    fn input(&self, number: u16) -> bool;

    /// Interface output #1100 to #1135.
    fn output(&mut self, number: u16, on: bool);

    /// Time since the machine was switched on, seconds (#3001, #3002).
    fn seconds(&self) -> f64;
}
