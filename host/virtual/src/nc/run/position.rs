//! Where the axes are, in which coordinates.

use nalgebra::Vector3;

use super::control::Control;
use crate::nc::memory::motion::AxisDrives;
use crate::nc::memory::transform::Frame;

impl Control {
    /// From the coordinates of the program to the machine's, without the tool's length.
    pub(crate) fn work_frame(&self) -> Frame {
        let modal = &self.modal;
        let origin = self.offsets.origin(modal.work) + modal.local;
        let mut frame = Frame::shift(modal.shift);
        let turn = self.offsets.turn(modal.work);
        if turn != 0.0 {
            frame = frame.inside(&Frame::about(Vector3::zeros(), Vector3::z_axis(), turn));
        }
        frame.inside(&Frame::shift(origin))
    }

    /// From the coordinates of the program to the machine's, all together.
    pub(crate) fn frame(&self) -> Frame {
        let mut frame = Frame::shift(Vector3::zeros());
        for rotation in self.modal.rotations.iter().rev() {
            frame = frame.inside(rotation);
        }
        if let Some(p) = self.modal.setting_error {
            frame = frame.inside(&Frame::setting_error(self.offsets.setting_error(p)));
        }
        frame
            .inside(&self.work_frame())
            .inside(&Frame::shift(self.length()))
    }

    /// Looks where the axes are.
    pub(crate) fn look(&mut self, axes: &dyn AxisDrives) {
        self.seen.position = axes.position();
        self.seen.carried = self.carried(axes);
    }

    /// Where the axes are for the program: of the machine, or as if the rotary ones were at 0.
    pub(crate) fn carried(&self, axes: &dyn AxisDrives) -> Vector3<f64> {
        if self.modal.carries_tip() {
            axes.unturned(self.modal.length_mm)
        } else {
            axes.position().mm
        }
    }

    /// The tool's length in force.
    pub(crate) fn length(&self) -> Vector3<f64> {
        Vector3::new(0.0, 0.0, self.modal.length_mm)
    }

    /// Where the axes are in the active work coordinate system, mm; with the tool's
    /// length in it (the gauge line) or not (the tip).
    pub(crate) fn work_position(&self, with_length: bool) -> Vector3<f64> {
        let mut at = self.seen.carried;
        if !with_length {
            at -= self.length();
        }
        self.work_frame().undo(at)
    }
}
