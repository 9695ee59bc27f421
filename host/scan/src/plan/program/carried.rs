//! What a control must be told before it carries the point on the part through its rotary axes: where the part stands, and
//! where the point lies in the spindle's frame.

use nalgebra::{Matrix3, Vector3};

use super::super::spec::ScanSpec;
use super::PathDialect;
use crate::ScanError;

/// The middle ray's point in the spindle's frame, where a tool's length does not say it: beside the spindle's axis, or
/// behind its nose.
pub fn off_the_spindle(spec: &ScanSpec) -> Option<Vector3<f64>> {
    let tip = spec
        .machine
        .chain
        .sensor
        .point(&Vector3::new(0.0, 0.0, -spec.sensor.reference_mm));
    (tip.x.abs().max(tip.y.abs()) > 1e-6 || tip.z > 0.0).then_some(tip)
}

/// What must be set up at the control.
///
/// # Errors
/// `nc_mode` where the control knows a tool by its length alone, and the point lies beside the spindle's axis.
pub(super) fn carried(spec: &ScanSpec, dialect: PathDialect) -> Result<Vec<String>, ScanError> {
    let mut warnings = Vec::new();
    if let Some(tip) = off_the_spindle(spec) {
        if dialect != PathDialect::Siemens {
            return Err(ScanError::refused(
                "nc_mode",
                format_args!(
                    "The point on the part lies at X {:.3} Y {:.3} of the spindle, which a tool length does not say: take --nc-mode rotary.",
                    tip.x, tip.y
                ),
            ));
        }
        warnings.push(format!(
            "The point on the part lies at X {:.3} Y {:.3} Z {:.3} of the spindle: the tool needs all three lengths.",
            tip.x, tip.y, tip.z
        ));
    }
    if (spec.machine.chain.workpiece.rotation - Matrix3::identity()).amax() > 1e-9 {
        warnings.push(
            "The part is turned on its table: the work offset needs its rotations, not its place alone."
                .into(),
        );
    }
    Ok(warnings)
}
