//! The mount as a model: what it makes of each observation, and how its unknowns change that.

use nalgebra::Vector3;
use umi_kinematics::Pose;

use crate::calibrate::axis::across;
use crate::calibrate::features::SampleSights;
use crate::calibrate::observations::{Observation, Observations};
use crate::calibrate::solve::{Model, TakeRow};
use crate::rigid::{orthonormal, rotation};

#[derive(Clone)]
pub(super) struct MountModel<'a> {
    pub all: &'a Observations,
    pub mount: Pose,
    pub features: Vec<SampleSights>,
    pub radius_mm: f64,
    pub radius_free: bool,
    pub centres_known: bool,
    /// Which of the six are sought.
    pub sought: [bool; 6],
}

/// An observation by a mount: where it is on the artefact, and what changes its residual.
pub(super) struct Sight {
    pub value: f64,
    /// In the workpiece's frame.
    pub at_mm: Vector3<f64>,
    /// From the flange's origin, in its frame.
    pub arm_mm: Vector3<f64>,
    pub by_place: Vector3<f64>,
    pub by_feature: [f64; 3],
}

impl MountModel<'_> {
    /// An observation by this mount.
    pub(super) fn sight(&self, seen: &Observation) -> Sight {
        let arm_mm = self.mount.rotation * seen.seen_mm;
        let at_mm = self.all.flanges[seen.flange].point(&(arm_mm + self.mount.translation_mm));
        let (value, by_place, by_feature) = match &self.features[seen.feature] {
            SampleSights::Plane {
                normal,
                anchor_mm,
                height_mm,
            } => {
                let from = at_mm - anchor_mm;
                let (e1, e2) = across(normal);
                let by = [e1.dot(&from), e2.dot(&from), -1.0];
                (normal.dot(&from) - height_mm, *normal, by)
            }
            SampleSights::Ball { centre_mm } => {
                let from = at_mm - centre_mm;
                let distance = from.norm();
                let out = if distance > 0.0 {
                    from / distance
                } else {
                    Vector3::z()
                };
                (distance - self.radius_mm, out, (-out).into())
            }
        };
        Sight {
            value,
            at_mm,
            arm_mm,
            by_place,
            by_feature,
        }
    }

    /// Turns the normal of each plane to where the sensor saw it from: a residual is then positive outside, as a ball's is.
    pub(super) fn face_the_sensor(&mut self) {
        let mut to_sensor = vec![Vector3::zeros(); self.features.len()];
        for seen in &self.all.points {
            let flange = &self.all.flanges[seen.flange];
            to_sensor[seen.feature] += flange.rotation * self.mount.rotation * Vector3::z();
        }
        for (feature, to_sensor) in self.features.iter_mut().zip(to_sensor) {
            if let SampleSights::Plane {
                normal, height_mm, ..
            } = feature
                && normal.dot(&to_sensor) < 0.0
            {
                (*normal, *height_mm) = (-*normal, -*height_mm);
            }
        }
    }

    /// The same of other observations.
    pub(super) fn of<'b>(&self, all: &'b Observations) -> MountModel<'b> {
        MountModel {
            all,
            mount: self.mount,
            features: self.features.clone(),
            radius_mm: self.radius_mm,
            radius_free: self.radius_free,
            centres_known: self.centres_known,
            sought: self.sought,
        }
    }

    /// Unknowns of all features.
    pub(super) fn of_features(&self) -> usize {
        if self.centres_known {
            0
        } else {
            3 * self.features.len()
        }
    }
}

impl Model for MountModel<'_> {
    fn unknowns(&self) -> (usize, usize) {
        (
            self.of_features() + usize::from(self.radius_free),
            self.sought.iter().filter(|sought| **sought).count(),
        )
    }

    fn residuals(&self) -> usize {
        self.all.points.len()
    }

    fn seen_share(&self) -> f64 {
        // Noise of 20 µm tilts a plane by so much that a free direction gets up to 0.003.
        const OF_PLANES: f64 = 1e-2;
        const OF_BALLS: f64 = 1e-3;
        match self.features.first() {
            Some(SampleSights::Plane { .. }) => OF_PLANES,
            _ => OF_BALLS,
        }
    }

    fn rows(&self, row: &mut TakeRow<'_>) {
        let (nuisances, _) = self.unknowns();
        for seen in &self.all.points {
            let flange = &self.all.flanges[seen.flange];
            let Sight {
                value,
                arm_mm,
                by_place,
                by_feature,
                ..
            } = self.sight(seen);
            row(value, &mut |line| {
                if !self.centres_known {
                    line[3 * seen.feature..3 * seen.feature + 3].copy_from_slice(&by_feature);
                }
                if self.radius_free {
                    line[nuisances - 1] = -1.0;
                }
                let by_shift = flange.rotation.tr_mul(&by_place);
                let by_turn = arm_mm.cross(&by_shift);
                let by = by_turn.iter().chain(&by_shift);
                let sought = by.zip(&self.sought).filter(|(_, sought)| **sought);
                for (place, (by, _)) in sought.enumerate() {
                    line[nuisances + place] = *by;
                }
            });
        }
    }

    fn step(&mut self, step: &[f64]) {
        let (features, others) = step.split_at(self.of_features());
        for (feature, step) in self.features.iter_mut().zip(features.chunks_exact(3)) {
            match feature {
                SampleSights::Plane {
                    normal, height_mm, ..
                } => {
                    let (e1, e2) = across(normal);
                    *normal = (*normal + e1 * step[0] + e2 * step[1]).normalize();
                    *height_mm += step[2];
                }
                SampleSights::Ball { centre_mm } => *centre_mm += Vector3::from_column_slice(step),
            }
        }
        let mount = if self.radius_free {
            self.radius_mm += others[0];
            &others[1..]
        } else {
            others
        };
        step_mount(&mut self.mount, &self.sought, mount);
    }
}

/// Moves a mount by what of it is sought.
pub(super) fn step_mount(mount: &mut Pose, sought: &[bool; 6], step: &[f64]) {
    let mut six = [0.0; 6];
    let places = six.iter_mut().zip(sought).filter(|(_, sought)| **sought);
    for ((value, _), step) in places.zip(step) {
        *value = *step;
    }
    let turn = rotation(&Vector3::new(six[0], six[1], six[2]));
    mount.rotation = orthonormal(&(turn * mount.rotation));
    mount.translation_mm += Vector3::new(six[3], six[4], six[5]);
}
