//! Which directions of the targets are free, where noise hides it.
//!
//! What nothing sees has a singular value of 0, but only where the nuisances are what they truly are. A
//! plane that is square to an axis is found askew by what noise leaves open, and its tilt shows a
//! little of what it could not show. So the singular value of a direction is held against what the
//! unknowns' own uncertainty makes of it: each unknown that is seen is moved by its standard uncertainty,
//! and how much the direction changes the residuals thereby, beyond what the others could do as well, is
//! what noise lifts it to. A direction that is not clearly above that is free.

use nalgebra::{DMatrix, DVector};

use super::jacobi::Jacobi;
use super::{DEGENERATE, Model, Parts, UNSEEN_NUISANCE, pseudo_solve, reduce, scaled};

/// A direction that is better known than this, in mm (or turns worth that), is not in question.
const KNOWN_MM: f64 = 0.1;
/// Noise lifts a direction to this many of its own standard deviations at most: the optimum chooses among all
/// directions that lower the sum of squares, and their sum is a chi square of so many.
const MOST_LIFTED: f64 = 6.0;
/// How far unknowns are moved for second derivatives: residuals by so many mm, directions by so many.
const BY_RESIDUAL_MM: f64 = 1e-2;
const BY_DIRECTION_MM: f64 = 0.1;

/// The free directions in the targets' own units, by residuals that scatter by `sigma_mm`.
pub(super) fn free_directions<M: Model>(
    model: &M,
    scale: &[f64],
    sigma_mm: f64,
) -> Vec<DVector<f64>> {
    let parts = reduce(model).parts(scale);
    let values = &parts.svd.values;
    let none = parts.none(DEGENERATE);
    let mut free: Vec<usize> = (0..values.len())
        .filter(|&i| {
            let is_doubtful = values[i] < model.seen_share() * parts.svd.largest();
            values[i] <= none || is_doubtful && sigma_mm > KNOWN_MM * values[i]
        })
        .collect();
    // Without the best seen of them the others are judged anew: it says more of the nuisances.
    while free.iter().any(|&i| values[i] > none) {
        let lifts = lifts(model, &parts, scale, &free);
        let seen = free
            .iter()
            .zip(lifts)
            .position(|(&i, lift)| values[i] > none && values[i] > MOST_LIFTED * sigma_mm * lift);
        match seen {
            // The values fall: the first is the best seen.
            Some(place) => free.remove(place),
            None => break,
        };
    }
    free.iter()
        .map(|&i| scaled(parts.svd.v.column(i).into_owned(), scale))
        .collect()
}

/// What noise of 1 mm lifts the singular values of these directions to, root mean square.
fn lifts<M: Model>(model: &M, parts: &Parts, scale: &[f64], free: &[usize]) -> Vec<f64> {
    let Parts {
        f, norms, m, svd, ..
    } = parts;
    let (nuisances, targets) = (f.ncols(), m.ncols());
    // To the model's own unknowns, of a change of the nuisances' columns and the scaled targets'.
    let unknowns = |nuisance: &[f64], target: DVector<f64>| {
        let by = nuisance.iter().zip(norms).map(|(v, norm)| v / norm);
        let target = scaled(target, scale);
        let by = by.chain(target.iter().copied());
        DVector::from_iterator(nuisances + targets, by)
    };
    let seen: Vec<usize> = (0..targets).filter(|i| !free.contains(i)).collect();
    let to_seen = svd.v.select_columns(&seen);
    let mut columns = DMatrix::zeros(f.nrows(), nuisances + seen.len());
    columns.columns_mut(0, nuisances).copy_from(f);
    columns
        .columns_mut(nuisances, seen.len())
        .copy_from(&(m * &to_seen));
    let all = Jacobi::new(columns);
    let least = UNSEEN_NUISANCE * all.largest();
    // What is seen moved by its standard uncertainty, noise 1: each changes the residuals by 1 in all.
    let moved: Vec<(f64, DVector<f64>)> = (all.values.iter().enumerate())
        .filter(|(_, value)| **value > least)
        .map(|(k, value)| {
            let by = all.v.column(k) / *value;
            let target = &to_seen * by.rows(nuisances, seen.len());
            let step = BY_RESIDUAL_MM.min(BY_DIRECTION_MM / target.norm().max(1e-300));
            (step, unknowns(&by.as_slice()[..nuisances], target))
        })
        .collect();
    let residuals = |step: DVector<f64>| {
        let mut moved = model.clone();
        moved.step(step.as_slice());
        let mut values = Vec::with_capacity(model.residuals());
        moved.rows(&mut |value, _| values.push(value));
        DVector::from_vec(values)
    };
    let tangents: Vec<DVector<f64>> = (moved.iter())
        .map(|(h, by)| (residuals(by * *h) - residuals(by * -*h)) / (2.0 * h))
        .collect();
    free.iter()
        .map(|&i| {
            let target = svd.v.column(i).into_owned();
            let answer = pseudo_solve(f, &-(m * &target));
            let along = unknowns(answer.as_slice(), target) * BY_DIRECTION_MM;
            let squares = moved.iter().map(|(h, by)| {
                let bent =
                    |a: f64| residuals(by * (a * h) + &along) - residuals(by * (a * h) - &along);
                let mut change = (bent(1.0) - bent(-1.0)) / (4.0 * h * BY_DIRECTION_MM);
                // Twice: what the unknowns that are seen can do as well may be far the greater part.
                for _ in 0..2 {
                    for tangent in &tangents {
                        change.axpy(-tangent.dot(&change) / tangent.norm_squared(), tangent, 1.0);
                    }
                }
                change.norm_squared()
            });
            squares.sum::<f64>().sqrt()
        })
        .collect()
}
