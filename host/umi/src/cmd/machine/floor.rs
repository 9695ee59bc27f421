//! The machine as `umi machine run` needs it: with a workpiece in it, or without.

use umi::wiring::Wiring;
use umi_virtual::cutting::{Crash, Cutter, Workpiece};
use umi_virtual::machine::Machine;
use umi_virtual::nc::Axes;

/// A machine on the shop floor.
pub trait Floor: Axes {
    /// The machine itself.
    fn machine(&mut self) -> &mut Machine<Wiring>;

    /// Where a tool took material away without cutting, if one did.
    fn crash(&self) -> Option<&Crash>;

    /// What is being cut.
    fn workpiece(&self) -> Option<&Workpiece>;
}

impl Floor for Machine<Wiring> {
    fn machine(&mut self) -> &mut Machine<Wiring> {
        self
    }

    fn crash(&self) -> Option<&Crash> {
        None
    }

    fn workpiece(&self) -> Option<&Workpiece> {
        None
    }
}

impl Floor for Cutter<Machine<Wiring>> {
    fn machine(&mut self) -> &mut Machine<Wiring> {
        self.axes_mut()
    }

    fn crash(&self) -> Option<&Crash> {
        self.crashes().first()
    }

    fn workpiece(&self) -> Option<&Workpiece> {
        Some(Self::workpiece(self))
    }
}
