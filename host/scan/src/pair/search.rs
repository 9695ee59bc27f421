//! The shift of the clocks that explains most profiles: branch and bound, exact.
//!
//! # Design
//! A shift is an offset and a drift: a line from the sensor's clock to the board's. A box of
//! shifts has an upper bound: the profiles that some shift in it can bring within the jitter
//! of some latch. The boxes with the highest bound are split first. A box whose bound is too
//! low to matter is dropped, and so is one that holds nothing but pairs of the best shift so far. One that holds
//! nothing but lines about the best is split only while it may explain more than the best does.
//! What is left shrinks to nothing, so that the answer is the only best one, or a tie, or
//! (where [`MOST_STEPS`] are not enough) undecided.
//!
//! Two lines are the same shift where they stay within twice the jitter of each other over
//! the whole scan.
//!
//! # When a runner-up is a tie
//! Where one shift explains as many as another, none is the best. Faults make it worse: a
//! runner-up that is behind by no more than chance can bring (`margin`) is a tie, too.
//!
//! # Drift beyond the limit
//! A true shift just beyond the limit leaves a wrong one within it that explains many. So the search
//! goes beyond the limit as far as a line within it could still explain half of the scan ([`FARTHER`]).
//! Where the best shift lies there, the best within the limit is taken only if it is the same shift.

use std::collections::BinaryHeap;

use super::margin::margin;
use super::trains::{MOST_DRIFT, Trains, ends};

/// The most steps over profiles and latches of one search: some seconds.
const MOST_STEPS: u64 = 3_000_000_000;
/// The most boxes that wait to be split, 50 MB: trains that need more are too even to be decided.
const MOST_BOXES: usize = 1 << 20;
/// The most steps about the best shift, where another line may explain some profiles more: a line that leaves out
/// one at the edge of the jitter is no wrong one.
const MOST_NEAR_STEPS: u64 = 20_000_000;
/// With more profiles none are spent there: where times scatter beyond the jitter, the search of 20 000 did not end.
const MOST_NEAR_PROFILES: usize = 5_000;
/// Boxes this small, in microseconds, hold one shift for all practical purposes.
const SMALLEST_US: f64 = 0.01;
/// Lines within so many times the jitter of each other are the same shift.
const SAME_SHIFT: f64 = 2.0;
/// Profiles of a long scan that are looked at before all of them, at the fewest, and for each
/// profile that may stay unexplained.
const FEWEST_LOOKS: usize = 512;
const LOOKS_EACH: usize = 4;
/// A box that reaches no farther than so many times the jitter is looked at in full.
const FINE_BOX: f64 = 4.0;
/// With more latches than these about a profile its encoder says nothing of the box.
const CROWD: usize = 32;
/// How many first and last latches and profiles are tried for a first guess, at the fewest, and
/// how many steps all of them may take about.
const FIRST_GUESSES: usize = 12;
const GUESS_STEPS: f64 = 1.5e8;

/// How far beyond the drift's limit the search goes, in jitters over the length of the shorter stream.
/// Two lines whose drifts differ by more agree within the jitter over less than half of it, even where an
/// even train of eight jitters' interval meets the wrong latches in between.
const FARTHER: f64 = 8.0;
/// How many of a signature's times are tried for a first guess, at most, and how often its line is drawn anew.
const ODD_GUESSES: usize = 12;
const CLIMBS: usize = 8;

/// What a search says.
#[derive(Debug, Clone, PartialEq)]
pub enum SearchOutcome {
    /// The only best pairing: the latch of each profile.
    Only(Vec<Option<usize>>),
    /// The best shift drifts by more than the limit, as a ratio.
    Beyond {
        /// Its drift.
        drift: f64,
        /// How many profiles it explains.
        explained: usize,
    },
    /// Another shift explains as many, or nearly as many where there are faults.
    Tie {
        /// How many profiles the best explains.
        explained: usize,
        /// How many the other explains.
        runner_up: usize,
    },
    /// The best explains less than half of the shorter stream.
    NoMatch,
    /// Not decided in the steps and in [`MOST_BOXES`].
    Undecided,
}

/// Whether a shift explains as many profiles as asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reaches {
    /// One explains so many.
    Yes(usize),
    /// None does.
    No,
    /// Not known in so many steps.
    Undecided,
}

/// A box of shifts: offsets within `half_offset` of `offset`, drifts likewise.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Shifts {
    bound: usize,
    offset: f64,
    drift: f64,
    half_offset: f64,
    half_drift: f64,
}

impl Eq for Shifts {}

impl Ord for Shifts {
    /// The highest bound first, then the smallest box.
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        let size = |shifts: &Self| (shifts.half_offset, shifts.half_drift, shifts.offset);
        self.bound.cmp(&other.bound).then_with(|| {
            let (a, b) = (size(self), size(other));
            b.0.total_cmp(&a.0)
                .then(b.1.total_cmp(&a.1))
                .then(b.2.total_cmp(&a.2))
        })
    }
}

impl PartialOrd for Shifts {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

/// Finds the only best pairing.
pub fn search(trains: &Trains) -> SearchOutcome {
    search_in(trains, MOST_STEPS)
}

/// The same in so many steps.
pub fn search_in(trains: &Trains, most_steps: u64) -> SearchOutcome {
    let length = |times| {
        let (first, last) = ends(times);
        last - first
    };
    if !trains.could_pair() {
        return SearchOutcome::NoMatch;
    }
    let length_us = length(&trains.sensor).min(length(&trains.board));
    let farther = if length_us > 0.0 {
        (FARTHER * trains.jitter_us / length_us).min(MOST_DRIFT)
    } else {
        0.0
    };
    let (outcome, line) = search_within(&trains.within(trains.drift + farther), most_steps);
    let SearchOutcome::Only(found) = outcome else {
        return outcome;
    };
    if line.1.abs() <= trains.drift {
        return SearchOutcome::Only(found);
    }
    let beyond = SearchOutcome::Beyond {
        drift: line.1,
        explained: found.iter().flatten().count(),
    };
    // Of a short scan the line through the pairs is steep by their jitter alone.
    let (SearchOutcome::Only(held), held_line) = search_within(trains, most_steps) else {
        return beyond;
    };
    let is_same = held
        .iter()
        .zip(&found)
        .all(|(held, found)| held.is_none() || held == found)
        && apart_us(trains, line, held_line) <= trains.jitter_us;
    if is_same {
        SearchOutcome::Only(held)
    } else {
        beyond
    }
}

/// All that the line through these pairs explains (by profile, as they are); none where it gives one of them another latch.
pub fn about(trains: &Trains, found: &[Option<usize>]) -> Option<Vec<Option<usize>>> {
    let by_place: Vec<Option<usize>> = trains.order.iter().map(|&profile| found[profile]).collect();
    let line = trains.line(&by_place, (0.0, 0.0));
    let mut search = Search::new(trains, 0, u64::MAX);
    search.take(line.0, line.1);
    let mut whole = vec![None; trains.profiles()];
    for (place, latch) in search.best?.pairing.iter().enumerate() {
        whole[trains.order[place]] = *latch;
    }
    let kept = found.iter().zip(&whole);
    kept.into_iter()
        .all(|(found, whole)| found.is_none() || found == whole)
        .then_some(whole)
}

/// Finds the only best pairing among the drifts that the trains allow, and the line through it.
fn search_within(trains: &Trains, most_steps: u64) -> (SearchOutcome, (f64, f64)) {
    let mut search = Search::new(trains, 0, most_steps);
    let outcome = search.run();
    (outcome, search.best.map_or((0.0, 0.0), |best| best.line))
}

/// Whether any shift that the trains allow explains `least` profiles, in so many steps. The first that is found ends it.
pub fn reaches(trains: &Trains, least: usize, most_steps: u64) -> Reaches {
    if !trains.could_pair() {
        return Reaches::No;
    }
    let mut search = Search::new(trains, least, most_steps);
    search.guess();
    search.guess_odd();
    let decided = search.divide(Some(least));
    match &search.best {
        Some(best) if best.count >= least => Reaches::Yes(best.count),
        _ if decided => Reaches::No,
        _ => Reaches::Undecided,
    }
}

/// How far one line is from another over the scan, at most, in microseconds.
fn apart_us(trains: &Trains, a: (f64, f64), b: (f64, f64)) -> f64 {
    let at = |t: f64| ((a.0 - b.0) + (a.1 - b.1) * t).abs();
    let (first, last) = ends(&trains.sensor);
    at(first).max(at(last))
}

/// What a shift explains.
#[derive(Debug, Clone)]
struct Explained {
    /// The latch of each place.
    pairing: Vec<Option<usize>>,
    count: usize,
    /// How far another may be behind it and still be a tie.
    margin: usize,
    /// Offset and drift of the line through its pairs.
    line: (f64, f64),
}

struct Search<'a> {
    trains: &'a Trains,
    /// What explains fewer than these is not looked for.
    least: usize,
    most_steps: u64,
    steps: u64,
    /// Those of the steps about the best shift.
    near_steps: u64,
    best: Option<Explained>,
    /// The most that another shift explains.
    runner_up: usize,
    /// Encoder less counts, each with the place of its profile.
    differences: Vec<(i64, usize)>,
    /// How often each place is in the window of [`widest`].
    within: Vec<u32>,
}

impl<'a> Search<'a> {
    fn new(trains: &'a Trains, least: usize, most_steps: u64) -> Self {
        Self {
            trains,
            least,
            most_steps,
            steps: 0,
            near_steps: if trains.profiles() > MOST_NEAR_PROFILES {
                u64::MAX
            } else {
                0
            },
            best: None,
            runner_up: 0,
            differences: Vec::new(),
            within: vec![0; trains.profiles()],
        }
    }

    /// Splits boxes until none is left that matters, or one shift explains so many profiles. False: too many steps.
    fn divide(&mut self, enough: Option<usize>) -> bool {
        let trains = self.trains;
        let mut heap = BinaryHeap::new();
        heap.push(Shifts {
            bound: trains.profiles(),
            offset: 0.0,
            drift: 0.0,
            half_offset: trains.half_sensor() * (1.0 + trains.drift)
                + trains.half_board()
                + trains.jitter_us,
            half_drift: trains.drift,
        });
        while let Some(shifts) = heap.pop() {
            if shifts.bound < self.needed() {
                break;
            }
            let best = self.best.as_ref();
            if enough.is_some_and(|enough| best.is_some_and(|best| best.count >= enough)) {
                break;
            }
            if self.steps > self.most_steps || heap.len() > MOST_BOXES {
                return false;
            }
            if self.says_nothing_new(&shifts) {
                continue;
            }
            let (is_near, before) = (self.only_best(&shifts), self.steps);
            for mut half in self.split(&shifts) {
                let Some(bound) = self.bound(&half) else {
                    continue;
                };
                half.bound = bound;
                self.take(half.offset, half.drift);
                let reach = half.half_offset + half.half_drift * trains.half_sensor();
                if reach > SMALLEST_US && !self.says_nothing_new(&half) {
                    heap.push(half);
                }
            }
            if is_near {
                self.near_steps = self.near_steps.saturating_add(self.steps - before);
            }
        }
        true
    }

    fn run(&mut self) -> SearchOutcome {
        let trains = self.trains;
        self.guess();
        self.guess_odd();
        if !self.divide(None) {
            return SearchOutcome::Undecided;
        }
        let Some(best) = &self.best else {
            return SearchOutcome::NoMatch;
        };
        if 2 * best.count < self.shorter() {
            return SearchOutcome::NoMatch;
        }
        if self.runner_up > 0 && self.runner_up >= self.close(best) {
            return SearchOutcome::Tie {
                explained: best.count,
                runner_up: self.runner_up,
            };
        }
        let mut found = vec![None; trains.profiles()];
        for (place, latch) in best.pairing.iter().enumerate() {
            found[trains.order[place]] = *latch;
        }
        SearchOutcome::Only(found)
    }

    fn shorter(&self) -> usize {
        self.trains.shorter
    }

    /// What another shift must explain to be a tie with this best one.
    fn close(&self, best: &Explained) -> usize {
        best.count - best.margin
    }

    /// What a box must reach to matter: half of the shorter stream; a tie with the best, or,
    /// once there is a tie, more than the best.
    fn needed(&self) -> usize {
        let half = self.trains.need().max(self.least);
        let Some(best) = &self.best else {
            return half;
        };
        let close = self.close(best);
        half.max(if self.runner_up >= close {
            best.count + 1
        } else {
            close
        })
    }

    /// Tries the shifts that join the first profile to one of the first latches, or the first latch
    /// to one of the first profiles, and the same at the end: a good pairing early makes the search
    /// short, and one of both streams often begins or ends before the other.
    fn guess(&mut self) {
        let trains = self.trains;
        let (profiles, latches) = (trains.profiles(), trains.latches());
        if profiles == 0 || latches == 0 {
            return;
        }
        let many = (GUESS_STEPS / (profiles + latches) as f64).sqrt() / 2.0;
        let many = (many as usize).max(FIRST_GUESSES);
        let beside: Vec<(usize, usize)> = (0..latches.min(many))
            .map(|latch| (0, latch))
            .chain((1..profiles.min(many)).map(|profile| (profile, 0)))
            .collect();
        for &(first, begin) in &beside {
            for &(last, end) in &beside {
                let (last, end) = (profiles - 1 - last, latches - 1 - end);
                let (from, to) = (trains.sensor[first], trains.sensor[last]);
                let (a, b) = (trains.board[begin], trains.board[end]);
                let drift = if to > from {
                    (b - a) / (to - from) - 1.0
                } else {
                    0.0
                };
                if drift.abs() <= trains.drift {
                    self.take(a - (1.0 + drift) * from, drift);
                }
            }
        }
    }

    /// Tries the shifts that join a time of one signature to a time of the other. Only its neighbours fit at
    /// first; the line through them leads on to the others.
    fn guess_odd(&mut self) {
        let trains = self.trains;
        let each = (CLIMBS * (trains.profiles() + trains.latches())) as f64;
        let many = ((GUESS_STEPS / each).sqrt() as usize).clamp(2, ODD_GUESSES);
        for &profile in trains.odd.0.iter().take(many) {
            for &latch in trains.odd.1.iter().take(many) {
                let (sensor, board) = (trains.sensor[profile], trains.board[latch]);
                self.climb((board - sensor, 0.0), 2, CLIMBS);
            }
        }
    }

    /// Two halves, across the side that reaches farther; of a coarse box across the offset.
    fn split(&self, shifts: &Shifts) -> [Shifts; 2] {
        let mut halves = [*shifts; 2];
        let farther = shifts.half_drift * self.trains.half_sensor() > shifts.half_offset;
        if farther && !self.is_coarse(shifts) {
            let half = 0.5 * shifts.half_drift;
            for (half_box, sign) in halves.iter_mut().zip([-1.0, 1.0]) {
                half_box.half_drift = half;
                half_box.drift += sign * half;
            }
        } else {
            let half = 0.5 * shifts.half_offset;
            for (half_box, sign) in halves.iter_mut().zip([-1.0, 1.0]) {
                half_box.half_offset = half;
                half_box.offset += sign * half;
            }
        }
        halves
    }

    /// Whether the box is so wide that only a signature tells something of it.
    fn is_coarse(&self, shifts: &Shifts) -> bool {
        let odd = &self.trains.odd.0;
        !odd.is_empty() && shifts.half_offset > 2.0 * FINE_BOX * self.trains.jitter_us
    }

    /// Whether the box holds lines about the best shift alone, and none that explains more in so many steps.
    fn says_nothing_new(&self, shifts: &Shifts) -> bool {
        let best = self.best.as_ref().map_or(0, |best| best.count);
        (shifts.bound <= best || self.near_steps > MOST_NEAR_STEPS) && self.only_best(shifts)
    }

    /// Whether all shifts of the box are the same as the best so far.
    fn only_best(&self, shifts: &Shifts) -> bool {
        let reach = shifts.half_offset + shifts.half_drift * self.trains.half_sensor();
        self.best.as_ref().is_some_and(|best| {
            apart_us(self.trains, best.line, (shifts.offset, shifts.drift)) + reach
                <= SAME_SHIFT * self.trains.jitter_us
        })
    }

    /// How many profiles the shifts can explain at most; none if that is too few to matter, or if all they can give a
    /// profile is the latch that the best shift gives it: lines about the best one that leave out some of its pairs, as
    /// the ends of the scan, are no other pairing.
    fn bound(&mut self, shifts: &Shifts) -> Option<usize> {
        let trains = self.trains;
        let needed = self.needed();
        let allowed = trains.profiles().checked_sub(needed)?;
        let reach = shifts.half_offset + shifts.half_drift * trains.half_sensor();
        if let Some((outside, missing)) = self.missing_looks(shifts, allowed) {
            if outside + missing > allowed {
                return None;
            }
            // A box that explains all that was looked at is large or right: to look at every
            // profile of a long scan pays only where it is small.
            let is_large = missing == 0 && reach > FINE_BOX * trains.jitter_us;
            if is_large || self.is_coarse(shifts) {
                return Some(trains.profiles() - outside - missing);
            }
        }
        let (mut missing, mut begin) = (0, 0);
        let best = self.best.as_ref();
        let mut others = best.is_none();
        self.differences.clear();
        for (place, &sensor) in trains.sensor.iter().enumerate() {
            let at = shifts.offset + (1.0 + shifts.drift) * sensor;
            let reach = trains.jitter_us + shifts.half_offset + shifts.half_drift * sensor.abs();
            let before = begin;
            while trains.board.get(begin).is_some_and(|&t| t < at - reach) {
                begin += 1;
            }
            self.steps += 1 + (begin - before) as u64;
            if trains.board.get(begin).is_none_or(|&t| t > at + reach) {
                missing += 1;
                if missing > allowed {
                    return None;
                }
                continue;
            }
            // The one latch that the best shift gives this profile, or another, too.
            let own = best.and_then(|best| best.pairing[place]);
            others |= own != Some(begin)
                || trains
                    .board
                    .get(begin + 1)
                    .is_some_and(|&t| t <= at + reach);
            if trains.counters.is_some() {
                let near = trains.board[begin..]
                    .iter()
                    .take_while(|&&t| t <= at + reach);
                let latches = begin..begin + near.count();
                self.steps += 8 * latches.len() as u64;
                let near = latches.filter_map(|latch| trains.difference(place, latch));
                self.differences
                    .extend(near.map(|difference| (difference, place)));
            }
        }
        if !others {
            return None;
        }
        let mut bound = trains.profiles() - missing;
        if trains.counters.is_some() {
            self.differences.sort_unstable();
            bound = bound.min(widest(&self.differences, trains.spread, &mut self.within));
        }
        (bound >= needed).then_some(bound)
    }

    /// How many profiles lie before the first latch or behind the last for all of the shifts, and
    /// how many of a part of the others, spread over the scan, the shifts cannot explain: as many
    /// at least are missing of all. None where a scan is so short that all are looked at.
    ///
    /// In a long scan most boxes end here. A box reaches farthest at both ends, so that a look
    /// from the beginning on would come to what it misses only half a scan later.
    fn missing_looks(&mut self, shifts: &Shifts, allowed: usize) -> Option<(usize, usize)> {
        let trains = self.trains;
        let looks = FEWEST_LOOKS.saturating_add(allowed.saturating_mul(LOOKS_EACH));
        let stride = trains.profiles() / looks;
        if stride < 2 || trains.drift > 0.5 {
            return None;
        }
        let at = |sensor: f64| shifts.offset + (1.0 + shifts.drift) * sensor;
        let reach =
            |sensor: f64| trains.jitter_us + shifts.half_offset + shifts.half_drift * sensor.abs();
        let (first, last) = (*trains.board.first()?, *trains.board.last()?);
        // Both ends of what a profile reaches rise with its time, as the clocks hardly drift.
        let inside = trains.sensor.partition_point(|&s| at(s) + reach(s) < first)
            ..trains.sensor.partition_point(|&s| at(s) - reach(s) <= last);
        self.steps += 40;
        let outside = trains.profiles() - inside.len();
        if outside > allowed {
            return Some((outside, 0));
        }
        // A wrong shift of an even train misses its signature, and little else.
        let mut odd = 0;
        for &place in trains.odd.0.iter().filter(|place| inside.contains(place)) {
            let (at, reach) = (at(trains.sensor[place]), reach(trains.sensor[place]));
            let begin = trains.board.partition_point(|&t| t < at - reach);
            self.steps += 20;
            odd += usize::from(trains.board.get(begin).is_none_or(|&t| t > at + reach));
            if outside + odd > allowed {
                return Some((outside, odd));
            }
        }
        if self.is_coarse(shifts) {
            return Some((outside, odd));
        }
        let (mut missing, mut seen, mut crowded) = (0, 0, false);
        self.differences.clear();
        for place in inside.step_by(stride) {
            let (at, reach) = (at(trains.sensor[place]), reach(trains.sensor[place]));
            let begin = trains.board.partition_point(|&t| t < at - reach);
            let end = trains.board.partition_point(|&t| t <= at + reach);
            // As many steps as two searches among a million take.
            self.steps += 40;
            if begin == end {
                missing += 1;
                if outside + missing > allowed {
                    return Some((outside, missing));
                }
                continue;
            }
            seen += 1;
            crowded |= end - begin > CROWD;
            if trains.counters.is_some() && !crowded {
                self.steps += 8 * (end - begin) as u64;
                let near = (begin..end).filter_map(|latch| trains.difference(place, latch));
                self.differences
                    .extend(near.map(|difference| (difference, place)));
            }
        }
        if trains.counters.is_some() && !crowded {
            self.differences.sort_unstable();
            missing += seen - widest(&self.differences, trains.spread, &mut self.within).min(seen);
        }
        Some((outside, missing.max(odd)))
    }

    /// Takes what this very shift explains, if it is the best so far or the runner-up.
    fn take(&mut self, offset: f64, drift: f64) {
        let least = self
            .needed()
            .min(self.best.as_ref().map_or(1, |best| best.count));
        self.climb((offset, drift), least, 4);
    }

    /// Takes what this shift leads to in so many steps, each of which explains `least` or more.
    fn climb(&mut self, line: (f64, f64), least: usize, steps: usize) {
        let mut line = line;
        let mut best: Option<Explained> = None;
        // The line through what a shift explains often explains some more.
        for _ in 0..steps {
            let Some(explained) = self.explain(
                line,
                best.as_ref().map_or(least, |b| least.max(b.count + 1)),
            ) else {
                break;
            };
            line = explained.line;
            best = Some(explained);
        }
        if let Some(found) = best {
            self.judge(found);
        }
    }

    /// Takes it if it is the best so far or the runner-up.
    fn judge(&mut self, mut found: Explained) {
        let Some(best) = &self.best else {
            found.margin = margin(self.trains, &found.pairing, found.line);
            self.best = Some(found);
            return;
        };
        let same =
            apart_us(self.trains, best.line, found.line) <= SAME_SHIFT * self.trains.jitter_us;
        if found.count > best.count {
            if !same {
                self.runner_up = self.runner_up.max(best.count);
            }
            found.margin = margin(self.trains, &found.pairing, found.line);
            self.best = Some(found);
        } else if !same {
            self.runner_up = self.runner_up.max(found.count);
        }
    }

    /// What a shift explains, if it is at least `least`.
    fn explain(&mut self, (offset, drift): (f64, f64), least: usize) -> Option<Explained> {
        let trains = self.trains;
        let allowed = trains.profiles().checked_sub(least)?;
        let mut candidates = Vec::new();
        let (mut missing, mut begin) = (0, 0);
        for (place, &sensor) in trains.sensor.iter().enumerate() {
            let at = offset + (1.0 + drift) * sensor;
            let before = begin;
            while trains
                .board
                .get(begin)
                .is_some_and(|&t| t < at - trains.jitter_us)
            {
                begin += 1;
            }
            self.steps += 1 + (begin - before) as u64;
            let mut latch = begin;
            while trains
                .board
                .get(latch)
                .is_some_and(|&t| t <= at + trains.jitter_us)
            {
                candidates.push((place, latch));
                latch += 1;
            }
            if latch == begin {
                missing += 1;
                if missing > allowed {
                    return None;
                }
            }
        }
        let window = if trains.counters.is_some() {
            let difference = |&(place, latch): &(usize, usize)| trains.difference(place, latch);
            let mut sorted: Vec<i64> = candidates.iter().filter_map(difference).collect();
            sorted.sort_unstable();
            widest_window(&sorted, trains.spread)?
        } else {
            (i64::MIN, i64::MAX)
        };
        let fits = |place, latch| {
            trains
                .difference(place, latch)
                .is_none_or(|difference| (window.0..=window.1).contains(&difference))
        };
        let mut pairing = vec![None; trains.profiles()];
        let (mut count, mut next) = (0, 0);
        for &(place, latch) in &candidates {
            // The earliest that is free: no other choice pairs more.
            if latch >= next && pairing[place].is_none() && fits(place, latch) {
                pairing[place] = Some(latch);
                next = latch + 1;
                count += 1;
            }
        }
        let clock = trains.line(&pairing, (offset, drift));
        (count >= least).then_some(Explained {
            pairing,
            count,
            margin: 0,
            line: clock,
        })
    }
}

/// The ends of the values that lie within `spread` of each other, where most do.
pub(super) fn widest_window(sorted: &[i64], spread: i64) -> Option<(i64, i64)> {
    let (mut begin, mut most, mut best) = (0, 0, None);
    for end in 0..sorted.len() {
        while sorted[end].saturating_sub(sorted[begin]) > spread {
            begin += 1;
        }
        if end + 1 - begin > most {
            most = end + 1 - begin;
            best = Some((sorted[begin], sorted[end]));
        }
    }
    best
}

/// How many places have a value within `spread` of each other, at most. The values are sorted;
/// `within` is all 0, and is so again.
///
/// Places count, not values: at rest an encoder shows the same at many latches.
fn widest(sorted: &[(i64, usize)], spread: i64, within: &mut [u32]) -> usize {
    let (mut begin, mut places, mut most) = (0, 0, 0);
    for end in 0..sorted.len() {
        while sorted[end].0.saturating_sub(sorted[begin].0) > spread {
            let count = &mut within[sorted[begin].1];
            *count -= 1;
            places -= usize::from(*count == 0);
            begin += 1;
        }
        let count = &mut within[sorted[end].1];
        places += usize::from(*count == 0);
        *count += 1;
        most = most.max(places);
    }
    for (_, place) in &sorted[begin..] {
        within[*place] = 0;
    }
    most
}
