//! A machine with a workpiece in it.

use std::collections::BTreeMap;

use nalgebra::Vector3;
use umi_core::units::Point;

use super::{Removed, Wander, Workpiece, sweep};
use crate::nc::{AxisDrives, AxisMotion, MotionPath, MotionRate, Skip, Trip};

/// A ball-nose tool.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BallNose {
    /// From the gauge line to the tip, mm.
    pub length_mm: f64,
    /// Radius of the ball, mm.
    pub radius_mm: f64,
}

/// Why a contact with the material was none that cuts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CrashCause {
    /// The motion was a rapid one.
    Rapid,
    /// The spindle stood still.
    SpindleStill,
}

/// The tool ran into the material.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crash {
    /// Why it was no cut.
    pub cause: CrashCause,
    /// Where the motion came from, axes in machine coordinates.
    pub from: Point,
    /// Where it ended.
    pub to: Point,
    /// What it took away.
    pub removed: Removed,
}

/// What a tool takes away where it leaves the surface that it has just cut, mm: axes
/// that stand a few micrometres off are not yet a crash.
const GRAZE_MM: f64 = 0.02;

/// A machine whose ball-nose tools cut a workpiece.
///
/// Every call goes to the machine under it; what a tool sweeps is taken away, at
/// rapid too, which is also noted as a [`Crash`]. Tools that were not made known
/// here, as a probe, take nothing away. What a motion that the machine stopped has
/// cut is not known and not taken away.
///
/// The tool is where the axes truly are ([`AxisDrives::true_position`]) at start and end of
/// a motion; in between, what they are off passes evenly from one to the other.
#[derive(Debug)]
pub struct Cutter<A> {
    axes: A,
    workpiece: Workpiece,
    tools: BTreeMap<u32, BallNose>,
    tool: Option<BallNose>,
    spindle: bool,
    crashes: Vec<Crash>,
    wander: Option<Wander>,
    /// How far the axes are off where they stand, mm.
    off: Vector3<f64>,
}

impl<A> Cutter<A> {
    /// A machine with this workpiece clamped in it.
    pub fn new(axes: A, workpiece: Workpiece) -> Self {
        Self {
            axes,
            workpiece,
            tools: BTreeMap::new(),
            tool: None,
            spindle: false,
            crashes: Vec::new(),
            wander: None,
            off: Vector3::zeros(),
        }
    }

    /// Says what this tool of the magazine is.
    #[must_use]
    pub fn with_tool(mut self, number: u32, tool: BallNose) -> Self {
        self.tools.insert(number, tool);
        self
    }

    /// The axes do not quite stand where the machine says: what is cut shows it.
    #[must_use]
    pub fn with_wander(mut self, wander: Wander) -> Self {
        self.wander = Some(wander);
        self
    }

    /// The machine under it.
    pub fn axes(&self) -> &A {
        &self.axes
    }

    /// The machine under it.
    pub fn axes_mut(&mut self) -> &mut A {
        &mut self.axes
    }

    /// The workpiece.
    pub fn workpiece(&self) -> &Workpiece {
        &self.workpiece
    }

    /// The workpiece, to clamp it anew.
    pub fn workpiece_mut(&mut self) -> &mut Workpiece {
        &mut self.workpiece
    }

    /// Contacts that were no cuts, oldest first.
    pub fn crashes(&self) -> &[Crash] {
        &self.crashes
    }

    /// Takes the workpiece out; the machine and the crashes remain behind.
    pub fn into_parts(self) -> (A, Workpiece, Vec<Crash>) {
        (self.axes, self.workpiece, self.crashes)
    }
}

/// Where the axes stand.
#[derive(Clone, Copy)]
struct Stand {
    /// As the machine says.
    shown: Point,
    /// In truth.
    truly: Point,
}

impl Stand {
    fn off(&self) -> Vector3<f64> {
        self.truly.mm - self.shown.mm
    }
}

impl<A: AxisDrives> Cutter<A> {
    fn stand(&self) -> Stand {
        Stand {
            shown: self.axes.position(),
            truly: self.axes.true_position(),
        }
    }

    /// The tool has gone this way.
    fn sweep(&mut self, from: Stand, path: &MotionPath, rapid: bool) {
        let off = self.off + from.off();
        if let Some(wander) = &mut self.wander {
            self.off = wander.next();
        }
        let Some(tool) = self.tool else {
            return;
        };
        let end = self.stand();
        let (from, to) = (from.shown, end.shown);
        let more_off = self.off + end.off() - off;
        let from_gauge = Vector3::new(0.0, 0.0, tool.radius_mm - tool.length_mm);
        let mut start = from.mm + off + from_gauge;
        let mut removed: Option<Removed> = None;
        for (part, corner) in sweep::corners(from.mm, to.mm, path) {
            let end = corner + off + more_off * part + from_gauge;
            let piece = self.workpiece.sweep(start, end, tool.radius_mm);
            start = end;
            removed = match (removed, piece) {
                (Some(a), Some(b)) => Some(Removed {
                    nodes: a.nodes + b.nodes,
                    deepest_mm: a.deepest_mm.max(b.deepest_mm),
                }),
                (a, b) => a.or(b),
            };
        }
        let cause = if rapid {
            CrashCause::Rapid
        } else if self.spindle {
            return;
        } else {
            CrashCause::SpindleStill
        };
        if let Some(removed) = removed.filter(|removed| removed.deepest_mm > GRAZE_MM) {
            self.crashes.push(Crash {
                cause,
                from,
                to,
                removed,
            });
        }
    }
}

impl<A: AxisDrives> AxisDrives for Cutter<A> {
    fn position(&self) -> Point {
        self.axes.position()
    }

    fn true_position(&self) -> Point {
        self.axes.true_position()
    }

    fn reference_point(&self) -> Point {
        self.axes.reference_point()
    }

    fn travel(&mut self, motion: &AxisMotion) -> Result<(), Trip> {
        let from = self.stand();
        self.axes.travel(motion)?;
        self.sweep(from, &motion.path, motion.rate == MotionRate::Rapid);
        Ok(())
    }

    fn turned_deg(&self) -> Vec<f64> {
        self.axes.turned_deg()
    }

    fn unturned(&self, length_mm: f64) -> Vector3<f64> {
        self.axes.unturned(length_mm)
    }

    fn carry(
        &mut self,
        motion: &AxisMotion,
        to_deg: &[f64],
        _: f64,
        block_s: Option<f64>,
    ) -> Result<(), Trip> {
        self.turn(motion, to_deg, block_s)
    }

    fn turn(&mut self, _: &AxisMotion, _: &[f64], _: Option<f64>) -> Result<(), Trip> {
        Err(Trip {
            message: "a workpiece that is cut does not turn here: run the program on a scene without `cuttable`".into(),
        })
    }

    fn skip(&mut self, motion: &AxisMotion, leaving: bool) -> Result<Skip, Trip> {
        let from = self.stand();
        let skip = self.axes.skip(motion, leaving)?;
        self.sweep(from, &MotionPath::Line, false);
        Ok(skip)
    }

    fn dwell(&mut self, seconds: f64) {
        self.axes.dwell(seconds);
    }

    fn change_tool(&mut self, number: u32) -> Result<(), Trip> {
        self.axes.change_tool(number)?;
        self.spindle = false;
        self.tool = self.tools.get(&number).copied();
        Ok(())
    }

    fn auxiliary(&mut self, m: u32, s: f64) -> Result<(), Trip> {
        self.axes.auxiliary(m, s)?;
        match m {
            3 | 4 => self.spindle = s > 0.0,
            // M19 orients the spindle, M30 and M2 end the program and stop it.
            2 | 5 | 19 | 30 => self.spindle = false,
            _ => {}
        }
        Ok(())
    }

    fn print(&mut self, bytes: &[u8]) -> Result<(), Trip> {
        self.axes.print(bytes)
    }

    fn external_program(&mut self, number: u32) -> Result<Option<Vec<u8>>, Trip> {
        self.axes.external_program(number)
    }

    fn input(&self, number: u16) -> bool {
        self.axes.input(number)
    }

    fn output(&mut self, number: u16, on: bool) {
        self.axes.output(number, on);
    }

    fn seconds(&self) -> f64 {
        self.axes.seconds()
    }
}
