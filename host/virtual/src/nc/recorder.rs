//! A machine on paper: it records a program's motions.

use umi_core::units::Point;

use crate::nc::memory::motion::{AxisDrives, AxisMotion, Skip, Trip};

/// Axes that go wherever they are sent, at once, and keep how. Nothing is ever touched, and
/// nothing that is not a motion matters.
#[derive(Clone, Debug)]
pub struct Recorder {
    /// Where they stand.
    pub at: Point,
    /// Where G28 goes.
    pub reference_point: Point,
    /// Where each motion began, and the motion.
    pub motions: Vec<(Point, AxisMotion)>,
}

impl Recorder {
    /// Axes that stand here.
    #[must_use]
    pub const fn new(at: Point, reference_point: Point) -> Self {
        Self {
            at,
            reference_point,
            motions: Vec::new(),
        }
    }
}

impl AxisDrives for Recorder {
    fn position(&self) -> Point {
        self.at
    }
    fn reference_point(&self) -> Point {
        self.reference_point
    }
    fn travel(&mut self, motion: &AxisMotion) -> Result<(), Trip> {
        self.motions.push((self.at, motion.clone()));
        self.at = motion.to;
        Ok(())
    }
    fn skip(&mut self, motion: &AxisMotion, _: bool) -> Result<Skip, Trip> {
        self.travel(motion)?;
        Ok(Skip {
            touched: false,
            stored: motion.to,
        })
    }
    fn dwell(&mut self, _: f64) {}
    fn change_tool(&mut self, _: u32) -> Result<(), Trip> {
        Ok(())
    }
    fn auxiliary(&mut self, _: u32, _: f64) -> Result<(), Trip> {
        Ok(())
    }
    fn print(&mut self, _: &[u8]) -> Result<(), Trip> {
        Ok(())
    }
    fn input(&self, _: u16) -> bool {
        false
    }
    fn output(&mut self, _: u16, _: bool) {}
    fn seconds(&self) -> f64 {
        0.0
    }
}
