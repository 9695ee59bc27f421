//! A centre, or all centres at an angle, that lies off all the rest.
//!
//! Each is left out alone. What its residuals `r` take from the sum of squares then is `rᵀ (1 - H)⁻¹ r`, with `H` its
//! block of the leverages; beside what is left, each by its degrees of freedom, that has an F distribution where it
//! belongs to the others (the externally studentised residual of Cook and Weisberg, Residuals and Influence in
//! Regression, 1982, section 2.2; for several rows together section 3.6). As many were tried as there are
//! (Bonferroni).

use std::collections::HashMap;

use nalgebra::{DMatrix, DVector};

use crate::calibrate::misfit::{ALARM, ROUNDING_MM, TAKEN, beyond_f};
use crate::calibrate::solve::Model;
use crate::calibrate::solve::scatter::whiten;

/// What lies off the others.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Stray {
    /// The numbers of the observations: one, or two that hide each other.
    pub numbers: Vec<usize>,
    /// Standard deviation of a residual of the others, in mm.
    pub others_mm: f64,
    /// The chance that the worst of so many lies so far off where all belong together.
    pub p: f64,
}

/// Which residuals belong to which observation, and how many it has.
pub(super) struct Observed<'a> {
    /// The number of the observation, by the residual's place.
    pub of: &'a dyn Fn(usize) -> usize,
    /// How many residuals it has, by its number.
    pub residuals: &'a dyn Fn(usize) -> usize,
}

/// What fewer degrees of freedom say of the others' scatter is mostly chance.
const LEAST_DOF: usize = 5;
/// Up to so many observations are left out by twos, too.
const MOST_FOR_PAIRS: usize = 64;

/// A residual and its whitened row.
type WhiteRow = (f64, DVector<f64>);

/// Observations that were left out together.
struct LeftOut {
    /// What that takes from the sum of squares, in mm².
    gain_mm2: f64,
    numbers: Vec<usize>,
    /// How many residuals they have.
    rows: usize,
}

/// Looks for an observation that lies off the others, at the model's optimum; among few for two, which widen the scatter
/// that each is held against. None where they belong together, or where leaving them out leaves nothing to hold them
/// against.
pub(super) fn stray<M: Model>(model: &M, observed: &Observed<'_>) -> Option<Stray> {
    let (nuisances, targets) = model.unknowns();
    let whiten = whiten(model);
    let dof = model.residuals().checked_sub(whiten.nrows())?;
    let mut line = DVector::zeros(nuisances + targets);
    let mut begun: HashMap<usize, Vec<WhiteRow>> = HashMap::new();
    let mut few: Vec<(usize, Vec<WhiteRow>)> = Vec::new();
    let mut worst: Vec<LeftOut> = Vec::new();
    let (mut ssq, mut place, mut singles) = (0.0, 0, 0);
    model.rows(&mut |value, derivatives| {
        line.fill(0.0);
        derivatives(line.as_mut_slice());
        let number = (observed.of)(place);
        let rows = begun.entry(number).or_default();
        rows.push((value, &whiten * &line));
        ssq += value * value;
        place += 1;
        if rows.len() < (observed.residuals)(number) {
            return;
        }
        singles += 1;
        if let Some(rows) = begun.remove(&number) {
            keep_worst(&mut worst, vec![number], &rows);
            if singles <= MOST_FOR_PAIRS {
                few.push((number, rows));
            }
        }
    });
    let mut pairs = 0;
    if singles <= MOST_FOR_PAIRS {
        for (place, (number, rows)) in few.iter().enumerate() {
            for (other, more) in &few[..place] {
                pairs += 1;
                keep_worst(
                    &mut worst,
                    vec![*other, *number],
                    &[&more[..], rows].concat(),
                );
            }
        }
    }
    let judged = worst.into_iter().filter_map(|out| {
        let rows = out.rows;
        let dof = dof.checked_sub(rows).filter(|dof| *dof >= LEAST_DOF)? as f64;
        let tried = if out.numbers.len() > 1 {
            pairs
        } else {
            singles
        };
        // Rounding scatters by no law.
        let others_mm = ((ssq - out.gain_mm2).max(0.0) / dof)
            .sqrt()
            .max(ROUNDING_MM);
        let f = out.gain_mm2 / rows as f64 / (others_mm * others_mm);
        Some(Stray {
            numbers: out.numbers,
            p: beyond_f(f, rows as f64, dof) * f64::from(tried as u32),
            others_mm,
        })
    });
    let judged: Vec<Stray> = judged.filter(|found| found.p < ALARM).collect();
    // Who lies off alone takes any other with it: two are told only where none does alone.
    let alone = judged.iter().any(|found| found.numbers.len() == 1);
    let told = judged
        .into_iter()
        .filter(|found| !alone || found.numbers.len() == 1);
    told.min_by(|a, b| a.p.total_cmp(&b.p))
}

/// Leaves these out, and keeps the worst of each size: a gain by more residuals is less odd.
fn keep_worst(worst: &mut Vec<LeftOut>, numbers: Vec<usize>, rows: &[WhiteRow]) {
    let Some(gain_mm2) = gain_mm2(rows) else {
        return;
    };
    let size = |known: &LeftOut| (known.numbers.len(), known.rows);
    let found = LeftOut {
        gain_mm2,
        numbers,
        rows: rows.len(),
    };
    match worst.iter_mut().find(|known| size(known) == size(&found)) {
        Some(known) if known.gain_mm2 < gain_mm2 => *known = found,
        Some(_) => {}
        None => worst.push(found),
    }
}

/// What observations take from the sum of squares where they are left out. None where they alone decide an unknown, and
/// cannot be off.
fn gain_mm2(rows: &[WhiteRow]) -> Option<f64> {
    let own = DMatrix::from_columns(&rows.iter().map(|(_, row)| row.clone()).collect::<Vec<_>>());
    let residuals = DVector::from_iterator(rows.len(), rows.iter().map(|(value, _)| *value));
    let left = DMatrix::identity(rows.len(), rows.len()) - own.tr_mul(&own);
    let left = left.cholesky()?;
    if left.l_dirty().diagonal().min() < TAKEN.sqrt() {
        return None;
    }
    Some(residuals.dot(&left.solve(&residuals)))
}
