//! Captures on the way: many for each place, and their smooth course.
//!
//! # Design
//!
//! A line of places is parted into cells of one step, a place in the middle of each. The captures of a cell are kept as
//! sums ([`Cell`]), so a place costs the same memory for any number of them. The reading at a place is that of the
//! least-squares parabola through the captures of its own cell and the two beside it, at the place; the parabola takes
//! out the surface's slope and curvature over three steps, and a noise of σ per capture becomes about 1.5 σ/√n.
//!
//! Where the three cells do not follow one parabola as well as neighbouring captures agree with each other, the place's own
//! cell stands alone. Where that does not either, there is an edge within a step, and no point is made of it. Neighbouring
//! captures show the noise alone, whatever the surface's slope: the mean square of their second differences is 6 σ² (after
//! von Neumann 1941, who took the first). A jump is itself among them, and at the end of few captures it hides behind its own
//! square; the median of their magnitudes is not moved by one jump ([`Noise`]). Over ribs side by side most differences are
//! jumps; so the noise at rest, where the beam was proven, bounds both: on the way it is larger where the surface is steep or
//! at the ends of the depth of field, ten times at most.
//!
//! # Limitations
//!
//! A parabola takes nine captures: four a step are enough. Where fewer a step are asked for, one is made, at the place itself;
//! nothing shows whether an edge is beside it. With fewer than nine captures in its own cell, a place beside an edge has no
//! point. A jump that is too small to be seen moves a point by 12 standard deviations of a capture at most, over ribs side by
//! side by 25 (measured in the tests), and by a micrometre besides. What is smaller than a step is averaged, or an edge.

use nalgebra::{Matrix3, Vector3};

use super::noise::Noise;
use crate::point::station::record::{PlacePoint, PlaceState};
use crate::point::station::wire::{NumberedReading, SignalLoss};
use crate::units::{Mm, Point};

/// Captures of a cell that a parabola needs.
const FEW: f64 = 9.0;

/// A reading with less than this share of the others' mean SNR is an outlier.
const OUTLIER: f64 = 0.5;

/// Captures a step with which three cells have a parabola wherever their ends fall.
pub(in crate::point::station) const LEAST: u32 = 4;

/// A parabola may leave so much of a smooth surface, mm: less than any sensor's linearity.
const REMAINDER_MM: f64 = 1e-3;

/// The noise of a capture on the way over that at rest, at most.
const OVER_REST: f64 = 10.0;

/// How much worse than neighbouring captures agree a parabola may fit, with so many captures: about five standard
/// deviations of the ratio of the two.
fn allowed(captures: f64) -> f64 {
    1.0 + 5.0 / libm::sqrt(captures)
}

/// Sums over the captures of a step. `x` in steps from the cell's middle, readings in mm from the line's first one.
#[derive(Clone, Copy, Debug, Default)]
struct Cell {
    /// Of x to the power 0 to 4.
    x: [f64; 5],
    /// Of the reading times x to the power 0 to 2.
    gamma: [f64; 3],
    gamma_squared: f64,
    /// Of the squared second differences of neighbouring captures.
    differences: f64,
    neighbours: f64,
    /// Of the axes' distances from the line's first capture, mm.
    axes: Vector3<f64>,
    snr: f64,
    total: f64,
    /// Captures, with a reading or without.
    came: u32,
    outliers: u32,
    lost: u32,
    /// The reason why there was no signal at a capture, if there was none at one.
    without: Option<SignalLoss>,
}

impl Cell {
    /// Whether a capture of it has no reading.
    fn is_holed(&self) -> bool {
        self.lost > 0 || self.without.is_some()
    }

    /// Whether nothing came for it.
    fn is_empty(&self) -> bool {
        let [captures, ..] = self.x;
        captures == 0.0 && !self.is_holed()
    }

    /// The same captures about a middle that lies so many steps behind.
    fn shifted(&self, by: f64) -> Self {
        let [s0, s1, s2, s3, s4] = self.x;
        let [g0, g1, g2] = self.gamma;
        let (d, d2) = (by, by * by);
        Self {
            x: [
                s0,
                s1 + d * s0,
                s2 + 2.0 * d * s1 + d2 * s0,
                s3 + 3.0 * d * s2 + 3.0 * d2 * s1 + d2 * d * s0,
                s4 + 4.0 * d * s3 + 6.0 * d2 * s2 + 4.0 * d2 * d * s1 + d2 * d2 * s0,
            ],
            gamma: [g0, g1 + d * g0, g2 + 2.0 * d * g1 + d2 * g0],
            ..*self
        }
    }

    fn with(mut self, other: &Self) -> Self {
        let pairs = self.x.iter_mut().zip(other.x);
        for (sum, more) in pairs.chain(self.gamma.iter_mut().zip(other.gamma)) {
            *sum += more;
        }
        self.gamma_squared += other.gamma_squared;
        self.differences += other.differences;
        self.neighbours += other.neighbours;
        self
    }

    /// The parabola's value in the middle and the scatter about it, if the captures follow it.
    fn smooth(&self, most_mm: f64) -> Option<(f64, f64)> {
        let [s0, s1, s2, s3, s4] = self.x;
        if s0 < FEW || self.neighbours < 1.0 {
            return None;
        }
        let sums = Matrix3::new(s0, s1, s2, s1, s2, s3, s2, s3, s4);
        let right = Vector3::from(self.gamma);
        let found = sums.cholesky()?.solve(&right);
        let left = (self.gamma_squared - found.dot(&right)).max(0.0);
        let scatter = libm::sqrt(left / (s0 - 3.0));
        let noise = libm::sqrt(self.differences / (6.0 * self.neighbours));
        let most_mm = (noise * allowed(s0)).min(most_mm) + REMAINDER_MM;
        (scatter <= most_mm).then_some((found.x, scatter))
    }
}

/// A line of places along X.
#[derive(Debug)]
pub(in crate::point::station) struct Sweep {
    /// Where the axes stood a step and a half before the first place, mm.
    start_x: f64,
    step: f64,
    /// The cell that captures go to, and the two before it.
    at: u32,
    cells: [Cell; 3],
    /// Axes and reading of the line's first capture.
    first: Option<(Vector3<f64>, f64)>,
    /// The last two readings of the line, mm from its first one.
    previous: [Option<f64>; 2],
    noise: Noise,
    /// Standard deviation of a reading at rest, mm, if captures were made there.
    rest_mm: Option<f64>,
}

impl Sweep {
    /// A line that begins a step and a half before its first place.
    pub fn new(start_x: f64, step: Mm, rest_mm: Option<f64>) -> Self {
        Self {
            start_x,
            step: step.0,
            at: 0,
            cells: [Cell::default(); 3],
            first: None,
            previous: [None; 2],
            noise: Noise::default(),
            rest_mm,
        }
    }

    /// Goes on by a cell, if the axes are farther on than the latest one; the place that is complete by that. Axes that are
    /// more than three cells farther on have left the line.
    pub fn go_on(&mut self, axes: Point) -> Option<Option<PlacePoint>> {
        // Casts end at the bounds.
        let at = (libm::fabs(axes.mm.x - self.start_x) / self.step) as u32;
        if at <= self.at {
            return None;
        }
        let done = self.place();
        self.noise.fade();
        let [_, second, third] = self.cells;
        self.cells = [second, third, Cell::default()];
        self.at = (self.at + 1).max(at.saturating_sub(3));
        Some(done)
    }

    /// A capture of the latest cell whose reading never came.
    pub fn lost(&mut self) {
        self.previous = [None; 2];
        let [.., cell] = &mut self.cells;
        cell.lost += 1;
        cell.came += 1;
    }

    /// A reading of the latest cell with its latch.
    pub fn add(&mut self, axes: Point, reading: &NumberedReading) {
        let middle = f64::from(self.at) + 0.5;
        let x = libm::fabs(axes.mm.x - self.start_x) / self.step - middle;
        let previous = core::mem::take(&mut self.previous);
        let [.., cell] = &mut self.cells;
        cell.came += 1;
        let signal = match reading.signal {
            Ok(signal) => signal,
            Err(loss) => {
                cell.without = Some(loss);
                return;
            }
        };
        let [count, ..] = cell.x;
        if count > 0.0 && signal.snr < OUTLIER * cell.snr / count {
            cell.outliers += 1;
            return;
        }
        let (origin, zero) = *self.first.get_or_insert((axes.mm, signal.gamma.0));
        let gamma = signal.gamma.0 - zero;
        let [before, last] = previous;
        self.previous = [last, Some(gamma)];
        if let (Some(before), Some(last)) = (before, last) {
            let second = gamma - 2.0 * last + before;
            cell.differences += second * second;
            cell.neighbours += 1.0;
            self.noise.add(second);
        }
        let mut term = 1.0;
        for sum in &mut cell.x {
            *sum += term;
            term *= x;
        }
        let mut term = gamma;
        for sum in &mut cell.gamma {
            *sum += term;
            term *= x;
        }
        cell.gamma_squared += gamma * gamma;
        cell.axes += axes.mm - origin;
        cell.snr += signal.snr;
        cell.total += signal.total;
    }

    /// The line has ended; its last place. Captures behind the last cell (axes do not stop at once) complete none.
    pub fn end(&mut self) -> Option<PlacePoint> {
        let [_, before, last] = &self.cells;
        // Without a signal they came all the same.
        let is_whole = 2 * u64::from(last.came) >= u64::from(before.came) && !last.is_empty();
        let done = if is_whole { self.place() } else { None };
        *self = Self::new(self.start_x, Mm(self.step), self.rest_mm);
        done
    }

    /// The place of the cell before the latest. The first cell has none: it is on the way to the first place.
    fn place(&self) -> Option<PlacePoint> {
        if self.at < 2 {
            return None;
        }
        let [before, own, behind] = &self.cells;
        let [captures, ..] = own.x;
        let mut found = PlacePoint {
            captures: captures as u32,
            outliers: own.outliers,
            lost: own.lost,
            ..PlacePoint::default()
        };
        let (origin, zero) = self.first.unwrap_or_default();
        let count = captures.max(1.0);
        found.axes = Point {
            mm: origin + own.axes / count,
        };
        found.snr = own.snr / count;
        found.total = own.total / count;
        if own.lost > 0 || own.is_empty() {
            found.state = PlaceState::LostCapture;
            return Some(found);
        }
        if let Some(loss) = own.without {
            found.state = PlaceState::NoSignal(loss);
            return Some(found);
        }
        let at_rest = self.rest_mm.map_or(f64::INFINITY, |mm| OVER_REST * mm);
        let most_mm = self.noise.most().min(at_rest);
        let wide = || {
            let is_whole = !before.is_holed() && !behind.is_holed();
            let three = own.with(&before.shifted(-1.0)).with(&behind.shifted(1.0));
            is_whole.then(|| three.smooth(most_mm)).flatten()
        };
        let along = |(gamma, scatter): (f64, f64)| {
            // The axes stand on the place itself.
            let middle = (f64::from(self.at) - 0.5) * self.step;
            let way = origin.x + own.axes.x / count - self.start_x;
            (gamma, scatter, self.start_x + libm::copysign(middle, way))
        };
        let only = || {
            let [gamma, ..] = own.gamma;
            (own.came == 1).then_some((gamma, 0.0, found.axes.mm.x))
        };
        let fitted = wide().or_else(|| own.smooth(most_mm)).map(along);
        match fitted.or_else(only) {
            Some((gamma, scatter, x)) => {
                found.gamma = Mm(zero + gamma);
                found.spread = Mm(scatter);
                found.axes.mm.x = x;
            }
            None => found.state = PlaceState::Edge,
        }
        Some(found)
    }
}
