//! The order of the passes, and which way round each is driven: little way in the machine's own axes.

use super::super::spec::ScanSpec;
use super::realise::Pass;

/// Rapid feed that times are reckoned with, mm/s.
pub const RAPID_MM_PER_S: f64 = 100.0;
/// Speed of rotary axes that times are reckoned with, degrees/s.
pub const TURN_DEG_PER_S: f64 = 30.0;

/// Improvements tried before the order is taken as it is.
const MOST_ROUNDS: usize = 200;

/// Time of a straight way of all axes together, in seconds.
pub fn seconds(a: &[f64], b: &[f64], mm_per_s: f64) -> f64 {
    let way = (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f64>().sqrt();
    let turn = a[3..]
        .iter()
        .zip(&b[3..])
        .map(|(x, y)| (x - y).abs())
        .fold(0.0, f64::max);
    (way / mm_per_s).max(turn / TURN_DEG_PER_S)
}

/// Orders the passes and turns some round.
pub fn order(spec: &ScanSpec, passes: Vec<Pass>) -> Vec<Pass> {
    let count = passes.len();
    if count < 2 {
        return passes;
    }
    let ends: Vec<[&[f64]; 2]> = passes
        .iter()
        .filter_map(|p| Some([p.axes.first()?.as_slice(), p.axes.last()?.as_slice()]))
        .collect();
    // From the leaving end of one to the entering end of the next; sense true is backwards.
    let cost = |a: (usize, bool), b: (usize, bool)| {
        seconds(
            ends[a.0][usize::from(!a.1)],
            ends[b.0][usize::from(b.1)],
            RAPID_MM_PER_S,
        )
    };
    let total = |tour: &[(usize, bool)]| tour.windows(2).map(|w| cost(w[0], w[1])).sum::<f64>();
    let mut best: Vec<(usize, bool)> = Vec::new();
    let mut least = f64::INFINITY;
    for start in 0..count.min(24) {
        for sense in [false, true] {
            let mut left: Vec<usize> = (0..count).filter(|k| *k != start).collect();
            let mut tour = vec![(start, sense)];
            while !left.is_empty() {
                let here = tour[tour.len() - 1];
                let choice = (0..left.len())
                    .flat_map(|k| [(k, false), (k, true)])
                    .min_by(|a, b| {
                        cost(here, (left[a.0], a.1)).total_cmp(&cost(here, (left[b.0], b.1)))
                    });
                let Some((k, sense)) = choice else { break };
                tour.push((left.swap_remove(k), sense));
            }
            let length = total(&tour);
            if length < least {
                (best, least) = (tour, length);
            }
        }
    }
    // Stretches are turned round as long as that helps.
    let rounds = if count > 200 { 2 } else { MOST_ROUNDS };
    for _ in 0..rounds {
        let mut better = false;
        for i in 0..count {
            for j in i..count {
                let turned = |k: usize| (best[k].0, !best[k].1);
                let before = if i > 0 {
                    cost(best[i - 1], best[i])
                } else {
                    0.0
                } + if j + 1 < count {
                    cost(best[j], best[j + 1])
                } else {
                    0.0
                };
                let after = if i > 0 {
                    cost(best[i - 1], turned(j))
                } else {
                    0.0
                } + if j + 1 < count {
                    cost(turned(i), best[j + 1])
                } else {
                    0.0
                };
                if after < before - 1e-9 {
                    best[i..=j].reverse();
                    for step in &mut best[i..=j] {
                        step.1 = !step.1;
                    }
                    better = true;
                }
            }
        }
        if !better {
            break;
        }
    }
    let mut passes: Vec<Option<Pass>> = passes.into_iter().map(Some).collect();
    let mut ordered: Vec<Pass> = Vec::with_capacity(count);
    for (k, backwards) in best {
        if let Some(mut pass) = passes[k].take() {
            if backwards {
                pass.reverse();
            }
            if let Some(before) = ordered.last() {
                nearest_turns(spec, &mut pass, before);
            }
            ordered.push(pass);
        }
    }
    ordered
}

/// Shifts each rotary axis of a pass by whole turns towards where the one before left it.
fn nearest_turns(spec: &ScanSpec, pass: &mut Pass, before: &Pass) {
    let limits = spec.machine.limits();
    let Some(left) = before.axes.last() else {
        return;
    };
    for k in 3..limits.len() {
        let d = ((left[k] - pass.axes[0][k]) / 360.0).round();
        if d == 0.0 {
            continue;
        }
        let shift = d.signum() * 360.0;
        let inside = |by: f64| {
            pass.axes
                .iter()
                .all(|a| a[k] + by >= limits[k][0] && a[k] + by <= limits[k][1])
        };
        let by = if inside(d * 360.0) {
            d * 360.0
        } else if inside(shift) {
            shift
        } else {
            continue;
        };
        for axes in &mut pass.axes {
            axes[k] = super::axes::rounded(axes[k] + by);
        }
        for (pose, axes) in pass.poses.iter_mut().zip(&pass.axes) {
            *pose = spec.machine.forward(axes);
        }
    }
}
