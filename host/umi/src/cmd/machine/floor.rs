//! The machine as `umi machine run` needs it: with a workpiece in it, or without.

use umi_desk::wiring::Wiring;
use umi_virtual::cutting::{Crash, Cutter, Workpiece};
use umi_virtual::machine::VirtualMachine;
use umi_virtual::nc::AxisDrives;

/// A machine on the shop floor.
pub(crate) trait Floor: AxisDrives {
    /// The machine itself.
    fn machine(&mut self) -> &mut VirtualMachine<Wiring>;

    /// Where a tool took material away without cutting, if one did.
    fn crash(&self) -> Option<&Crash>;

    /// What is being cut.
    fn workpiece(&self) -> Option<&Workpiece>;
}

impl Floor for VirtualMachine<Wiring> {
    fn machine(&mut self) -> &mut VirtualMachine<Wiring> {
        self
    }

    fn crash(&self) -> Option<&Crash> {
        None
    }

    fn workpiece(&self) -> Option<&Workpiece> {
        None
    }
}

impl Floor for Cutter<VirtualMachine<Wiring>> {
    fn machine(&mut self) -> &mut VirtualMachine<Wiring> {
        self.axes_mut()
    }

    fn crash(&self) -> Option<&Crash> {
        self.crashes().first()
    }

    fn workpiece(&self) -> Option<&Workpiece> {
        Some(Self::workpiece(self))
    }
}
