//! The residual of a reading and its derivatives.
//!
//! The unknowns are local: the beam's foot c = t + γ̄ g a (where the point at
//! the mean reading γ̄ stands), two angles of a, the gain and the radius error.
//! With c instead of t the unknowns hardly depend on each other.

// Every index runs over arrays of length K, or of 5 with K at least 5.
#![allow(clippy::indexing_slicing, clippy::needless_range_loop)]

use nalgebra::Vector3;

use super::error::PointRefusal;
use super::reading::{BallReading, CalibrationBall, PointQuestion};
use crate::fit::solve::least_squares::{Sums, Surface, System, Term};
use crate::fit::solve::linalg::{norm, perpendicular_frame, unit};

/// Unknowns of every calibration: three of t, two of a.
const ALWAYS: usize = 5;

/// Largest part of the radius that a radius error may be.
const RADIUS_BOUND: f64 = 0.2;

/// Gains outside 1/GAIN_BOUND..GAIN_BOUND are no calibration but another unit.
const GAIN_BOUND: f64 = 5.0;

/// Coordinates beyond this are no position on a machine; squares of those that
/// are stay far from overflow.
const MAX_MM: f64 = 1e9;

/// Least |n·a| that a weight follows.
const LEAST_COSINE: f64 = 0.2;

/// (√5 - 1) / 2.
const GOLDEN_SECTION: f64 = 0.618_033_988_749_894_9;

/// A reading as the fit sees it.
#[derive(Clone, Copy)]
pub(super) struct Sighting {
    /// Q - C.
    pub(super) from_center: Vector3<f64>,
    /// γ - γ̄.
    pub(super) spread: f64,
    /// Radius of the ball struck.
    pub(super) radius: f64,
    /// Factor of the residual.
    pub(super) weight: f64,
    /// Index of that ball.
    pub(super) ball: usize,
}

/// The unknowns.
#[derive(Clone, Copy, Debug)]
pub(super) struct Beam<const K: usize> {
    /// c.
    pub(super) foot: Vector3<f64>,
    /// a.
    pub(super) direction: Vector3<f64>,
    /// The two directions that a can turn to.
    pub(super) across: [Vector3<f64>; 2],
    /// g.
    pub(super) gain: f64,
    /// What is added to the radius.
    pub(super) radius_error: f64,
    /// Index of the gain among the unknowns.
    pub(super) gain_at: Option<usize>,
    /// Index of the radius error among the unknowns.
    pub(super) radius_at: Option<usize>,
    /// Largest radius error.
    radius_bound: f64,
    /// Size of the numbers whose difference is a residual.
    magnitude: f64,
}

impl<const K: usize> Beam<K> {
    /// Points the beam along a unit vector.
    pub(super) fn turn(&mut self, direction: Vector3<f64>) {
        let (e1, e2) = perpendicular_frame(&direction);
        self.direction = direction;
        self.across = [e1, e2];
    }

    /// P - C of a reading.
    pub(super) fn arm(&self, seen: &Sighting) -> Vector3<f64> {
        seen.from_center + self.foot + self.direction * (seen.spread * self.gain)
    }

    /// How far a reading's point is outside its ball, times the reading's weight.
    pub(super) fn residual(&self, seen: &Sighting) -> f64 {
        seen.weight * (norm(&self.arm(seen)) - seen.radius - self.radius_error)
    }

    /// How the residual moves with the unknowns, for a weight of 1: e1 and e2 move the arm by the stretch, a by the
    /// spread; with c it moves as c does.
    fn slope(&self, seen: &Sighting, normal: &Vector3<f64>) -> [f64; K] {
        let mut slope = [0.0; K];
        for axis in 0..3 {
            slope[axis] = normal[axis];
        }
        for (angle, e) in self.across.iter().enumerate() {
            slope[3 + angle] = seen.spread * self.gain * normal.dot(e);
        }
        if let Some(at) = self.gain_at {
            slope[at] = seen.spread * normal.dot(&self.direction);
        }
        if let Some(at) = self.radius_at {
            slope[at] = -1.0;
        }
        slope
    }

    /// First derivatives of the residual.
    pub(super) fn gradient(&self, seen: &Sighting) -> Option<[f64; K]> {
        let slope = self.slope(seen, &self.normal(seen)?);
        Some(slope.map(|slope| slope * seen.weight))
    }

    /// The unit normal of the ball where a reading's point is nearest.
    pub(super) fn normal(&self, seen: &Sighting) -> Option<Vector3<f64>> {
        unit(&self.arm(seen))
    }
}

/// Adds one term to the sums: for each row the columns up to it. Written out, because a search looks
/// at thousands of terms, and a loop over so few takes longer than what it does.
macro_rules! add_term {
    ($sums:ident, $residual:ident, $slope:ident, $second:ident: $($i:literal => $($j:literal)+;)+) => {
        $($sums.gradient[$i] += $slope[$i] * $residual;)+
        $($({
            let square = $slope[$i] * $slope[$j];
            $sums.gram[$i][$j] += square;
            $sums.hessian[$i][$j] += square + $residual * $second[$i][$j];
        })+)+
    };
}

impl<const K: usize> Beam<K> {
    /// What a reading adds where neither gain nor radius is asked for: as `term`, to the last bit.
    fn add(&self, seen: &Sighting, sums: &mut Sums<ALWAYS>) -> Option<()> {
        let arm = self.arm(seen);
        let length = norm(&arm);
        // Also refuses NaN.
        if !(length > 0.0 && length.is_finite()) {
            return None;
        }
        let normal = arm / length;
        let [x, y, z] = [normal.x, normal.y, normal.z];
        let [e1, e2] = self.across;
        let stretch = seen.spread * self.gain;
        let bend = -stretch * normal.dot(&self.direction);
        let (s1, s2) = (stretch * normal.dot(&e1), stretch * normal.dot(&e2));
        let aside = |e: f64, slope: f64, n: f64| (stretch * e - slope * n) / length;
        let turn = |slope: f64| (stretch * stretch - slope * slope) / length + bend;
        let mut slope = [x, y, z, s1, s2];
        let mut second = [
            [(1.0 - x * x) / length, 0.0, 0.0, 0.0, 0.0],
            [-y * x / length, (1.0 - y * y) / length, 0.0, 0.0, 0.0],
            [
                -z * x / length,
                -z * y / length,
                (1.0 - z * z) / length,
                0.0,
                0.0,
            ],
            [
                aside(e1.x, s1, x),
                aside(e1.y, s1, y),
                aside(e1.z, s1, z),
                turn(s1),
                0.0,
            ],
            [
                aside(e2.x, s2, x),
                aside(e2.y, s2, y),
                aside(e2.z, s2, z),
                -s2 * s1 / length,
                turn(s2),
            ],
        ];
        let weight = seen.weight;
        if weight != 1.0 {
            slope = slope.map(|slope| slope * weight);
            second = second.map(|row| row.map(|value| value * weight));
        }
        let residual = weight * (length - seen.radius - self.radius_error);
        sums.sum += residual * residual;
        add_term!(sums, residual, slope, second:
            0 => 0;
            1 => 0 1;
            2 => 0 1 2;
            3 => 0 1 2 3;
            4 => 0 1 2 3 4;
        );
        Some(())
    }
}

impl<const K: usize> Surface<K, Sighting> for Beam<K> {
    fn term(&self, seen: &Sighting) -> Option<Term<K>> {
        let arm = self.arm(seen);
        let length = norm(&arm);
        // Also refuses NaN.
        if !(length > 0.0 && length.is_finite()) {
            return None;
        }
        let normal = arm / length;
        let [e1, e2] = self.across;
        let (spread, stretch) = (seen.spread, seen.spread * self.gain);
        let aside = [normal.dot(&e1), normal.dot(&e2)];
        let ahead = normal.dot(&self.direction);
        let mut gradient = self.slope(seen, &normal);
        // Of |v|: (moves·moves - (n·moves)²) / |v|, and n · second moves.
        let mut second = [[0.0; K]; K];
        for i in 0..3 {
            for j in 0..i {
                second[i][j] = -normal[i] * normal[j] / length;
            }
            second[i][i] = (1.0 - normal[i] * normal[i]) / length;
        }
        // a turns on the unit sphere: its second derivative is -a for each angle.
        let bend = -stretch * ahead;
        for (angle, e) in [e1, e2].into_iter().enumerate() {
            let row = 3 + angle;
            for j in 0..3 {
                second[row][j] = (stretch * e[j] - gradient[row] * normal[j]) / length;
            }
            second[row][row] = (stretch * stretch - gradient[row] * gradient[row]) / length + bend;
        }
        second[4][3] = -gradient[4] * gradient[3] / length;
        if let Some(at) = self.gain_at {
            for j in 0..3 {
                second[at][j] = (spread * self.direction[j] - gradient[at] * normal[j]) / length;
            }
            for angle in 0..2 {
                second[at][3 + angle] =
                    -gradient[at] * gradient[3 + angle] / length + spread * aside[angle];
            }
            second[at][at] = (spread * spread - gradient[at] * gradient[at]) / length;
        }
        let weight = seen.weight;
        if weight != 1.0 {
            for i in 0..K {
                gradient[i] *= weight;
                for j in 0..=i {
                    second[i][j] *= weight;
                }
            }
        }
        Some(Term {
            residual: weight * (length - seen.radius - self.radius_error),
            gradient,
            second,
        })
    }

    fn system<I>(&self, points: &I) -> Option<System<K>>
    where
        I: Iterator<Item = Sighting> + Clone,
    {
        if K != ALWAYS {
            return System::at(self, points);
        }
        let mut sums = Sums {
            sum: 0.0,
            gradient: [0.0; ALWAYS],
            gram: [[0.0; ALWAYS]; ALWAYS],
            hessian: [[0.0; ALWAYS]; ALWAYS],
        };
        let mut n = 0_usize;
        for seen in points.clone() {
            n += 1;
            self.add(&seen, &mut sums)?;
        }
        System::of(n, &sums)
    }

    fn moved(&self, step: &[f64; K]) -> Option<Self> {
        let mut next = *self;
        let [e1, e2] = self.across;
        next.foot += Vector3::new(step[0], step[1], step[2]);
        // More than a radian in one step is a jump to somewhere else.
        if step[3] * step[3] + step[4] * step[4] > 1.0 {
            return None;
        }
        next.turn(unit(&(self.direction + e1 * step[3] + e2 * step[4]))?);
        if let Some(at) = self.gain_at {
            next.gain += step[at];
            if !(next.gain > 1.0 / GAIN_BOUND && next.gain < GAIN_BOUND) {
                return None;
            }
        }
        if let Some(at) = self.radius_at {
            next.radius_error += step[at];
            let size = next.radius_error.abs();
            if size.is_nan() || size >= self.radius_bound {
                return None;
            }
        }
        let finite = next.foot.iter().all(|x| x.is_finite());
        finite.then_some(next)
    }

    fn magnitude(&self) -> f64 {
        self.magnitude
    }
}

/// The readings as the fit sees them.
#[derive(Clone, Copy)]
pub(super) struct View<'a, const K: usize> {
    readings: &'a [BallReading],
    pub(super) balls: &'a [CalibrationBall],
    /// γ̄.
    pub(super) mean_gamma: f64,
    /// Standard deviation of the readings.
    pub(super) spread: f64,
    free_gain: bool,
    free_radius: bool,
    magnitude: f64,
    weights: Option<Beam<K>>,
    /// The part of the readings that is looked at; 1 or more for all.
    part: f64,
    /// How many those are.
    count: f64,
}

impl<'a, const K: usize> View<'a, K> {
    /// Checks every number on its own.
    pub(super) fn new(
        readings: &'a [BallReading],
        balls: &'a [CalibrationBall],
        wanted: &PointQuestion,
    ) -> Result<Self, PointRefusal> {
        let usual = |x: f64| x.is_finite() && x.abs() <= MAX_MM;
        for (ball, one) in balls.iter().enumerate() {
            let bad = |why| Err(PointRefusal::BadSphere { ball, why });
            if !(one.radius.0 > 0.0 && usual(one.radius.0)) {
                return bad("its radius is not a positive length: give radius_mm");
            }
            if !one.center.mm.iter().all(|x| usual(*x)) {
                return bad("its centre is not a position: give center_mm as three numbers");
            }
            let u = [one.u_center.0, one.u_radius.0];
            if !u.iter().all(|x| *x >= 0.0 && usual(*x)) {
                return bad("a standard uncertainty is not a length: give 0 or more");
            }
        }
        let mut magnitude = 0.0_f64;
        let mut mean = 0.0;
        for (row, reading) in readings.iter().enumerate() {
            let finite = reading.axes.mm.iter().all(|x| usual(*x)) && usual(reading.gamma.0);
            if !finite {
                return Err(PointRefusal::NotFinite { row });
            }
            let Some(ball) = balls.get(reading.ball) else {
                return Err(PointRefusal::UnknownSphere { row });
            };
            let size = reading.axes.mm.amax().max(ball.center.mm.amax());
            magnitude = magnitude
                .max(size)
                .max(reading.gamma.0.abs())
                .max(ball.radius.0);
            mean += reading.gamma.0;
        }
        let needed = K.saturating_add(1);
        if readings.len() < needed {
            return Err(PointRefusal::TooFewPoints {
                given: readings.len(),
                needed,
            });
        }
        if let (true, Some(first)) = (wanted.free_radius, readings.first())
            && readings.iter().any(|r| r.ball != first.ball)
        {
            return Err(PointRefusal::BadSphere {
                ball: first.ball,
                why: "an error of the radius can be found with readings of one ball only: leave out the other balls' readings, or give the radii",
            });
        }
        let n = crate::fit::solve::cloud::count(readings.len());
        mean /= n;
        let mut squares = 0.0;
        for reading in readings {
            squares += (reading.gamma.0 - mean) * (reading.gamma.0 - mean);
        }
        Ok(Self {
            readings,
            balls,
            mean_gamma: mean,
            spread: libm::sqrt(squares / n),
            free_gain: wanted.free_gain,
            free_radius: wanted.free_radius,
            magnitude,
            weights: None,
            part: 1.0,
            count: n,
        })
    }

    /// About `number` of the readings, from all over the list: the multiples of
    /// the golden section are spread evenly, whatever the order of the readings
    /// repeats. All of them if there are not many more.
    pub(super) fn thinned(&self, number: f64) -> Self {
        let mut view = *self;
        if self.count > 1.5 * number {
            view.part = number / self.count;
            view.count = view.sightings().fold(0.0, |count, _| count + 1.0);
        }
        view
    }

    /// From now on residuals count along the beam, as it stands.
    pub(super) fn weigh_by(&mut self, beam: &Beam<K>) {
        self.weights = Some(*beam);
    }

    /// The sightings, in the order of the readings.
    pub(super) fn sightings(&self) -> impl Iterator<Item = Sighting> + Clone + use<'a, K> {
        let Self {
            readings,
            balls,
            mean_gamma,
            weights,
            part,
            ..
        } = *self;
        let mut place = 0.0;
        readings.iter().filter_map(move |reading| {
            place += GOLDEN_SECTION;
            if place >= 1.0 {
                place -= 1.0;
            }
            if place >= part {
                return None;
            }
            let ball = balls.get(reading.ball)?;
            let mut seen = Sighting {
                from_center: reading.axes.mm - ball.center.mm,
                spread: reading.gamma.0 - mean_gamma,
                radius: ball.radius.0,
                weight: 1.0,
                ball: reading.ball,
            };
            if let Some(beam) = weights
                && let Some(normal) = beam.normal(&seen)
            {
                seen.weight = 1.0 / normal.dot(&beam.direction).abs().max(LEAST_COSINE);
            }
            Some(seen)
        })
    }

    /// Number of readings that are looked at.
    pub(super) fn count(&self) -> f64 {
        self.count
    }

    /// Degrees of freedom.
    pub(super) fn dof(&self) -> usize {
        self.readings.len().saturating_sub(K)
    }

    /// The smallest radius among the balls struck.
    pub(super) fn least_radius(&self) -> f64 {
        self.sightings()
            .fold(f64::INFINITY, |least, seen| least.min(seen.radius))
    }

    /// Whether the radius is asked for.
    pub(super) fn free_radius(&self) -> bool {
        self.free_radius
    }

    /// Whether the gain is asked for.
    pub(super) fn free_gain(&self) -> bool {
        self.free_gain
    }

    /// The largest radius over the one that is given.
    pub(super) fn largest_swelling(&self) -> f64 {
        if self.free_radius {
            1.0 + RADIUS_BOUND
        } else {
            1.0
        }
    }

    /// A beam to start from.
    pub(super) fn beam(&self, foot: Vector3<f64>, direction: Vector3<f64>) -> Beam<K> {
        let (e1, e2) = perpendicular_frame(&direction);
        Beam {
            foot,
            direction,
            across: [e1, e2],
            gain: 1.0,
            radius_error: 0.0,
            gain_at: self.free_gain.then_some(ALWAYS),
            radius_at: self.free_radius.then_some(K.saturating_sub(1)),
            radius_bound: RADIUS_BOUND * self.least_radius(),
            magnitude: self.magnitude,
        }
    }
}
