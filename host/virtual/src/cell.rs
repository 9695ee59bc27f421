//! A control and its machine: programs in, motions and text out.

use crate::cutting::{CylinderArc, Grid, Workpiece};
use crate::machine::{VirtualMachine, Wires};
use crate::nc::{Alarm, AxisDrives, BlockStep, Control, ProgramState};
use crate::scene::{Scene, SceneError, SceneShape};

/// A control in front of its machine.
#[derive(Debug)]
pub struct Cell<M> {
    /// The control.
    pub control: Control,
    /// The machine, or what stands between it and the control.
    pub machine: M,
}

impl<W: Wires> Cell<VirtualMachine<W>> {
    /// Switches both on, with the scene's parameters, offsets and tools.
    pub fn new(scene: Scene, seed: u64, wires: W) -> Self {
        Self {
            control: control(&scene),
            machine: VirtualMachine::new(scene, seed, wires),
        }
    }
}

impl<M: AxisDrives> Cell<M> {
    /// Loads a text and runs its first program to its end; `seen` is told of every
    /// block. Stops (M0, M1, `#3006`) go on by themselves once `seen` has seen them.
    ///
    /// # Errors
    /// The alarm at which it stopped, or what `seen` returns.
    pub fn run<E: From<Alarm>>(
        &mut self,
        program: &str,
        mut seen: impl FnMut(&mut Self, &BlockStep) -> Result<(), E>,
    ) -> Result<(), E> {
        if let Some(first) = self.control.load(program)?.first() {
            self.control.select(*first)?;
        }
        loop {
            let step = self.control.step(&mut self.machine)?;
            seen(self, &step)?;
            if step.state == ProgramState::Ended {
                return Ok(());
            }
        }
    }
}

/// The workpiece of a scene, raw, and its nominal surface: the body that may be cut, an
/// arc with its stock. None if there is no such body.
///
/// # Errors
/// There are several, or it is no arc.
pub fn workpiece(scene: &Scene) -> Result<Option<(Workpiece, CylinderArc)>, SceneError> {
    let mut bodies = scene.bodies().iter().filter(|body| body.cuttable);
    let Some(body) = bodies.next() else {
        return Ok(None);
    };
    let refuse = |message: String| Err(SceneError { message });
    if let Some(other) = bodies.next() {
        return refuse(format!(
            "bodies {} and {} may both be cut; one workpiece at a time",
            body.name, other.name
        ));
    }
    let SceneShape::Arc {
        radius_mm,
        length_mm,
        width_mm,
        ..
    } = body.shape
    else {
        return refuse(format!(
            "body {}: only an arc may be cut (`cuttable = false` for the others)",
            body.name
        ));
    };
    let half = |mm: f64| [-mm / 2.0, mm / 2.0];
    let pitch_mm = [length_mm / 128.0, width_mm / 1024.0];
    let grid =
        Grid::new(half(length_mm), half(width_mm), pitch_mm).map_err(|fault| SceneError {
            message: format!("body {}: {fault}", body.name),
        })?;
    let nominal = CylinderArc {
        axis_y_mm: 0.0,
        axis_z_mm: -radius_mm,
        radius_mm,
    };
    let raw = CylinderArc {
        radius_mm: radius_mm + body.stock_mm,
        ..nominal
    };
    let mut workpiece = Workpiece::new(grid, |_, y| raw.height_mm(y).unwrap_or(f64::NEG_INFINITY));
    workpiece.clamp(*body.placed());
    Ok(Some((workpiece, nominal)))
}

/// A control with a scene's parameters, offsets and tools.
#[must_use]
pub fn control(scene: &Scene) -> Control {
    let mut control = Control::new(scene.control.nc.clone());
    for (offset, origin_mm) in &scene.offsets_mm {
        control.set_offset(*offset, *origin_mm);
    }
    for (set, error) in &scene.setting_errors {
        control.offsets_mut().set_setting_error(*set, *error);
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
