//! Whether a face of what was scanned stands off, and the part lies as well on that one.
//!
//! A plate that is 1 mm too thick lies on its bottom and its sides, or on its top and its sides. Either pose has a face of
//! the scan 1 mm off, and which of the two is meant the scan does not say.

use std::collections::BTreeMap;

use super::symmetry::ambiguous;
use super::{Decided, Judge};
use crate::ScanError;
use crate::localise::fit::{self, Fit};
use crate::localise::search::scene::Scene;
use crate::localise::verdict::rivals::{is_clearly_off, on};
use crate::rigid::{Pose, Vec3};
use crate::solve::{Measured, measure_within};
use crate::stock::median;

/// What lies farther off than this, over the part's diagonal, is another body's.
const REACH: f64 = 0.02;
/// A side stands off if it has this share of the points on the part, and this share of those lies at one distance.
const SHARE: f64 = 0.1;
const EVEN: f64 = 0.6;
/// The part lies as well on that side if it has this share of the points there.
const AS_WELL: f64 = 0.85;

impl Judge<'_> {
    /// With the refusal of a part that lies as well on a face that stands off.
    pub(super) fn with_aside(&self, scene: &Scene, decided: Decided) -> Decided {
        let aside = self.aside(scene, &decided.fit);
        Decided { aside, ..decided }
    }

    fn aside(&self, scene: &Scene, fit: &Fit) -> Option<ScanError> {
        let (threads, sigma) = (self.task.threads, self.noise(scene, fit));
        let reach = REACH * self.prepared.diagonal;
        let measure =
            |motion: &Pose| measure_within(self.surface, &scene.fine, motion, &[], reach, threads);
        let count_on = |measured: &[Measured]| {
            let on = measured.iter().filter(|m| on(m.distance_mm / sigma));
            on.count() as f64
        };
        let here = measure(&fit.motion);
        let all = count_on(&here);
        // By side: how far its points are off, and which way that is.
        let mut aside: BTreeMap<u32, (Vec<f64>, Vec3)> = BTreeMap::new();
        for m in &here {
            if m.distance_mm < reach && is_clearly_off(m.distance_mm / sigma) {
                let normal = fit.motion.rotation * self.task.model.triangles()[m.face].normal;
                let side = aside.entry(self.prepared.sides[m.face]);
                side.or_insert((Vec::new(), normal)).0.push(m.distance_mm);
            }
        }
        for (mut off, normal) in aside.into_values() {
            if (off.len() as f64) < SHARE * all {
                continue;
            }
            let by = median(&mut off);
            let even = off.iter().filter(|d| on((*d - by) / sigma)).count();
            if (even as f64) < EVEN * off.len() as f64 {
                continue;
            }
            let moved = Pose::shift_mm(normal * by).after(&fit.motion);
            let Some(other) = self.refine_within(scene, &moved, fit::CLOSE * sigma) else {
                continue;
            };
            if count_on(&measure(&other.motion)) > AS_WELL * all {
                return Some(ambiguous(
                    &[],
                    &[fit.motion, other.motion],
                    &format!(
                        "a face of what was scanned stands {:.3} mm off the part, which lies as well on that face and off another one",
                        by.abs()
                    ),
                    "measure the part, and crop the scan to the faces that are as the model has them",
                ));
            }
        }
        None
    }
}
