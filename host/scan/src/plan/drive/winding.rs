//! Passes in a given order: by which of its ways each is driven, which way round, and with how many whole turns of its axes.

use super::super::spec::ScanSpec;
use super::axes::rounded;
use super::price::{LinkEnd, price, tip};
use super::realise::Pass;

/// A way to drive a pass: forwards or backwards, with its rotary axes so many whole turns on.
struct Turned {
    way: usize,
    backwards: bool,
    turns: Vec<f64>,
    /// Where it is entered and left.
    ends: [LinkEnd; 2],
}

/// Whole turns that are looked at to either side.
const MOST_TURNS: i32 = 2;

/// Ways of a pass that are looked at together, at most.
const MOST_TURNED: usize = 96;

/// All ways of a pass with every whole turn that its axes' limits leave.
fn turned_ways(spec: &ScanSpec, ways: &[Pass]) -> Vec<Turned> {
    let limits = spec.machine.limits();
    let mut all = Vec::new();
    for (way, pass) in ways.iter().enumerate() {
        let mut sets = vec![Vec::new()];
        for (k, [low, high]) in limits.iter().enumerate().skip(3) {
            let (least, most) = pass
                .axes
                .iter()
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), a| {
                    (l.min(a[k]), h.max(a[k]))
                });
            let inside: Vec<f64> = (-MOST_TURNS..=MOST_TURNS)
                .map(|n| 360.0 * f64::from(n))
                .filter(|by| *by == 0.0 || (least + by >= *low && most + by <= *high))
                .collect();
            let with = |set: &Vec<f64>| {
                let set = set.clone();
                inside
                    .clone()
                    .into_iter()
                    .map(move |by| [&set[..], &[by]].concat())
            };
            sets = sets.iter().flat_map(with).collect();
        }
        for turns in sets {
            let end = |k: usize| {
                let mut axes = pass.axes[k].clone();
                for (v, by) in axes[3..].iter_mut().zip(&turns) {
                    *v += by;
                }
                LinkEnd {
                    axes,
                    point: tip(spec, pass, k),
                }
            };
            for backwards in [false, true] {
                let mut ends = [end(0), end(pass.axes.len() - 1)];
                if backwards {
                    ends.reverse();
                }
                all.push(Turned {
                    way,
                    backwards,
                    turns: turns.clone(),
                    ends,
                });
            }
        }
    }
    // Those of few turns first: what is beyond the most is left out.
    all.sort_by_key(|t| t.turns.iter().map(|by| by.abs() as u64).sum::<u64>());
    all.truncate(MOST_TURNED.max(2 * ways.len()));
    all
}

/// The passes in the tour's order, each by that of its ways, that sense and those whole turns with which all links together
/// cost the least. An order is sought as if an axis that turns on and on were always the shorter way round; here its limits
/// count. `end_serves`: may the path begin and end at such axis values? Where it can, it begins and ends at those.
pub fn wound(
    spec: &ScanSpec,
    tour: &[Vec<Pass>],
    end_serves: impl Fn(&[f64]) -> bool,
) -> Vec<Pass> {
    let stages: Vec<Vec<Turned>> = tour.iter().map(|ways| turned_ways(spec, ways)).collect();
    let serves = |end: &LinkEnd| if end_serves(&end.axes) { 0.0 } else { NO_END_S };
    // Of each way of each stage: the least cost up to it, and the way before.
    let mut costs: Vec<Vec<(f64, usize)>> = Vec::with_capacity(stages.len());
    for (k, stage) in stages.iter().enumerate() {
        let here = stage.iter().map(|to| {
            let last = k + 1 == stages.len();
            let leaving = if last { serves(&to.ends[1]) } else { 0.0 };
            // From where the axes stand near zero, where nothing else decides.
            let far: f64 = to.ends[0].axes[3..].iter().map(|a| a.abs()).sum();
            let Some(before) = k.checked_sub(1) else {
                return (NEAR_ZERO * far + serves(&to.ends[0]) + leaving, 0);
            };
            let pairs = stages[before].iter().zip(&costs[before]).enumerate();
            pairs
                .map(|(j, (from, (cost, _)))| {
                    let link = price(&from.ends[1], &to.ends[0], &[]);
                    (cost + link + leaving, j)
                })
                .fold((f64::INFINITY, 0), |best, found| {
                    // The first of those that are as good but for rounding.
                    if found.0 < best.0 - 1e-9 { found } else { best }
                })
        });
        let here = here.collect();
        costs.push(here);
    }
    let mut chosen = Vec::with_capacity(stages.len());
    let mut at = None;
    for (stage, costs) in stages.iter().zip(&costs).rev() {
        let k = at.unwrap_or_else(|| {
            (0..stage.len())
                .min_by(|a, b| costs[*a].0.total_cmp(&costs[*b].0))
                .unwrap_or(0)
        });
        chosen.push(&stage[k]);
        at = Some(costs[k].1);
    }
    chosen.reverse();
    let driven = |(ways, turned): (&Vec<Pass>, &&Turned)| {
        let mut pass = ways[turned.way].clone();
        if turned.backwards {
            pass.reverse();
        }
        if turned.turns.iter().any(|by| *by != 0.0) {
            for axes in &mut pass.axes {
                for (v, by) in axes[3..].iter_mut().zip(&turned.turns) {
                    *v = rounded(*v + by);
                }
            }
            for (pose, axes) in pass.poses.iter_mut().zip(&pass.axes) {
                *pose = spec.machine.forward(axes);
            }
        }
        pass
    };
    tour.iter().zip(&chosen).map(driven).collect()
}

/// Seconds that an end costs at which the path should not begin or end: more than any way around.
const NO_END_S: f64 = 1e5;

/// Seconds that a degree away from zero costs at the beginning: next to nothing.
const NEAR_ZERO: f64 = 1e-6;
