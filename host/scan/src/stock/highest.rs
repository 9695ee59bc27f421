//! The place with the largest least margin, by linear programmes within a shrinking reach, from several starts.

use nalgebra::Vector6;

use super::borders::Borders;
use super::place::{Place, Search};
use crate::rigid::{Pose, Vec3};
use crate::solve::linear::{MarginRow, highest};
use crate::solve::measure;

/// The first reach of a programme in mm, at the point that is furthest from the pivot.
const REACH_MM: f64 = 2.0;
/// Where the reach is shorter, no small motion improves the place.
const RESOLUTION_MM: f64 = 1e-7;
/// Programmes from one start at most.
const PROGRAMMES: usize = 400;
/// Starts beside the two that are given.
const MORE_STARTS: usize = 6;
/// Where faces demand unlike things, the margin of a point jumps as it comes nearer to another face: starts until so
/// many of them in turn find nothing better, and at most.
const IN_VAIN: usize = 18;
const MOST_STARTS: usize = 60;
/// How wide they lie about the best place, in turn, in mm.
const WIDTHS_MM: [f64; 3] = [0.8, 0.3, 2.0];

/// How far the part may go from where its stock is most even: a part that is not scanned all around could leave its
/// raw part by the side that no point guards.
struct Range {
    even: Pose,
    limit_mm: f64,
}

impl Range {
    fn holds(&self, motion: &Pose, corners: &[Vec3]) -> bool {
        motion.apart_mm(&self.even, corners) <= self.limit_mm
    }
}

impl Search<'_> {
    /// The best place found from the start, from `even` (where the stock is most even), from `others`, and from places
    /// about the best.
    pub fn best(&self, even: &Pose, others: &[Pose]) -> Pose {
        let arm = self
            .points
            .iter()
            .map(|q| (q - self.pivot).norm())
            .fold(1e-3, f64::max);
        let stocks = measure(self.surface, self.points, even, &[], self.threads);
        let (least, most) = stocks
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), m| {
                (a.min(m.distance_mm), b.max(m.distance_mm))
            });
        let range = Range {
            even: *even,
            limit_mm: (1.0 + 4.0 * (most - least)).min(self.far_mm),
        };
        let mut best = self.climb(self.step_to(even), arm, &range);
        let from_start = self.climb(Vector6::zeros(), arm, &range);
        if from_start.least > best.least {
            best = from_start;
        }
        // Directions that are spread evenly and are always the same: the golden sections of six dimensions.
        for other in others {
            let other = self.climb(self.step_to(other), arm, &range);
            if other.least > best.least {
                best = other;
            }
        }
        let unlike = self.is_unlike();
        let mut in_vain = 0;
        for k in 0..if unlike { MOST_STARTS } else { MORE_STARTS } {
            let (width, about) = if unlike {
                // About the best and about each that was given, in turn.
                let about = others.get(k % (others.len() + 1));
                let width = WIDTHS_MM[k / (others.len() + 1) % 3];
                (width, about.map_or(best.x, |other| self.step_to(other)))
            } else {
                (0.8, best.x)
            };
            let mut x = about;
            for i in 0..6 {
                if !self.locked[i] {
                    let spread = (GOLDEN[i] * (k + 1) as f64).fract() - 0.5;
                    x[i] += spread * if i < 3 { width / arm } else { width };
                }
            }
            let other = self.climb(x, arm, &range);
            in_vain += 1;
            if other.least > best.least {
                if other.least > best.least + 1e-5 {
                    in_vain = 0;
                }
                best = other;
            }
            if unlike && in_vain >= IN_VAIN {
                break;
            }
        }
        best.motion
    }

    /// The step from the start to a place.
    fn step_to(&self, place: &Pose) -> Vector6<f64> {
        let turn = place.rotation * self.start.rotation.transpose();
        let w = crate::rigid::rotation_vector(&turn);
        let shift =
            place.translation_mm - self.pivot - turn * (self.start.translation_mm - self.pivot);
        Vector6::new(w.x, w.y, w.z, shift.x, shift.y, shift.z)
    }

    /// Whether faces demand unlike things.
    fn is_unlike(&self) -> bool {
        self.rules.windows(2).any(|pair| pair[0] != pair[1])
    }

    fn climb(&self, x: Vector6<f64>, arm: f64, range: &Range) -> Place {
        let mut here = self.place(x, &[]);
        if !range.holds(&here.motion, &self.corners) {
            here = self.place(x * 0.0, &[]);
        }
        let mut reach = REACH_MM;
        let mut borders = Borders::default();
        for _ in 0..PROGRAMMES {
            if reach < RESOLUTION_MM {
                // A point beside an edge may demand more by one face than by the other: past the edge it is well.
                match self.past_an_edge(&here, arm, range) {
                    Some(there) => (here, reach, borders) = (there, 0.2, Borders::default()),
                    None => break,
                }
            }
            let mut rows = self.rows(&here, arm, reach, 0);
            rows.extend(borders.rows(self, &here, arm));
            let Some(best) = highest(&rows, reach) else {
                break;
            };
            let mut next = here.x;
            for i in 0..6 {
                next[i] += best.step[i] / if i < 3 { arm } else { 1.0 };
            }
            let faces: Vec<usize> = here.measured.iter().map(|m| m.face).collect();
            let there = self.place(next, &faces);
            if there.least > here.least + 1e-12 && range.holds(&there.motion, &self.corners) {
                // A step that was foreseen well may be followed by a longer one.
                let foreseen = best.least - here.least;
                reach *= if there.least - here.least > 0.5 * foreseen {
                    1.5
                } else {
                    0.7
                };
                here = there;
            } else if !borders.learn(self, &here, &there) {
                reach *= 0.4;
            }
        }
        here
    }

    /// A better place that is found by overlooking the worst few points.
    fn past_an_edge(&self, here: &Place, arm: f64, range: &Range) -> Option<Place> {
        if !self.is_unlike() {
            return None;
        }
        for without in 1..=6 {
            for reach in [0.8, 0.3, 0.1] {
                let best = highest(&self.rows(here, arm, reach, without), reach)?;
                let mut next = here.x;
                for i in 0..6 {
                    next[i] += best.step[i] / if i < 3 { arm } else { 1.0 };
                }
                let there = self.place(next, &[]);
                if there.least > here.least + 1e-4 && range.holds(&there.motion, &self.corners) {
                    return Some(there);
                }
            }
        }
        None
    }

    /// The rows that can hold a step of this reach: a margin changes by at most twice what the furthest point moves.
    fn rows(&self, here: &Place, arm: f64, reach: f64, without: usize) -> Vec<MarginRow> {
        let far = here.least + 2.0 * reach * (3_f64.sqrt() * 2.0);
        let mut rows: Vec<MarginRow> = here
            .measured
            .iter()
            .zip(self.points)
            .filter_map(|(m, q)| {
                let rule = self.rules[m.face];
                let value = rule.margin(m.distance_mm);
                if value > far {
                    return None;
                }
                let slope = rule.slope(m.distance_mm);
                let gradient = self.slopes(here, q, &m.direction, arm).map(|x| -slope * x);
                Some(MarginRow { value, gradient })
            })
            .collect();
        if without > 0 {
            rows.sort_by(|a, b| a.value.total_cmp(&b.value));
            rows.drain(..without.min(rows.len()));
        }
        rows
    }
}

/// Powers of the root of x⁷ = x + 1 (Roberts' sequence in six dimensions).
const GOLDEN: [f64; 6] = [
    0.898_653_712_628_699,
    0.807_578_495_221_34,
    0.725_733_413_060_87,
    0.652_183_001_6,
    0.586_086_676_5,
    0.526_688_966_4,
];
