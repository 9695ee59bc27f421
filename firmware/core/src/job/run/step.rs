//! The step to which a control rounds: what all coordinates of a setup have in common, whatever
//! digits are printed.
//!
//! # Rule
//!
//! Of each hit the coordinate along its approach is what the touch said; the others are where the
//! program drove. A control that rounds to steps of `s` leaves whole steps between all touches in
//! one direction, wherever its work offset lies and whatever a macro adds for the tip. Hits that
//! are not rounded do so by chance: with three decimals printed one in `s / 0.001` each.

use umi_protocol::job::Approach;

use crate::units::Point;

/// Steps that are told apart, from the finest: of a metric control, and 0.0001, 0.0005 and
/// 0.001 inch.
const STEPS_MM: [f64; 13] = [
    0.0001, 0.0005, 0.001, 0.002, 0.002_54, 0.005, 0.01, 0.0127, 0.02, 0.025, 0.025_4, 0.05, 0.1,
];

/// The coarsest step with which a correction is within what is stated of it, mm.
pub const MOST_STEP_MM: f64 = 0.01;

/// So many touches must stand apart by whole steps: one of 20 µm, printed with three decimals, is
/// met by chance once in 20 to the power of it.
const LEAST_APART: u16 = 5;

/// The steps that touches have in common.
#[derive(Clone, Debug)]
pub struct Steps {
    /// One bit for each of [`STEPS_MM`].
    common: u16,
    /// The first touch along each axis, both ways: NaN where there was none.
    first_mm: [f64; 6],
    /// How many stood elsewhere than the first one of their direction.
    apart: u16,
}

impl Default for Steps {
    fn default() -> Self {
        Self {
            common: u16::MAX,
            first_mm: [f64::NAN; 6],
            apart: 0,
        }
    }
}

impl Steps {
    /// Of touches along these directions.
    pub fn of(touches: impl Iterator<Item = (Option<Approach>, Point)>) -> Self {
        let mut steps = Self::default();
        for (approach, position) in touches {
            let along = approach.map(Approach::axis_and_sign);
            for (axis, mm) in position.mm.iter().enumerate() {
                match along {
                    Some((of, sign)) if of == axis => {
                        steps.take(2 * axis + usize::from(sign < 0.0), *mm);
                    }
                    // What no line says, each of them may be.
                    None => steps.take(2 * axis, *mm),
                    Some(_) => {}
                }
            }
        }
        steps
    }

    /// Those of another feature of the setup as well.
    pub fn and(&mut self, other: &Self) {
        self.common &= other.common;
        self.apart = self.apart.saturating_add(other.apart);
        for (direction, mm) in other.first_mm.iter().enumerate() {
            if !mm.is_nan() {
                self.take(direction, *mm);
            }
        }
    }

    fn take(&mut self, direction: usize, mm: f64) {
        let Some(first) = self.first_mm.get_mut(direction) else {
            return;
        };
        if first.is_nan() {
            *first = mm;
            return;
        }
        let off_mm = libm::fabs(mm - *first);
        // Twelve digits hold a machine to a millionth of the finest step.
        self.apart += u16::from(off_mm > 1e-6);
        for (number, step_mm) in STEPS_MM.iter().enumerate() {
            let steps = off_mm / step_mm;
            let beside_mm = libm::fabs(steps - libm::round(steps)) * step_mm;
            // Steps of an inch that a control prints in millimetres are rounded once more.
            let is_inch = *step_mm == 0.0127 || *step_mm == 0.025_4;
            if beside_mm > if is_inch { 0.001_01 } else { 1e-5 } {
                self.common &= !(1 << number);
            }
        }
    }

    /// The coarsest of them, mm; 0 where there is none, or too little to tell.
    pub fn coarsest_mm(&self) -> f64 {
        let mut coarsest = STEPS_MM.iter().enumerate().rev();
        let coarsest = coarsest
            .find(|(number, _)| self.common & (1 << number) != 0)
            .filter(|_| self.apart >= LEAST_APART);
        coarsest.map_or(0.0, |(_, step_mm)| *step_mm)
    }
}

/// Whether the board refuses these touches of a setup's datum features, with the directions that
/// are known, because the control rounds to steps that are too coarse.
#[must_use]
pub fn is_coarse(touches: impl Iterator<Item = (Option<Approach>, Point)>) -> bool {
    Steps::of(touches).coarsest_mm() > MOST_STEP_MM
}
