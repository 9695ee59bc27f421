//! Motions and their ways, and how far one way strays from another that it is to follow.

use std::f64::consts::{PI, TAU};

use nalgebra::{Rotation3, Unit, Vector3};

pub(super) type V = Vector3<f64>;

/// Straight pieces that draw a whole turn.
const PIECES: f64 = 64.0;
/// Places of a motion that are looked at, at most.
const MOST_PLACES: f64 = 4096.0;

/// The way of a motion.
#[derive(Clone, Copy, Debug)]
pub enum Way {
    /// Straight.
    Line,
    /// On a circle or helix.
    Arc {
        /// A point of the axis, mm.
        center: V,
        /// The axis, a unit vector.
        axis: V,
        /// How far it turns about the axis, right-handed.
        sweep_rad: f64,
    },
}

/// A motion and the line that it comes from; coordinates are those of the work offset, mm.
#[derive(Clone, Debug)]
pub struct Move {
    /// Where it begins and ends.
    pub ends: [V; 2],
    /// Its way.
    pub path: Way,
    /// Whether it cuts.
    pub is_feed: bool,
    /// Line of the program, from 1.
    pub line: u32,
    /// Axes that are where `G28`, `G30` or `G53` has sent them, or were not named yet: no places
    /// of the part.
    pub away: [bool; 3],
    /// `G28`, `G30` or `G53` stands in its block.
    pub by_machine: bool,
}

impl Move {
    /// Whether an axis ends at no place of the part.
    #[must_use]
    pub fn is_away(&self) -> bool {
        self.away.contains(&true)
    }

    /// The place after this part of the way, 0 to 1.
    #[must_use]
    pub fn at(&self, part: f64) -> V {
        let [from, to] = self.ends;
        let Way::Arc {
            center,
            axis,
            sweep_rad,
        } = self.path
        else {
            return from + (to - from) * part;
        };
        let arm = from - center;
        let arm = arm - axis * axis.dot(&arm);
        let last = to - center;
        let last = last - axis * axis.dot(&last);
        let turn = Rotation3::from_axis_angle(&Unit::new_unchecked(axis), sweep_rad * part);
        // A control lets the radii of both ends differ by a little.
        let grown = if arm.norm() > 0.0 {
            1.0 + (last.norm() / arm.norm() - 1.0) * part
        } else {
            1.0
        };
        let along = axis * axis.dot(&(from - center + (to - from) * part));
        center + along + turn * arm * grown
    }

    /// How many straight pieces draw it.
    #[must_use]
    pub fn pieces(&self) -> u32 {
        match self.path {
            Way::Line => 1,
            Way::Arc { sweep_rad, .. } => {
                // 4 to 4096.
                (sweep_rad.abs() / TAU * PIECES)
                    .ceil()
                    .clamp(4.0, MOST_PLACES) as u32
            }
        }
    }

    /// Whether it goes nowhere, as the second of two equal blocks: less than a nanometre.
    pub(super) fn stands(&self) -> bool {
        matches!(self.path, Way::Line) && self.length_mm() < 1e-6
    }

    /// Whether all of it lies within this of its begin.
    pub(super) fn is_below(&self, mm: f64) -> bool {
        let straight_mm = (self.ends[1] - self.ends[0]).norm();
        match self.path {
            Way::Line => straight_mm <= mm,
            Way::Arc { .. } => straight_mm.max(2.0 * self.radius_mm()) <= mm,
        }
    }

    /// How long its way is, mm.
    pub(super) fn length_mm(&self) -> f64 {
        let way = self.ends[1] - self.ends[0];
        match self.path {
            Way::Line => way.norm(),
            Way::Arc {
                axis, sweep_rad, ..
            } => (self.radius_mm() * sweep_rad).hypot(axis.dot(&way)),
        }
    }

    fn radius_mm(&self) -> f64 {
        match self.path {
            Way::Line => f64::INFINITY,
            Way::Arc { center, axis, .. } => {
                let arm = self.ends[0] - center;
                (arm - axis * axis.dot(&arm)).norm()
            }
        }
    }

    /// How many places of it are looked at where it is to follow another way: a step turns it
    /// by 1/64, and leads it by an eighth of the other's radius, at most.
    fn steps(&self, wanted: &Self) -> u32 {
        let least = match wanted.path {
            Way::Line => 1.0,
            Way::Arc { .. } => 8.0,
        };
        let by_length = 8.0 * self.length_mm() / wanted.radius_mm();
        // 1 to 4096.
        by_length
            .max(f64::from(self.pieces()))
            .ceil()
            .clamp(least, MOST_PLACES) as u32
    }
}

/// How far a way strays.
#[derive(Clone, Copy, Debug)]
pub(super) struct Strays {
    /// How far, mm.
    pub mm: f64,
    /// The place that lies farthest off, in the coordinates of the wanted way.
    pub at: V,
}

/// Follows a way along another one that it should take: forwards, all turns, to its end. What is
/// measured is how far two points have to be apart, at least, that walk both ways and never turn
/// back.
pub(super) struct Follower<'a> {
    wanted: &'a Move,
    /// How far along the wanted way it may be by its direction about the axis, or along the
    /// line: from below 0 to above 1.
    part: f64,
    /// The last direction about the axis, rad.
    last_rad: Option<f64>,
    /// How far it has come, 0 to 1.
    come: f64,
    /// The farthest place so far.
    pub strays: Strays,
}

impl<'a> Follower<'a> {
    pub fn new(wanted: &'a Move) -> Self {
        Self {
            wanted,
            part: 0.0,
            last_rad: None,
            come: 0.0,
            strays: Strays {
                mm: 0.0,
                at: wanted.ends[0],
            },
        }
    }

    /// Whether the end of the wanted way may be reached: the last of its turns is more than half
    /// done.
    pub fn may_end(&self) -> bool {
        match self.wanted.path {
            Way::Line => true,
            Way::Arc { sweep_rad, .. } => {
                let left = (1.0 - self.part) * sweep_rad.abs();
                left < PI.min(sweep_rad.abs() / 2.0)
            }
        }
    }

    /// One more motion, of which only the direction counts.
    pub fn turn(&mut self, made: &Move, carried: impl Fn(V) -> V) {
        let steps = made.steps(self.wanted);
        for step in 0..=steps {
            self.walk(&carried(made.at(f64::from(step) / f64::from(steps))));
        }
    }

    /// One more motion, whose places `carried` takes into the coordinates of the wanted way.
    pub fn go(&mut self, made: &Move, carried: impl Fn(V) -> V) {
        let steps = made.steps(self.wanted);
        for step in 0..=steps {
            self.place(carried(made.at(f64::from(step) / f64::from(steps))));
        }
    }

    fn place(&mut self, place: V) {
        self.walk(&place);
        let low = self.come;
        let mut best = self.part.clamp(low, 1.0);
        let off = |part: f64| (self.wanted.at(part) - place).norm();
        // On a circle, the nearest point lies in the same direction; on a helix near it.
        if let Way::Arc {
            axis, sweep_rad, ..
        } = self.wanted.path
            && axis.dot(&(self.wanted.ends[1] - self.wanted.ends[0])).abs() > 1e-9
        {
            let about = (PI / 4.0 / sweep_rad.abs()).min(1.0);
            let mut from = (self.part - about).clamp(low, 1.0);
            let mut to = (self.part + about).clamp(low, 1.0);
            for _ in 0..32 {
                let (a, b) = (from + (to - from) / 3.0, to - (to - from) / 3.0);
                if off(a) < off(b) {
                    to = b;
                } else {
                    from = a;
                }
            }
            let found = f64::midpoint(from, to);
            if off(found) < off(best) {
                best = found;
            }
        }
        self.come = best;
        self.note(off(best), place);
    }

    fn note(&mut self, mm: f64, at: V) {
        // What is no number strays, too.
        let is_nearer = mm <= self.strays.mm;
        if !is_nearer {
            self.strays = Strays { mm, at };
        }
    }

    /// Moves on to a place, forwards or back.
    fn walk(&mut self, place: &V) {
        let [from, to] = self.wanted.ends;
        match self.wanted.path {
            Way::Line => {
                let along = to - from;
                let squares = along.norm_squared();
                self.part = if squares > 0.0 {
                    (place - from).dot(&along) / squares
                } else {
                    1.0
                };
            }
            Way::Arc {
                center,
                axis,
                sweep_rad,
            } => {
                let arm = from - center;
                let right = arm - axis * axis.dot(&arm);
                let up = axis.cross(&right);
                let arm = place - center;
                let rad = up.dot(&arm).atan2(right.dot(&arm));
                let mut turned = rad - self.last_rad.unwrap_or(0.0);
                turned -= TAU * (turned / TAU).round();
                // Past the axis, as a chord of hardly an arc goes, it is the shorter way for none.
                let is_unclear = turned.abs() > TAU / 3.0;
                if is_unclear && turned * sweep_rad < 0.0 {
                    turned += TAU.copysign(sweep_rad);
                }
                self.last_rad = Some(rad);
                self.part += turned / sweep_rad;
            }
        }
    }

    /// Behind the last motion, which ends here: what of the wanted way was left out?
    pub fn end(mut self, place: V) -> Strays {
        let left = 1.0 - self.come;
        let pieces = self.wanted.pieces();
        for piece in 0..=pieces {
            let part = self.come + left * f64::from(piece) / f64::from(pieces);
            self.note((self.wanted.at(part) - place).norm(), place);
        }
        self.strays
    }
}
