//! One observation that lies off all the rest: an angle that was written down wrong, a sample of a reflection.
//!
//! Each is left out alone. What its residuals `r` take from the sum of squares then is `rᵀ (1 - H)⁻¹ r`, with `H` its
//! block of the leverages; beside what is left, each by its degrees of freedom, that has an F distribution where it
//! belongs to the others (the externally studentised residual of Cook and Weisberg, Residuals and Influence in
//! Regression, 1982, section 2.2; for several rows together section 3.6). As many were tried as there are
//! (Bonferroni).

use std::collections::HashMap;

use nalgebra::{DMatrix, DVector};

use super::{ALARM, ROUNDING_MM, TAKEN, beyond_f};
use crate::calibrate::solve::Model;
use crate::calibrate::solve::scatter::whiten;

/// What lies off the others.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::calibrate) struct Stray {
    /// Its number.
    pub number: usize,
    /// What the others say less what it says, in mm, for each of its residuals.
    pub off_mm: DVector<f64>,
    /// Standard deviation of a residual of the others, in mm.
    pub others_mm: f64,
    /// The chance that the worst of so many lies so far off where all belong together.
    pub p: f64,
}

/// Which residuals belong to which observation, and how many it has.
pub(in crate::calibrate) struct Observed<'a> {
    /// The number of the observation, by the residual's place.
    pub of: &'a dyn Fn(usize) -> usize,
    /// How many residuals it has, by its number.
    pub residuals: &'a dyn Fn(usize) -> usize,
}

/// Looks for an observation that lies off the others, at the model's optimum. None where they belong together, or where
/// leaving one out leaves nothing to hold it against.
pub(in crate::calibrate) fn stray<M: Model>(model: &M, observed: &Observed<'_>) -> Option<Stray> {
    let (nuisances, targets) = model.unknowns();
    let whiten = whiten(model);
    let dof = model.residuals().checked_sub(whiten.nrows())?;
    let mut line = DVector::zeros(nuisances + targets);
    let mut begun: HashMap<usize, Vec<(f64, DVector<f64>)>> = HashMap::new();
    let mut all: Vec<(f64, usize, DVector<f64>)> = Vec::new();
    let (mut ssq, mut place, mut tried) = (0.0, 0, 0.0);
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
        tried += 1.0;
        if let Some((gain, off)) = begun.remove(&number).and_then(|rows| left_out(&rows)) {
            // The worst of each size: a gain by more residuals is less odd.
            match all.iter_mut().find(|(.., known)| known.len() == off.len()) {
                Some(worst) if worst.0 < gain => *worst = (gain, number, off),
                Some(_) => {}
                None => all.push((gain, number, off)),
            }
        }
    });
    let judged = all.into_iter().filter_map(|(gain, number, off_mm)| {
        let rows = off_mm.len();
        let dof = dof.checked_sub(rows).filter(|dof| *dof > 0)? as f64;
        // Rounding scatters by no law.
        let others_mm = ((ssq - gain).max(0.0) / dof).sqrt().max(ROUNDING_MM);
        let f = gain / rows as f64 / (others_mm * others_mm);
        Some(Stray {
            number,
            p: beyond_f(f, rows as f64, dof) * tried,
            off_mm,
            others_mm,
        })
    });
    let worst = judged.min_by(|a, b| a.p.total_cmp(&b.p));
    worst.filter(|worst| worst.p < ALARM)
}

/// What an observation takes from the sum of squares where it is left out, and what it is off by then. None where it
/// alone decides an unknown, and cannot be off.
fn left_out(rows: &[(f64, DVector<f64>)]) -> Option<(f64, DVector<f64>)> {
    let own = DMatrix::from_columns(&rows.iter().map(|(_, row)| row.clone()).collect::<Vec<_>>());
    let residuals = DVector::from_iterator(rows.len(), rows.iter().map(|(value, _)| *value));
    let left = DMatrix::identity(rows.len(), rows.len()) - own.tr_mul(&own);
    let left = left.cholesky()?;
    if left.l_dirty().diagonal().min() < TAKEN.sqrt() {
        return None;
    }
    let off = left.solve(&residuals);
    Some((residuals.dot(&off), off))
}
