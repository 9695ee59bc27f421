//! Both streams as the search takes them: without what stands apart.

use super::apart::{LONGEST_SCAN_US, within_reach};
use super::trains::Trains;
use crate::ScanError;
use crate::format::triggers::{LatchSignal, Triggers};
use crate::profile::frames::{FrameCounter, Frames};

/// Encoder less counts agrees within this for all pairs.
const ENCODER_WITHIN: i64 = 4;

/// What a pairing must keep to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PairOptions {
    /// What belongs together agrees within this, in microseconds.
    pub jitter_us: f64,
    /// The most by which the clocks drift, in parts per million.
    pub drift_ppm: f64,
    /// What the sensor's frame counter does.
    pub counter: FrameCounter,
    /// The axis that the sensor's encoder counts too, as its place in
    /// [`umi_kinematics::COLUMNS`].
    pub encoder: Option<usize>,
    /// Refuse any loss, duplicate or extra.
    pub strict: bool,
}

impl Default for PairOptions {
    fn default() -> Self {
        Self {
            jitter_us: 20.0,
            drift_ppm: 200.0,
            counter: FrameCounter::Rises,
            encoder: None,
            strict: false,
        }
    }
}

/// All times, and what both sides counted.
pub(super) struct Streams<'a> {
    pub frames: &'a Frames,
    pub triggers: &'a Triggers,
    pub options: &'a PairOptions,
    /// The sensor's encoder and the board's counts.
    counters: Option<(Vec<i64>, Vec<i64>)>,
}

/// The trains of what a shift could pair.
pub(super) struct Reach {
    pub trains: Trains,
    /// The place in [`Frames::stamps`] of each of its profiles.
    pub profiles: Vec<usize>,
    /// The place in [`Triggers::latches`] of each of its latches.
    pub latches: Vec<usize>,
}

impl<'a> Streams<'a> {
    /// # Errors
    /// `no_encoder`, `missing_axis`.
    pub fn new(
        frames: &'a Frames,
        triggers: &'a Triggers,
        options: &'a PairOptions,
    ) -> Result<Self, ScanError> {
        let mut counters = None;
        if let Some(axis) = options.encoder {
            let encoders = frames.stamps.iter().map(|stamp| {
                stamp.encoder.ok_or_else(|| {
                    ScanError::refused(
                        "no_encoder",
                        format_args!(
                            "profile {} has no encoder value: leave --encoder out",
                            stamp.profile
                        ),
                    )
                })
            });
            let counts = triggers.latches.iter().map(|latch| {
                latch.counts.get(axis).copied().flatten().ok_or_else(|| {
                    ScanError::refused(
                        "missing_axis",
                        format_args!(
                            "latch {} has no counts of the axis that --encoder names",
                            latch.number
                        ),
                    )
                })
            });
            counters = Some((
                encoders.collect::<Result<Vec<_>, _>>()?,
                counts.collect::<Result<Vec<_>, _>>()?,
            ));
        }
        Ok(Self {
            frames,
            triggers,
            options,
            counters,
        })
    }

    /// Whether a profile and another latch agree in their counts as well as it does with its own.
    pub fn agree(&self, own: (usize, usize), other: (usize, usize)) -> bool {
        self.counters.as_ref().is_none_or(|(encoders, counts)| {
            let origin =
                |(profile, latch): (usize, usize)| encoders[profile].wrapping_sub(counts[latch]);
            origin(own).abs_diff(origin(other)) <= 2 * ENCODER_WITHIN.unsigned_abs()
        })
    }

    /// The same, with nothing but the clocks; none where there is nothing else.
    pub fn without_encoder(&self) -> Option<Self> {
        self.counters.as_ref()?;
        Some(Self {
            counters: None,
            ..*self
        })
    }

    /// The sensor's encoder at a profile and the board's counts at a latch.
    pub fn encoder_and_counts(&self, profile: usize, latch: usize) -> Option<(i64, i64)> {
        let (encoders, counts) = self.counters.as_ref()?;
        Some((*encoders.get(profile)?, *counts.get(latch)?))
    }

    /// The encoder at each profile; nothing without one.
    pub fn encoders(&self) -> impl Iterator<Item = f64> {
        let counters = self.counters.as_ref();
        counters
            .into_iter()
            .flat_map(|(encoders, _)| encoders)
            .map(|count| *count as f64)
    }

    /// The board's counts at each latch; nothing without an encoder.
    pub fn counts(&self) -> impl Iterator<Item = f64> {
        let counters = self.counters.as_ref();
        counters
            .into_iter()
            .flat_map(|(_, counts)| counts)
            .map(|count| *count as f64)
    }

    /// What makes an even train tell where it is.
    pub fn advice(&self) -> String {
        let uneven = match self.triggers.cause {
            LatchSignal::Output => {
                "begin with uneven trigger pulses (the signature of umi scan record; pulses by distance have none)"
            }
            LatchSignal::Trigger => {
                "let the board trigger the sensor (umi scan record begins with uneven pulses), because a sensor that runs \
                 freely is even for ever"
            }
        };
        let encoder = match self.counters {
            Some(_) => "",
            None => "wire the sensor's encoder (--encoder) and ",
        };
        format!("{uneven}; or {encoder}change speed in the scan, up and down by turns")
    }

    /// The sensor's times, as the stream has them.
    pub fn sensor_us(&self) -> impl Iterator<Item = f64> {
        self.frames.stamps.iter().map(|stamp| stamp.t_us)
    }

    /// The board's times from its first; they rise.
    pub fn board_us(&self) -> Vec<f64> {
        let latches = &self.triggers.latches;
        let first = latches.first().map_or(0, |latch| i128::from(latch.t_ns));
        let since = |t_ns: i64| (i128::from(t_ns) - first) as f64 * 1e-3;
        latches.iter().map(|latch| since(latch.t_ns)).collect()
    }

    /// The trains, with the sensor's times so many times as long.
    pub fn within_reach(&self, factor: f64) -> Reach {
        let times: Vec<f64> = self.sensor_us().map(|t| t * factor).collect();
        let mut order: Vec<usize> = (0..times.len()).collect();
        order.sort_by(|&a, &b| times[a].total_cmp(&times[b]));
        let sorted: Vec<f64> = order.iter().map(|&profile| times[profile]).collect();
        let shorter = times.len().min(self.triggers.latches.len());
        let need = shorter.div_ceil(2).max(1);
        let (places, latches) =
            within_reach(&sorted, &self.board_us(), self.options.jitter_us, need);
        let mut profiles: Vec<usize> = places.iter().map(|&place| order[place]).collect();
        profiles.sort_unstable();
        let sensor_us: Vec<f64> = profiles.iter().map(|&profile| times[profile]).collect();
        let of_latch = |&latch: &usize| self.triggers.latches[latch].t_ns;
        let board_ns: Vec<i64> = latches.iter().map(of_latch).collect();
        let counters = self.counters.as_ref().map(|(encoders, counts)| {
            (
                profiles.iter().map(|&profile| encoders[profile]).collect(),
                latches.iter().map(|&latch| counts[latch]).collect(),
            )
        });
        let mut trains = Trains::new(
            &sensor_us,
            &board_ns,
            counters,
            self.options.jitter_us,
            self.options.drift_ppm,
            2 * ENCODER_WITHIN,
            (self.triggers.missed, self.triggers.lost_runs.clone()),
        );
        trains.shorter = shorter;
        Reach {
            trains,
            profiles,
            latches,
        }
    }
}

impl Reach {
    /// The latch of each profile of the stream, from that of each that was within reach.
    pub fn of_all(&self, found: &[Option<usize>], profiles: usize) -> Vec<Option<usize>> {
        let mut all = vec![None; profiles];
        for (&profile, latch) in self.profiles.iter().zip(found) {
            all[profile] = latch.map(|latch| self.latches[latch]);
        }
        all
    }

    /// What is to be said of profiles and latches that no shift could pair because they stand farther from all others than
    /// the scan is long: their times are wrong.
    pub fn apart(&self, streams: &Streams<'_>) -> Option<String> {
        let stamps = &streams.frames.stamps;
        let latches = &streams.triggers.latches;
        let sensor: Vec<f64> = streams.sensor_us().collect();
        let board = streams.board_us();
        let length = |times: &[f64], kept: &[usize]| {
            let ends = kept.iter().map(|&i| times[i]);
            let (least, most) = ends.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), t| {
                (a.min(t), b.max(t))
            });
            most - least
        };
        let longest = length(&sensor, &self.profiles)
            .max(length(&board, &self.latches))
            .clamp(1.0, LONGEST_SCAN_US);
        let wild: Vec<String> = beyond(&sensor, &self.profiles, longest)
            .into_iter()
            .map(|i| format!("profile {} at {} µs", stamps[i].profile, stamps[i].t_us))
            .chain(
                beyond(&board, &self.latches, longest)
                    .into_iter()
                    .map(|i| format!("latch {} at {} ns", latches[i].number, latches[i].t_ns)),
            )
            .collect();
        let first = wild.first()?;
        let others = match wild.len() {
            1 => String::new(),
            n => format!(" and {} others", n - 1),
        };
        Some(format!(
            "misplaced: {first}{others}: farther from the rest than the scan is long, so that the time is wrong; left out"
        ))
    }
}

/// Those that are not kept and that stand behind a gap of more than `longest`, seen from what is kept.
fn beyond(times: &[f64], kept: &[usize], longest: f64) -> Vec<usize> {
    let mut order: Vec<usize> = (0..times.len()).collect();
    order.sort_by(|&a, &b| times[a].total_cmp(&times[b]));
    let mut is_kept = vec![false; times.len()];
    kept.iter().for_each(|&i| is_kept[i] = true);
    let Some(first) = order.iter().position(|&i| is_kept[i]) else {
        return Vec::new();
    };
    let last = order.iter().rposition(|&i| is_kept[i]).unwrap_or(first);
    let behind = |from: &[usize]| {
        let gap = from
            .windows(2)
            .position(|pair| (times[pair[1]] - times[pair[0]]).abs() > longest);
        gap.map_or(Vec::new(), |gap| from[gap + 1..].to_vec())
    };
    let mut wild = behind(&order[last..]);
    let before: Vec<usize> = order[..=first].iter().rev().copied().collect();
    wild.extend(behind(&before));
    wild.sort_unstable();
    wild
}
