//! The shift of the clocks that explains most profiles: branch and bound, exact.
//!
//! # Design
//! A shift is an offset and a drift: a line from the sensor's clock to the board's. A box of
//! shifts has an upper bound: the profiles that some shift in it can bring within the jitter
//! of some latch. The boxes with the highest bound are split first. A box whose bound is too
//! low to matter is dropped, and so is one that holds nothing but the best shift so far.
//! What is left shrinks to nothing, so that the answer is the only best one, or a tie, or
//! (where [`MOST_STEPS`] are not enough) undecided.
//!
//! Two lines are the same shift where they stay within twice the jitter of each other over
//! the whole scan.
//!
//! # When a runner-up is a tie
//! Where one shift explains as many as another, none is the best. Faults make it worse: with
//! `p` profiles and `l` latches unexplained by the best shift, up to the smaller of both may
//! belong together in truth, each lost to the count by a fault, and an even train shifted by
//! one pulse can then explain more than the true shift does. So a runner-up that is behind
//! by no more than that number is a tie, too. Where either side is explained completely,
//! that number is 0. Latches that the board says it missed, beyond the profiles that the
//! best shift leaves unexplained, count likewise: another shift may leave more of them.

use std::collections::BinaryHeap;

/// The most steps over profiles and latches of one search: some seconds.
const MOST_STEPS: u64 = 3_000_000_000;
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

/// The times of profiles and latches, about their centres, each in rising order.
#[derive(Debug, Clone)]
pub struct Trains {
    /// Sensor's times in microseconds from `centre_us.0`.
    sensor: Vec<f64>,
    /// The profile of each of them, as the caller counts.
    order: Vec<usize>,
    /// Where each profile of the caller's stands in `sensor`.
    places: Vec<usize>,
    /// Board's times in microseconds from `centre_us.1`.
    board: Vec<f64>,
    centre_us: (f64, f64),
    /// The sensor's encoder (in the order of `sensor`) and the board's counts.
    counters: Option<(Vec<i64>, Vec<i64>)>,
    jitter_us: f64,
    /// The most drift, as a ratio.
    drift: f64,
    /// The most by which encoder less counts may vary over all pairs.
    spread: i64,
    /// How many latches the board says are missing.
    missed: u64,
}

/// What a search says.
#[derive(Debug, Clone, PartialEq)]
pub enum SearchOutcome {
    /// The only best pairing: the latch of each profile.
    Only(Vec<Option<usize>>),
    /// Another shift explains as many, or nearly as many where there are faults.
    Tie {
        /// How many profiles the best explains.
        explained: usize,
        /// How many the other explains.
        runner_up: usize,
    },
    /// The best explains less than half of the shorter stream.
    NoMatch,
    /// Not decided in [`MOST_STEPS`].
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

impl Trains {
    /// From times as the clocks show them. The board's must rise.
    pub fn new(
        sensor_us: &[f64],
        board_ns: &[i64],
        counters: Option<(Vec<i64>, Vec<i64>)>,
        jitter_us: f64,
        drift_ppm: f64,
        spread: i64,
        missed: u64,
    ) -> Self {
        let mut order: Vec<usize> = (0..sensor_us.len()).collect();
        order.sort_by(|&a, &b| sensor_us[a].total_cmp(&sensor_us[b]));
        let mut places = vec![0; order.len()];
        for (place, &profile) in order.iter().enumerate() {
            places[profile] = place;
        }
        let (first, last) = match (order.first(), order.last()) {
            (Some(&first), Some(&last)) => (sensor_us[first], sensor_us[last]),
            _ => (0.0, 0.0),
        };
        let centre_sensor = 0.5 * first + 0.5 * last;
        let first_ns = board_ns.first().copied().unwrap_or(0);
        let last_ns = board_ns.last().copied().unwrap_or(0);
        // Whole nanoseconds first: a clock that runs for days loses no digit.
        let centre_ns = first_ns.midpoint(last_ns);
        let since = |t_ns: i64| (i128::from(t_ns) - i128::from(centre_ns)) as f64 * 1e-3;
        Self {
            sensor: order
                .iter()
                .map(|&i| sensor_us[i] - centre_sensor)
                .collect(),
            places,
            board: board_ns.iter().map(|&t| since(t)).collect(),
            centre_us: (centre_sensor, centre_ns as f64 * 1e-3),
            counters: counters
                .map(|(encoders, counts)| (order.iter().map(|&i| encoders[i]).collect(), counts)),
            order,
            jitter_us,
            drift: drift_ppm * 1e-6,
            spread,
            missed,
        }
    }

    /// The same with the sensor's times `factor` times as long.
    pub fn scaled(&self, factor: f64) -> Self {
        let mut scaled = self.clone();
        scaled.sensor.iter_mut().for_each(|t| *t *= factor);
        scaled.centre_us.0 *= factor;
        scaled
    }

    /// The straight line through the pairs (by place): offset and drift, about the centres.
    /// `fallback` where there is no pair; its drift where there is only one time.
    pub(super) fn line(&self, pairing: &[Option<usize>], fallback: (f64, f64)) -> (f64, f64) {
        let pairs = || {
            pairing
                .iter()
                .zip(&self.sensor)
                .filter_map(|(latch, &sensor)| latch.map(|latch| (sensor, self.board[latch])))
        };
        let n = pairs().count();
        if n == 0 {
            return fallback;
        }
        let (sum_s, sum_b) = pairs().fold((0.0, 0.0), |(s, b), (x, y)| (s + x, b + y));
        let (mean_s, mean_b) = (sum_s / n as f64, sum_b / n as f64);
        let (mut ss, mut sd) = (0.0, 0.0);
        for (s, b) in pairs() {
            let (s, difference) = (s - mean_s, (b - mean_b) - (s - mean_s));
            ss += s * s;
            sd += s * difference;
        }
        let drift = if ss > 0.0 { sd / ss } else { fallback.1 };
        (mean_b - (1.0 + drift) * mean_s, drift)
    }

    /// How many profiles there are.
    pub fn profiles(&self) -> usize {
        self.sensor.len()
    }

    /// How many latches there are.
    pub fn latches(&self) -> usize {
        self.board.len()
    }

    /// Where the caller's profile stands in time.
    pub(super) fn place(&self, profile: usize) -> usize {
        self.places[profile]
    }

    /// The sensor's and the board's centre in microseconds.
    pub(super) fn centres(&self) -> (f64, f64) {
        self.centre_us
    }

    /// A profile that is within the jitter of two latches at the clocks' line, with them.
    pub fn two_candidates(
        &self,
        found: &[Option<usize>],
        (offset, drift): (f64, f64),
    ) -> Option<(usize, [usize; 2])> {
        let origin = self.origin(found);
        let mut owners = vec![None; self.board.len()];
        for (profile, latch) in found.iter().enumerate() {
            if let Some(latch) = *latch {
                owners[latch] = Some(profile);
            }
        }
        for (profile, latch) in found.iter().enumerate() {
            let place = self.places[profile];
            let at = offset + (1.0 + drift) * self.sensor[place];
            let begin = self.board.partition_point(|&t| t < at - self.jitter_us);
            let near = self.board[begin..]
                .iter()
                .take_while(|&&t| t <= at + self.jitter_us)
                .enumerate()
                .map(|(i, _)| begin + i)
                .filter(|&candidate| self.agrees(place, candidate, origin));
            for candidate in near {
                match *latch {
                    Some(latch) if latch != candidate => {
                        return Some((profile, [latch, candidate]));
                    }
                    // A latch near two profiles is as bad as a profile near two latches.
                    None if owners[candidate].is_some() => {
                        return Some((profile, [candidate, candidate]));
                    }
                    _ => {}
                }
            }
        }
        None
    }

    /// The least and the greatest of encoder less counts over the pairs.
    fn origin(&self, found: &[Option<usize>]) -> Option<(i64, i64)> {
        let mut ends: Option<(i64, i64)> = None;
        for (profile, latch) in found.iter().enumerate() {
            if let Some(difference) =
                latch.and_then(|latch| self.difference(self.places[profile], latch))
            {
                let (least, most) = ends.unwrap_or((difference, difference));
                ends = Some((least.min(difference), most.max(difference)));
            }
        }
        ends
    }

    fn agrees(&self, place: usize, latch: usize, origin: Option<(i64, i64)>) -> bool {
        match (self.difference(place, latch), origin) {
            (Some(difference), Some((least, most))) => {
                most.max(difference) - least.min(difference) <= self.spread
            }
            _ => true,
        }
    }

    fn difference(&self, place: usize, latch: usize) -> Option<i64> {
        self.counters
            .as_ref()
            .map(|(encoders, counts)| encoders[place].wrapping_sub(counts[latch]))
    }

    fn half_sensor(&self) -> f64 {
        self.sensor.last().copied().unwrap_or(0.0)
    }

    fn half_board(&self) -> f64 {
        let first = self.board.first().copied().unwrap_or(0.0);
        let last = self.board.last().copied().unwrap_or(0.0);
        first.abs().max(last.abs())
    }
}

/// Finds the only best pairing.
pub fn search(trains: &Trains) -> SearchOutcome {
    let mut search = Search {
        trains,
        steps: 0,
        best: None,
        runner_up: 0,
        differences: Vec::new(),
        within: vec![0; trains.profiles()],
    };
    search.run()
}

/// What a shift explains.
#[derive(Debug, Clone)]
struct Explained {
    /// The latch of each place.
    pairing: Vec<Option<usize>>,
    count: usize,
    /// Offset and drift of the line through its pairs.
    line: (f64, f64),
}

struct Search<'a> {
    trains: &'a Trains,
    steps: u64,
    best: Option<Explained>,
    /// The most that another shift explains.
    runner_up: usize,
    /// Encoder less counts, each with the place of its profile.
    differences: Vec<(i64, usize)>,
    /// How often each place is in the window of [`widest`].
    within: Vec<u32>,
}

impl Search<'_> {
    fn run(&mut self) -> SearchOutcome {
        let trains = self.trains;
        self.guess();
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
            if self.steps > MOST_STEPS {
                return SearchOutcome::Undecided;
            }
            for mut half in self.split(&shifts) {
                let Some(bound) = self.bound(&half) else {
                    continue;
                };
                half.bound = bound;
                self.take(half.offset, half.drift);
                let reach = half.half_offset + half.half_drift * trains.half_sensor();
                if reach > SMALLEST_US && !self.only_best(&half) {
                    heap.push(half);
                }
            }
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
        self.trains.profiles().min(self.trains.latches())
    }

    /// What another shift must explain to be a tie with this best one.
    fn close(&self, best: &Explained) -> usize {
        let profiles = self.trains.profiles() - best.count;
        let latches = self.trains.latches() - best.count;
        let missed = usize::try_from(self.trains.missed).unwrap_or(usize::MAX);
        let hidden = profiles.min(latches).max(missed.saturating_sub(profiles));
        best.count - hidden.min(best.count)
    }

    /// What a box must reach to matter: half of the shorter stream; a tie with the best, or,
    /// once there is a tie, more than the best.
    fn needed(&self) -> usize {
        let half = self.shorter().div_ceil(2).max(1);
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

    /// Two halves, across the side that reaches farther.
    fn split(&self, shifts: &Shifts) -> [Shifts; 2] {
        let mut halves = [*shifts; 2];
        if shifts.half_drift * self.trains.half_sensor() > shifts.half_offset {
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

    /// How far a shift's line is from another's over the scan, at most, in microseconds.
    fn apart_us(&self, a: (f64, f64), b: (f64, f64)) -> f64 {
        (a.0 - b.0).abs() + (a.1 - b.1).abs() * self.trains.half_sensor()
    }

    /// Whether all shifts of the box are the same as the best so far.
    fn only_best(&self, shifts: &Shifts) -> bool {
        let reach = shifts.half_offset + shifts.half_drift * self.trains.half_sensor();
        self.best.as_ref().is_some_and(|best| {
            self.apart_us(best.line, (shifts.offset, shifts.drift)) + reach
                <= SAME_SHIFT * self.trains.jitter_us
        })
    }

    /// How many profiles the shifts can explain at most; none if that is too few to matter.
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
            if missing == 0 && reach > FINE_BOX * trains.jitter_us {
                return Some(trains.profiles() - outside);
            }
        }
        let (mut missing, mut begin) = (0, 0);
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
            } else if trains.counters.is_some() {
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
        Some((outside, missing))
    }

    /// Takes what this very shift explains, if it is the best so far or the runner-up.
    fn take(&mut self, offset: f64, drift: f64) {
        let mut line = (offset, drift);
        let mut best: Option<Explained> = None;
        // The line through what a shift explains often explains some more.
        for _ in 0..4 {
            let Some(explained) = self.explain(line, best.as_ref().map_or(0, |b| b.count + 1))
            else {
                break;
            };
            line = explained.line;
            best = Some(explained);
        }
        let Some(found) = best else {
            return;
        };
        let Some(best) = &self.best else {
            self.best = Some(found);
            return;
        };
        let same = self.apart_us(best.line, found.line) <= SAME_SHIFT * self.trains.jitter_us;
        if found.count > best.count {
            if !same {
                self.runner_up = self.runner_up.max(best.count);
            }
            self.best = Some(found);
        } else if !same {
            self.runner_up = self.runner_up.max(found.count);
        }
    }

    /// What a shift explains, if it is at least `least` and enough to matter.
    fn explain(&mut self, (offset, drift): (f64, f64), least: usize) -> Option<Explained> {
        let trains = self.trains;
        let least = least.max(self.needed().min(self.best.as_ref().map_or(1, |b| b.count)));
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
            line: clock,
        })
    }
}

/// The ends of the values that lie within `spread` of each other, where most do.
fn widest_window(sorted: &[i64], spread: i64) -> Option<(i64, i64)> {
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
