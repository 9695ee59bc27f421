//! Captures at rest, averaged.

use nalgebra::Vector3;

use crate::point::station::record::{PlacePoint, PlaceState};
use crate::point::station::wire::{NumberedReading, SignalLoss};
use crate::units::{Mm, Point};

/// Axes that stand do not leave their first latch by more.
const REST_MM: f64 = 0.005;

/// A reading with less than this share of the others' mean SNR is an outlier.
const OUTLIER: f64 = 0.5;

/// What has come so far.
#[derive(Debug, Default)]
pub(in crate::point::station) struct Collected {
    wanted: u32,
    good: u32,
    outliers: u32,
    lost: u32,
    /// No signal, by reason.
    without: [u32; 4],
    first: Option<(Vector3<f64>, f64)>,
    has_moved: bool,
    // Sums of differences from the first reading: nothing is lost to rounding.
    axes: Vector3<f64>,
    gamma: f64,
    squares: f64,
    snr: f64,
    total: f64,
}

const REASONS: [SignalLoss; 4] = [
    SignalLoss::OutOfRange,
    SignalLoss::TooSteep,
    SignalLoss::Occluded,
    SignalLoss::Underexposed,
];

impl Collected {
    /// So many captures are to come.
    pub fn of(wanted: u32) -> Self {
        Self {
            wanted,
            ..Self::default()
        }
    }

    fn came(&self) -> u32 {
        let without = self.without.iter().sum::<u32>();
        self.good + self.outliers + self.lost + without
    }

    pub fn is_complete(&self) -> bool {
        self.came() >= self.wanted
    }

    /// A capture without its reading.
    pub fn lost(&mut self) {
        self.lost += 1;
    }

    /// A reading with its latch.
    pub fn add(&mut self, axes: Point, reading: &NumberedReading) {
        let signal = match reading.signal {
            Ok(signal) => signal,
            Err(loss) => {
                for (reason, count) in REASONS.iter().zip(&mut self.without) {
                    *count += u32::from(*reason == loss);
                }
                // Where the axes stood is known all the same.
                self.first.get_or_insert((axes.mm, f64::NAN));
                return;
            }
        };
        if self.good > 0 && signal.snr < OUTLIER * self.snr / f64::from(self.good) {
            self.outliers += 1;
            return;
        }
        let (at, gamma) = match self.first {
            Some((at, gamma)) if gamma.is_finite() => (at, gamma),
            Some((at, _)) => (at, signal.gamma.0),
            None => (axes.mm, signal.gamma.0),
        };
        self.first = Some((at, gamma));
        let off = axes.mm - at;
        self.has_moved |= off.amax() > REST_MM;
        let longer = signal.gamma.0 - gamma;
        self.good += 1;
        self.axes += off;
        self.gamma += longer;
        self.squares += longer * longer;
        self.snr += signal.snr;
        self.total += signal.total;
    }

    /// What they come to.
    pub fn place(&self) -> PlacePoint {
        let Some((at, gamma)) = self.first else {
            return PlacePoint {
                state: PlaceState::LostCapture,
                lost: self.lost,
                ..PlacePoint::default()
            };
        };
        let loss = REASONS
            .iter()
            .zip(&self.without)
            .max_by_key(|(_, count)| **count);
        let without = self.without.iter().sum::<u32>();
        let state = match loss {
            _ if self.lost > 0 => PlaceState::LostCapture,
            _ if self.has_moved => PlaceState::Moved,
            Some((loss, count)) if *count > 0 && without >= self.good => {
                PlaceState::NoSignal(*loss)
            }
            _ => PlaceState::Ok,
        };
        let count = f64::from(self.good.max(1));
        let mean = self.gamma / count;
        let spread = (self.squares / count - mean * mean).max(0.0);
        PlacePoint {
            state,
            axes: Point {
                mm: at + self.axes / count,
            },
            gamma: Mm(if self.good > 0 { gamma + mean } else { 0.0 }),
            spread: Mm(libm::sqrt(spread)),
            captures: self.good,
            outliers: self.outliers,
            lost: self.lost,
            snr: self.snr / count,
            total: self.total / count,
            ..PlacePoint::default()
        }
    }
}
