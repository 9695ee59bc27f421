//! A control that rounds to steps that are too coarse.

use nalgebra::Vector3;
use umi_core::job::{datums, is_coarse};
use umi_core::units::Point;
use umi_protocol::job::{Approach, Compensation, FeatureKind};

use super::setup::Setup;

/// Those that the row names, and 0.0005 and 0.001 inch, mm.
const STEPS_MM: [f64; 5] = [0.02, 0.05, 0.1, 0.0127, 0.025_4];
/// Of a feature that says no radius.
const RADIUS_MM: f64 = 10.0;

impl Setup {
    /// Whether the board refuses each of the steps, by the touches that the job asks for.
    pub(super) fn sees_steps(&self) -> bool {
        STEPS_MM
            .iter()
            .all(|step_mm| is_coarse(self.rounded(*step_mm).into_iter()))
    }

    /// The touches of the datum features, as a control with this step says them.
    fn rounded(&self, step_mm: f64) -> Vec<(Option<Approach>, Point)> {
        let tip_mm = match self.job.compensation {
            Compensation::OnBoard { tip_radius_mm, .. } => tip_radius_mm,
            Compensation::InMacro => 0.0,
        };
        let mut touches = Vec::new();
        for (index, spec) in datums(&self.job) {
            // A plane is touched where it is.
            let is_round = matches!(spec.kind, FeatureKind::Sphere | FeatureKind::Circle);
            let radius_mm = match spec.radius_mm {
                Some(mm) => mm + tip_mm,
                None if is_round => RADIUS_MM + tip_mm,
                None => 0.0,
            };
            for approach in &spec.approach {
                let (axis, sign) = approach.axis_and_sign();
                let mut mm: Vector3<f64> = self.at(index);
                mm[axis] -= sign * radius_mm;
                let mm = mm.map(|mm| (mm / step_mm).round() * step_mm);
                touches.push((Some(*approach), Point { mm }));
            }
        }
        touches
    }
}
