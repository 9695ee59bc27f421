//! The part moves between two hits: it slips, drifts, turns on the table or rocks.

use std::ops::Range;

use nalgebra::{Rotation3, Unit, Vector3};
use umi_core::job::{closing, datums, fixed};

use super::seen::{SeenFrom, worst};
use super::setup::Setup;

/// So many datum features have middles that are tried as well.
const FEW: usize = 4;

impl Setup {
    /// Those that move with the part, in their order.
    fn moving(&self) -> Vec<usize> {
        let fixed: Vec<usize> = fixed(&self.job).map(|(index, _)| index).collect();
        // One that repeats a feature on the table is on it as well.
        let again = closing(&self.job)
            .filter(|(_, closing)| self.job.guards.fixed.contains(&closing.repeats));
        let again: Vec<usize> = again.map(|(index, _)| index).collect();
        (0..self.places.len())
            .filter(|index| !fixed.contains(index) && !again.contains(index))
            .collect()
    }

    /// They move evenly from the first to the last.
    pub(super) fn drift(&self) -> SeenFrom {
        let moving = self.moving();
        let last = moving.len().saturating_sub(1).max(1) as f64;
        self.worst_direction(self.against(), &|along, index, mm| {
            let turn = moving.iter().position(|of| *of == index);
            along * turn.map_or(0.0, |turn| mm * turn as f64 / last)
        })
    }

    /// From one of them on they have moved.
    pub(super) fn slip(&self) -> SeenFrom {
        let moving = self.moving();
        worst((1..moving.len()).map(|first| {
            let moved = &moving[first..];
            self.worst_direction(self.against(), &|along, index, mm| {
                along * if moved.contains(&index) { mm } else { 0.0 }
            })
        }))
    }

    /// From one of them on, up to the first closing one, it has turned on the table: about a ball,
    /// or between two. The size is what the datum feature does that moves most, of those that were
    /// probed before: if none of them has moved, what was measured is right.
    pub(super) fn turned(&self) -> SeenFrom {
        self.worst_turn(self.upright(), 1..self.first_closing())
    }

    /// It has rocked there: over two of its balls, or a line between them.
    pub(super) fn rocked(&self) -> SeenFrom {
        self.worst_turn(self.lying(), 1..self.first_closing())
    }

    /// It has turned or rocked between the first closing one and the last: each is seen by those
    /// alone that come behind it.
    pub(super) fn moved_while_closing(&self) -> SeenFrom {
        let behind = self.first_closing()..self.moving().len();
        let axes = self.upright().into_iter().chain(self.lying());
        self.worst_turn(axes.collect(), behind)
    }

    /// So many of those that move come before the part has moved, at most, where the first closing
    /// one has seen it.
    fn first_closing(&self) -> usize {
        let moving = self.moving();
        let is_closing = |index: &usize| closing(&self.job).any(|(again, _)| again == *index);
        let upto = moving.iter().position(is_closing);
        upto.map_or(moving.len(), |first| first + 1)
    }

    /// Upright axes of a turn.
    fn upright(&self) -> Vec<(Vector3<f64>, Vector3<f64>)> {
        let pivots = self.pivots();
        pivots.into_iter().map(|at| (at, Vector3::z())).collect()
    }

    /// Axes of a turn through two pivots.
    fn lying(&self) -> Vec<(Vector3<f64>, Vector3<f64>)> {
        let pivots = self.pivots();
        let pairs = pivots.iter().enumerate().flat_map(|(number, from)| {
            let behind = pivots.iter().skip(number + 1);
            behind.map(move |to| (*from, to - from))
        });
        pairs.collect()
    }

    /// The datum places, and where they are few the middles of each two: what closing features
    /// show least of passes through some of these.
    fn pivots(&self) -> Vec<Vector3<f64>> {
        let places: Vec<Vector3<f64>> = (datums(&self.job))
            .map(|(index, _)| self.at(index))
            .collect();
        let mut pivots = places.clone();
        if places.len() <= FEW {
            for (number, a) in places.iter().enumerate() {
                pivots.extend(places.iter().skip(number + 1).map(|b| (a + b) / 2.0));
            }
        }
        pivots
    }

    /// The worst turn about one of these axes, before one of these of all that move.
    fn worst_turn(
        &self,
        axes: Vec<(Vector3<f64>, Vector3<f64>)>,
        before: Range<usize>,
    ) -> SeenFrom {
        let (moving, balls) = (self.moving(), self.against());
        // None is tried where there is nothing to turn about, or no second feature that shows it.
        let mut most = None;
        for first in before {
            let moved = &moving[first..];
            for (about, along) in &axes {
                let Some(along) = Unit::try_new(*along, 1e-9) else {
                    continue;
                };
                let arm = moving[..first]
                    .iter()
                    .map(|index| along.cross(&(self.at(*index) - about)).norm())
                    .fold(0.0, f64::max);
                if arm < 1.0 {
                    continue;
                }
                let off = |index: usize, mm: f64| {
                    let by = Rotation3::from_axis_angle(&along, mm / arm);
                    let arm = self.at(index) - about;
                    if moved.contains(&index) {
                        by * arm - arm
                    } else {
                        Vector3::zeros()
                    }
                };
                most = Some(match most {
                    None => self.from(balls, &off),
                    Some(most) if self.is_later(most, balls, &off) => {
                        worst([most, self.from(balls, &off)].into_iter())
                    }
                    Some(most) => most,
                });
            }
        }
        most.unwrap_or(SeenFrom::Never)
    }

    /// How many balls stand against each other where the part has moved: the closing one
    /// against the first, or all of them.
    fn against(&self) -> usize {
        match self.job.guards.closing.first() {
            Some(_) => 1,
            None => datums(&self.job).count(),
        }
    }
}
