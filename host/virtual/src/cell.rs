//! A control and its machine: programs in, motions and text out.

use crate::machine::{Machine, Wires};
use crate::nc::{Alarm, Axes, Control, State, Step, WorkOffset};
use crate::scene::Scene;

/// A control in front of its machine.
#[derive(Debug)]
pub struct Cell<M> {
    /// The control.
    pub control: Control,
    /// The machine, or what stands between it and the control.
    pub machine: M,
}

impl<W: Wires> Cell<Machine<W>> {
    /// Switches both on, with the scene's parameters, offsets and tools.
    pub fn new(scene: Scene, seed: u64, wires: W) -> Self {
        Self {
            control: control(&scene),
            machine: Machine::new(scene, seed, wires),
        }
    }
}

impl<M: Axes> Cell<M> {
    /// Loads a text and runs its first program to its end; `seen` is told of every
    /// block. Stops (M0, M1, `#3006`) go on by themselves once `seen` has seen them.
    ///
    /// # Errors
    /// The alarm at which it stopped, or what `seen` returns.
    pub fn run<E: From<Alarm>>(
        &mut self,
        program: &str,
        mut seen: impl FnMut(&mut Self, &Step) -> Result<(), E>,
    ) -> Result<(), E> {
        if let Some(first) = self.control.load(program)?.first() {
            self.control.select(*first)?;
        }
        loop {
            let step = self.control.step(&mut self.machine)?;
            seen(self, &step)?;
            if step.state == State::Ended {
                return Ok(());
            }
        }
    }
}

/// A control with a scene's parameters, offsets and tools.
#[must_use]
pub fn control(scene: &Scene) -> Control {
    let mut control = Control::new(scene.control.nc.clone());
    for (offset, origin_mm) in &scene.offsets_mm {
        control.set_offset(*offset, *origin_mm);
    }
    for (number, tool) in &scene.tools {
        let offsets = control.offsets_mut();
        offsets.set_length(*number, tool.length_mm);
        offsets.set_radius(*number, tool.radius_mm);
    }
    control
        .offsets_mut()
        .set_length(scene.probe.tool, scene.probe.length_mm);
    control
}

/// A work offset by the name that a program calls it: `G54` to `G59`, `G54.1P7`, `EXT`.
#[must_use]
pub fn work_offset(name: &str) -> Option<WorkOffset> {
    if name == "EXT" {
        return Some(WorkOffset::External);
    }
    if let Some(number) = name.strip_prefix("G54.1P") {
        let number = number.parse().ok()?;
        return (1..=300)
            .contains(&number)
            .then_some(WorkOffset::Extended(number));
    }
    let number: u8 = name.strip_prefix('G')?.parse().ok()?;
    (54..=59)
        .contains(&number)
        .then(|| WorkOffset::Standard(number - 53))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Offsets are called as programs call them, and nothing else is taken.
    #[test]
    fn offsets_by_name() {
        assert_eq!(work_offset("G54"), Some(WorkOffset::Standard(1)));
        assert_eq!(work_offset("G59"), Some(WorkOffset::Standard(6)));
        assert_eq!(work_offset("G54.1P48"), Some(WorkOffset::Extended(48)));
        assert_eq!(work_offset("EXT"), Some(WorkOffset::External));
        for wrong in [
            "G53",
            "G60",
            "54",
            "G54.1",
            "G54.1P0",
            "G54.1P301",
            "",
            "g54",
        ] {
            assert_eq!(work_offset(wrong), None, "{wrong}");
        }
    }
}
