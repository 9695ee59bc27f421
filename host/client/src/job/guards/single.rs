//! Errors of single features: what lies on one, what an early touch does, and what all have alike.

use nalgebra::Vector3;
use umi_core::job::{closing, datums, fixed, touches_again};
use umi_protocol::job::{FeatureKind, FeatureSpec};

use super::seen::{SeenFrom, least, worst};
use super::setup::Setup;
use super::size::unit;

/// A probe that touches early is told too high.
const UP: [[i8; 3]; 1] = [[0, 0, 1]];

impl Setup {
    /// One feature is off: the worst of all that the part is corrected by.
    pub(super) fn one(&self, directions: &[[i8; 3]]) -> SeenFrom {
        let balls = datums(&self.job).count();
        worst(datums(&self.job).map(|(of, _)| {
            let off = |along: Vector3<f64>, index: usize, mm: f64| {
                along * if index == of { mm } else { 0.0 }
            };
            match directions {
                [alone] => self.from(balls, &|index, mm| off(unit(alone), index, mm)),
                _ => self.worst_direction(balls, &off),
            }
        }))
    }

    /// Which feature is probed as this one: what lies on a ball is there again when it is probed
    /// again.
    fn repeated(&self, index: usize) -> usize {
        let again = closing(&self.job).find(|(again, _)| *again == index);
        again
            .and_then(|(_, closing)| {
                let features = &self.job.features;
                features.iter().position(|f| f.name == closing.repeats)
            })
            .unwrap_or(index)
    }

    /// Something lies on one feature, and is there when it is probed again.
    pub(super) fn chip(&self) -> SeenFrom {
        let balls = datums(&self.job).count();
        worst(datums(&self.job).map(|(of, _)| {
            self.from(balls, &|index, mm| {
                Vector3::z() * if self.repeated(index) == of { mm } else { 0.0 }
            })
        }))
    }

    /// Two features, or all but one, are too high alike: where they lie on one side, a tilt does
    /// so as well.
    pub(super) fn chips(&self) -> SeenFrom {
        let balls = datums(&self.job).count();
        let due: Vec<usize> = datums(&self.job).map(|(index, _)| index).collect();
        let pairs = due.iter().enumerate().flat_map(|(number, one)| {
            let behind = due.iter().skip(number + 1);
            behind.map(|other| vec![*one, *other])
        });
        let but_one = due.iter().map(|clean| {
            let others = due.iter().copied().filter(|index| index != clean);
            others.collect()
        });
        let chipped: Vec<Vec<usize>> = pairs.chain(but_one).collect();
        worst(chipped.iter().map(|chipped| {
            self.from(balls, &|index, mm| {
                let is_high = chipped.contains(&self.repeated(index));
                Vector3::z() * if is_high { mm } else { 0.0 }
            })
        }))
    }

    /// All features of the part are too high alike, and none on the table.
    pub(super) fn dust(&self) -> SeenFrom {
        let fixed: Vec<usize> = fixed(&self.job).map(|(index, _)| index).collect();
        self.from(1, &|index, mm| {
            let is_high = !fixed.contains(&self.repeated(index));
            Vector3::z() * if is_high { mm } else { 0.0 }
        })
    }

    /// One feature has moved on the part, and stands there when it is probed again.
    pub(super) fn ball_moved(&self) -> SeenFrom {
        let balls = datums(&self.job).count();
        worst(datums(&self.job).map(|(of, _)| {
            self.worst_direction(balls, &|along, index, mm| {
                along * if self.repeated(index) == of { mm } else { 0.0 }
            })
        }))
    }

    /// The first touch of a ball is early and the others are driven by it: where the top is
    /// touched twice the two differ by all of it.
    pub(super) fn early_top(&self) -> SeenFrom {
        let is_again = datums(&self.job).all(|(_, feature)| touches_again(feature));
        match self.job.again {
            // Two hits stand against each other, no balls.
            Some(again) if is_again => self.scattered(1, again.within_mm * 1e3),
            _ => self.one(&UP),
        }
    }

    /// All are off alike.
    pub(super) fn together(&self) -> SeenFrom {
        self.worst_direction(1, &|along, _, mm| along * mm)
    }

    /// Each hit is so much later than when taught, as at another feed: a ball's radius shows it.
    pub(super) fn trips_later(&self) -> SeenFrom {
        let limits = &self.job.limits;
        let learned = self.job.guards.learned;
        let mm = match learned {
            Some(learned) => learned.radius_mm.min(limits.radius_error_mm),
            // Twice: the taught one may be off the other way.
            None => 2.0 * limits.radius_error_mm,
        };
        let has_radius = |feature: &FeatureSpec| {
            matches!(feature.kind, FeatureKind::Sphere | FeatureKind::Circle)
        };
        if datums(&self.job).any(|(_, feature)| has_radius(feature)) {
            self.scattered(1, mm * 1e3)
        } else {
            SeenFrom::Never
        }
    }

    /// Z counts other millimetres than when the reference was taught.
    pub(super) fn z_scale(&self) -> SeenFrom {
        let by_places = self.from(1, &|_, mm| Vector3::new(0.0, 0.0, mm));
        match &self.job.witness {
            Some(witness) => least(by_places, self.scattered(1, witness.tolerance_mm * 1e3)),
            None => by_places,
        }
    }
}
