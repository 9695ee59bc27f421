//! The order of the passes, which way round and by which branch of the axes each is driven: little way in the machine's own
//! axes.
//!
//! Few passes are ordered exactly (Held and Karp's programming over subsets); for many, tours from several beginnings are
//! improved by turning stretches round, moving them, and driving passes otherwise.

use super::super::spec::ScanSpec;
use super::deadline::Deadline;
use super::price::{LinkEnd, RAPID_MM_PER_S, price, seconds, tip};
use super::realise::Pass;

pub use super::winding::wound;

/// Pairs of passes looked at from all starts together.
const MOST_PAIRS: usize = 4_000_000;

/// Improvements tried before the order is taken as it is.
const MOST_ROUNDS: usize = 60;

/// The same where an order is only judged by.
const ROUGH_ROUNDS: usize = 3;

/// Steps of the exact order at most.
const MOST_EXACT: usize = 20_000_000;

/// How a pass may be driven: by which of its ways, and whether backwards.
type Sense = (usize, bool);

/// A pass and how it is driven: the number of one of its senses.
#[derive(Clone, Copy)]
struct Visit {
    pass: usize,
    sense: usize,
}

/// What every link costs.
struct Links {
    /// All senses of each pass: backwards beside forwards.
    senses: Vec<Vec<Sense>>,
    /// The first of each pass among all.
    first: Vec<usize>,
    /// Of every pair of senses; empty where there are too many.
    cost: Vec<f64>,
    all: usize,
    ends: Vec<[LinkEnd; 2]>,
    /// Axes that a pass may be shifted along by whole turns.
    winds: Vec<bool>,
}

/// Senses whose links are all reckoned beforehand, at most.
const MOST_KEPT: usize = 3000;

impl Links {
    fn new(spec: &ScanSpec, ways: &[&[Pass]]) -> Self {
        let limits = spec.machine.limits();
        let mut first = Vec::with_capacity(ways.len());
        let mut all = 0;
        let senses: Vec<Vec<Sense>> = ways
            .iter()
            .map(|w| {
                first.push(all);
                all += 2 * w.len();
                (0..2 * w.len()).map(|k| (k / 2, k % 2 == 1)).collect()
            })
            .collect();
        let ends: Vec<[LinkEnd; 2]> = ways
            .iter()
            .flat_map(|passes| passes.iter())
            .flat_map(|pass| {
                let end = |k: usize| LinkEnd {
                    axes: pass.axes[k].clone(),
                    point: tip(spec, pass, k),
                };
                let (begin, end) = (end(0), end(pass.axes.len() - 1));
                [[begin.clone(), end.clone()], [end, begin]]
            })
            .collect();
        let winds: Vec<bool> = limits[3..].iter().map(|l| l[1] - l[0] >= 540.0).collect();
        let mut cost = Vec::new();
        if all <= MOST_KEPT {
            for [_, left] in &ends {
                cost.extend(ends.iter().map(|[entered, _]| price(left, entered, &winds)));
            }
        }
        Self {
            senses,
            first,
            cost,
            all,
            ends,
            winds,
        }
    }

    fn cost(&self, a: Visit, b: Visit) -> f64 {
        let place = |v: Visit| self.first[v.pass] + v.sense;
        let (a, b) = (place(a), place(b));
        match self.cost.get(a * self.all + b) {
            Some(cost) => *cost,
            None => price(&self.ends[a][1], &self.ends[b][0], &self.winds),
        }
    }

    fn total(&self, tour: &[Visit]) -> f64 {
        tour.windows(2).map(|w| self.cost(w[0], w[1])).sum()
    }

    fn around(&self, before: Option<&Visit>, from: Visit, to: Visit, after: Option<&Visit>) -> f64 {
        before.map_or(0.0, |b| self.cost(*b, from)) + after.map_or(0.0, |a| self.cost(to, *a))
    }

    /// The cheapest tour of all.
    fn exact(&self) -> Vec<Visit> {
        let (count, all) = (self.senses.len(), self.all);
        let visits: Vec<Visit> = (0..count)
            .flat_map(|pass| (0..self.senses[pass].len()).map(move |sense| Visit { pass, sense }))
            .collect();
        let mut least = vec![f64::INFINITY; (1 << count) * all];
        let mut from = vec![u16::MAX; (1 << count) * all];
        for (k, v) in visits.iter().enumerate() {
            least[(1 << v.pass) * all + k] = 0.0;
        }
        for set in 1_usize..1 << count {
            for (k, last) in visits.iter().enumerate() {
                let here = least[set * all + k];
                if set >> last.pass & 1 == 0 || here == f64::INFINITY {
                    continue;
                }
                for (j, next) in visits.iter().enumerate() {
                    if set >> next.pass & 1 == 1 {
                        continue;
                    }
                    let place = (set | 1 << next.pass) * all + j;
                    let cost = here + self.cost[k * all + j];
                    if cost < least[place] {
                        least[place] = cost;
                        from[place] = k as u16;
                    }
                }
            }
        }
        let mut set = (1 << count) - 1;
        let end = (0..all).min_by(|a, b| least[set * all + a].total_cmp(&least[set * all + b]));
        let mut tour = Vec::with_capacity(count);
        let mut at = end;
        while let Some(k) = at {
            tour.push(visits[k]);
            let before = from[set * all + k];
            set &= !(1 << visits[k].pass);
            at = (before != u16::MAX).then_some(usize::from(before));
        }
        tour.reverse();
        tour
    }

    /// From one pass to the nearest of the others, again and again.
    fn greedy(&self, start: Visit) -> Vec<Visit> {
        let mut left: Vec<usize> = (0..self.senses.len())
            .filter(|k| *k != start.pass)
            .collect();
        let mut tour = vec![start];
        let mut here = start;
        while !left.is_empty() {
            let choice = (0..left.len())
                .flat_map(|k| {
                    let pass = left[k];
                    (0..self.senses[pass].len()).map(move |sense| (k, Visit { pass, sense }))
                })
                .min_by(|a, b| self.cost(here, a.1).total_cmp(&self.cost(here, b.1)));
            let Some((k, next)) = choice else { break };
            left.swap_remove(k);
            tour.push(next);
            here = next;
        }
        tour
    }

    /// Improves a tour as long as that helps.
    fn improve(&self, tour: &mut Vec<Visit>, rounds: usize, deadline: Deadline) {
        let count = tour.len();
        let turned = |v: Visit| Visit {
            sense: v.sense ^ 1,
            ..v
        };
        for _ in 0..rounds {
            let mut better = false;
            for i in 0..count {
                if i % 64 == 0 && !deadline.more() {
                    return;
                }
                // Driven otherwise.
                for sense in 0..self.senses[tour[i].pass].len() {
                    let other = Visit { sense, ..tour[i] };
                    let (before, after) = (i.checked_sub(1).map(|k| &tour[k]), tour.get(i + 1));
                    if self.around(before, other, other, after)
                        < self.around(before, tour[i], tour[i], after) - 1e-6
                    {
                        tour[i] = other;
                        better = true;
                    }
                }
                // Stretches turned round.
                for j in i..count {
                    let (before, after) = (i.checked_sub(1).map(|k| &tour[k]), tour.get(j + 1));
                    let now = self.around(before, tour[i], tour[j], after);
                    let then = self.around(before, turned(tour[j]), turned(tour[i]), after);
                    // Within the stretch, links are gone the other way: as long.
                    if then < now - 1e-6 {
                        tour[i..=j].reverse();
                        for visit in &mut tour[i..=j] {
                            *visit = turned(*visit);
                        }
                        better = true;
                    }
                }
            }
            better |= self.shift(tour, deadline);
            if !better {
                return;
            }
        }
    }

    /// Moves short stretches to another place, either way round; whether that helped.
    fn shift(&self, tour: &mut Vec<Visit>, deadline: Deadline) -> bool {
        let count = tour.len();
        let mut better = false;
        for length in 1..=3.min(count - 1) {
            for i in 0..=count - length {
                if i % 64 == 0 && !deadline.more() {
                    return better;
                }
                let stretch: Vec<Visit> = tour[i..i + length].to_vec();
                let mut rest = tour.clone();
                rest.drain(i..i + length);
                let (from, to) = (stretch[0], stretch[length - 1]);
                let join = |k: usize| -> f64 {
                    match (k.checked_sub(1).map(|k| rest[k]), rest.get(k)) {
                        (Some(a), Some(b)) => self.cost(a, *b),
                        _ => 0.0,
                    }
                };
                let before = i.checked_sub(1).map(|k| &rest[k]);
                let gained = self.around(before, from, to, rest.get(i)) - join(i);
                let mut best: Option<(f64, usize, bool)> = None;
                for k in 0..=rest.len() {
                    let before = k.checked_sub(1).map(|k| &rest[k]);
                    for back in [false, true] {
                        let flip = |v: Visit| Visit {
                            sense: v.sense ^ 1,
                            ..v
                        };
                        let (a, b) = if back {
                            (flip(to), flip(from))
                        } else {
                            (from, to)
                        };
                        let cost = self.around(before, a, b, rest.get(k)) - join(k);
                        if best.is_none_or(|(least, ..)| cost < least) {
                            best = Some((cost, k, back));
                        }
                    }
                }
                if let Some((cost, k, back)) = best
                    && cost < gained - 1e-6
                {
                    let mut stretch = stretch;
                    if back {
                        stretch.reverse();
                        for visit in &mut stretch {
                            visit.sense ^= 1;
                        }
                    }
                    rest.splice(k..k, stretch);
                    *tour = rest;
                    better = true;
                }
            }
        }
        better
    }
}

/// Passes in their order, each with all ways to drive it.
pub type Tour = Vec<Vec<Pass>>;

/// Orders the passes, whatever the way and the sense each is driven by; once it is late, they stay as they are.
pub fn order(spec: &ScanSpec, ways: Vec<Vec<Pass>>, deadline: Deadline) -> Tour {
    let count = ways.len();
    let slices: Vec<&[Pass]> = ways.iter().map(Vec::as_slice).collect();
    let links = Links::new(spec, &slices);
    let tour = match count {
        0 | 1 => (0..count).map(|pass| Visit { pass, sense: 0 }).collect(),
        _ if count < 20 && (links.all * links.all) << count <= MOST_EXACT => links.exact(),
        _ => {
            let rounds = if count > 200 { 2 } else { MOST_ROUNDS };
            let starts = (MOST_PAIRS / (links.all * links.all)).clamp(1, 24);
            let mut best: Option<(f64, Vec<Visit>)> = None;
            for start in 0..count.min(starts) {
                // Beginnings from all over the part.
                let pass = start * count / count.min(starts);
                for sense in [0, 1] {
                    let mut tour = links.greedy(Visit { pass, sense });
                    links.improve(&mut tour, rounds, deadline);
                    let total = links.total(&tour);
                    if best.as_ref().is_none_or(|(least, _)| total < *least - 1e-6) {
                        best = Some((total, tour));
                    }
                    if !deadline.more() {
                        break;
                    }
                }
            }
            best.map(|(_, tour)| tour).unwrap_or_default()
        }
    };
    let mut ways: Vec<Option<Vec<Pass>>> = ways.into_iter().map(Some).collect();
    tour.iter().filter_map(|v| ways[v.pass].take()).collect()
}

/// Feed with the laser on beside which turning is slow, mm/s.
pub const FEED_MM_PER_S: f64 = 10.0;

/// Seconds that the laser point waits for the axes, about: the links between passes in a short order of them, and turns
/// within passes that take longer than the way beside them.
pub fn idle_s(spec: &ScanSpec, passes: &[&Pass], deadline: Deadline) -> f64 {
    let waits = |pass: &&Pass| -> f64 {
        let steps = 1..pass.axes.len();
        steps
            .map(|k| {
                let way = (tip(spec, pass, k) - tip(spec, pass, k - 1)).norm();
                let moved = seconds(&pass.axes[k - 1], &pass.axes[k], RAPID_MM_PER_S);
                (moved - way / FEED_MM_PER_S).max(0.0)
            })
            .sum()
    };
    links_s(spec, passes, deadline) + passes.iter().map(waits).sum::<f64>()
}

fn links_s(spec: &ScanSpec, passes: &[&Pass], deadline: Deadline) -> f64 {
    let links = Links::new(
        spec,
        &passes
            .iter()
            .map(|p| std::slice::from_ref(*p))
            .collect::<Vec<_>>(),
    );
    let mut least = f64::INFINITY;
    for pass in [0, passes.len().saturating_sub(1)] {
        for sense in 0..links.senses.get(pass).map_or(0, Vec::len) {
            let mut tour = links.greedy(Visit { pass, sense });
            links.improve(&mut tour, ROUGH_ROUNDS, deadline);
            least = least.min(links.total(&tour));
        }
    }
    if least.is_finite() { least } else { 0.0 }
}
