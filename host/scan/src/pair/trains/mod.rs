//! The times of profiles and latches as the search takes them.

pub(super) mod near_two;

use super::apart::could_pair;

/// No two clocks drift by more than this, as a ratio.
pub(super) const MOST_DRIFT: f64 = 0.01;
/// A train is even where at most one time of so many stands off it.
const LEAST_EVEN: usize = 8;
/// So many times off the train are enough to tell where it is.
const MOST_ODD: usize = 256;

/// The times of profiles and latches, about their centres, each in rising order.
#[derive(Debug, Clone)]
pub struct Trains {
    /// Sensor's times in microseconds from `centre_us.0`.
    pub(super) sensor: Vec<f64>,
    /// The profile of each of them, as the caller counts.
    pub(super) order: Vec<usize>,
    /// Where each profile of the caller's stands in `sensor`.
    places: Vec<usize>,
    /// Board's times in microseconds from `centre_us.1`.
    pub(super) board: Vec<f64>,
    centre_us: (f64, f64),
    /// The sensor's encoder (in the order of `sensor`) and the board's counts.
    pub(super) counters: Option<(Vec<i64>, Vec<i64>)>,
    pub(super) jitter_us: f64,
    /// The most drift, as a ratio.
    pub(super) drift: f64,
    /// The most by which encoder less counts may vary over all pairs.
    pub(super) spread: i64,
    /// How many profiles or latches the shorter stream has, those included that stand apart.
    pub(super) shorter: usize,
    /// How many latches the board says are missing.
    pub(super) missed: u64,
    /// The runs in which they are missing, the longest first; a run of one need not be here.
    pub(super) lost_runs: Vec<u64>,
    /// Places of profiles, and latches, that stand off the even train that most belong to: a signature.
    pub(super) odd: (Vec<usize>, Vec<usize>),
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
        (missed, mut lost_runs): (u64, Vec<u64>),
    ) -> Self {
        lost_runs.sort_unstable_by(|a, b| b.cmp(a));
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
        let sensor: Vec<f64> = order
            .iter()
            .map(|&i| sensor_us[i] - centre_sensor)
            .collect();
        let odd_profiles = odd(&sensor, jitter_us);
        // About a signature the drift moves its times by nothing, so that few boxes tell where it is.
        let signature = odd_profiles
            .get(odd_profiles.len() / 2)
            .map_or(0.0, |&place| sensor[place]);
        let sensor: Vec<f64> = sensor.iter().map(|t| t - signature).collect();
        let centre_sensor = centre_sensor + signature;
        let board: Vec<f64> = board_ns.iter().map(|&t| since(t)).collect();
        Self {
            odd: (odd_profiles, odd(&board, jitter_us)),
            shorter: sensor.len().min(board.len()),
            sensor,
            places,
            board,
            centre_us: (centre_sensor, centre_ns as f64 * 1e-3),
            counters: counters
                .map(|(encoders, counts)| (order.iter().map(|&i| encoders[i]).collect(), counts)),
            order,
            jitter_us,
            drift: drift_ppm * 1e-6,
            spread,
            missed,
            lost_runs,
        }
    }

    /// The same for drifts of at most so much, as a ratio.
    pub(super) fn within(&self, drift: f64) -> Self {
        Self {
            drift,
            ..self.clone()
        }
    }

    /// The same with another jitter.
    pub(super) fn of_jitter(&self, jitter_us: f64) -> Self {
        Self {
            jitter_us,
            ..self.clone()
        }
    }

    /// The least time between two neighbouring latches, in microseconds; none of fewer than two.
    pub(super) fn closest_us(&self) -> Option<f64> {
        let apart = self.board.windows(2).map(|pair| pair[1] - pair[0]);
        apart.reduce(f64::min)
    }

    /// How many profiles a shift must explain: half of the shorter stream.
    pub(super) fn need(&self) -> usize {
        self.shorter.div_ceil(2).max(1)
    }

    /// Whether any shift could explain so many, by the lengths of the trains.
    pub(super) fn could_pair(&self) -> bool {
        let farthest = self.drift + MOST_DRIFT;
        could_pair(
            &self.sensor,
            &self.board,
            (self.jitter_us, farthest),
            self.need(),
        )
    }

    /// The straight line through the pairs (by place): offset and drift, about the centres; by least
    /// squares among the lines that drift by no more than the limit. `fallback` where there is no pair; its drift where there is only one time.
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
        // With the offset free the sum of squares is a parabola of the drift: its least value within
        // the limit is at the vertex or at the end that is next to it.
        let drift = if ss > 0.0 { sd / ss } else { fallback.1 };
        let drift = drift.clamp(-self.drift, self.drift);
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

    pub(super) fn difference(&self, place: usize, latch: usize) -> Option<i64> {
        self.counters
            .as_ref()
            .map(|(encoders, counts)| encoders[place].wrapping_sub(counts[latch]))
    }

    /// The farthest of the sensor's times from their origin.
    pub(super) fn half_sensor(&self) -> f64 {
        let (first, last) = ends(&self.sensor);
        first.abs().max(last.abs())
    }

    /// The farthest of the board's times from their origin.
    pub(super) fn half_board(&self) -> f64 {
        let (first, last) = ends(&self.board);
        first.abs().max(last.abs())
    }
}

/// The first and the last of the times; 0 where there is none.
pub(super) fn ends(times: &[f64]) -> (f64, f64) {
    let first = times.first().copied().unwrap_or(0.0);
    (first, times.last().copied().unwrap_or(first))
}

/// The median of what is between times that follow each other; none of a single one.
pub(super) fn median_interval(times: &[f64]) -> Option<f64> {
    let mut apart: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let middle = apart.len() / 2;
    (!apart.is_empty()).then(|| *apart.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// The first times that stand off the even train that most belong to; none where most do not.
///
/// An interval is even where it is a whole number of the median one, within four times the jitter: lost
/// pulses leave the train as it is. The first times of a signature have to be told from a train, and a
/// shift that is wrong misses just these.
fn odd(times: &[f64], jitter_us: f64) -> Vec<usize> {
    let Some(median) = median_interval(times) else {
        return Vec::new();
    };
    let is_even = |pair: &[f64]| {
        let steps = ((pair[1] - pair[0]) / median).round().max(1.0);
        (pair[1] - pair[0] - steps * median).abs() <= 4.0 * jitter_us
    };
    let mut odd: Vec<usize> = (1..times.len())
        .filter(|&i| !is_even(&times[i - 1..=i]))
        .collect();
    if odd.len() * LEAST_EVEN > times.len() {
        return Vec::new();
    }
    odd.truncate(MOST_ODD);
    odd
}
