//! Duplicates and losses, by the sensor's frame counter.

use std::collections::HashMap;

use super::Stamp;

/// Stamps without those that came again.
#[derive(Debug, Clone, PartialEq)]
pub struct Frames {
    /// The first stamp of each frame, in the order of the stream.
    pub stamps: Vec<Stamp>,
    /// Places in the stream of those whose frame number was there before.
    pub duplicates: Vec<u64>,
    /// How many of the duplicates have another time than the first of their number: the
    /// counter wrapped or started anew, rather than a message that came again.
    pub renumbered: u64,
    /// Numbers between the counter's first and last that no profile has.
    pub lost_frames: u64,
}

/// Two stamps of one frame agree within this, in microseconds.
const SAME_TIME_US: f64 = 1.0;

/// Sorts duplicates out and counts the missing numbers.
///
/// A counter of `frame_bits` starts at 0 again behind its last number. Whether a profile is
/// new is then told by the sensor's clock: a later time than any before is a later frame, so
/// that neither a long loss nor a late repetition shifts the count. Without `frame_bits` the
/// counter never wraps.
#[must_use]
pub fn sort_out(stamps: &[Stamp], frame_bits: Option<u32>) -> Frames {
    let mut first_times: HashMap<i128, f64> = HashMap::with_capacity(stamps.len());
    let mut frames = Frames {
        stamps: Vec::with_capacity(stamps.len()),
        duplicates: Vec::new(),
        renumbered: 0,
        lost_frames: 0,
    };
    let mut last: Option<(i128, f64)> = None;
    let mut ends: Option<(i128, i128)> = None;
    for stamp in stamps {
        let number = match (frame_bits, last) {
            (Some(bits), Some(last)) if bits < 64 => unwrap(stamp, last, 1_i128 << bits),
            _ => i128::from(stamp.frame),
        };
        if last.is_none_or(|(_, t_us)| stamp.t_us > t_us) {
            last = Some((number, stamp.t_us));
        }
        if let Some(first_us) = first_times.get(&number) {
            frames.duplicates.push(stamp.profile);
            frames.renumbered += u64::from((stamp.t_us - first_us).abs() > SAME_TIME_US);
            continue;
        }
        first_times.insert(number, stamp.t_us);
        frames.stamps.push(*stamp);
        let (least, most) = ends.unwrap_or((number, number));
        ends = Some((least.min(number), most.max(number)));
    }
    if let Some((least, most)) = ends {
        let missing = most - least + 1 - frames.stamps.len() as i128;
        frames.lost_frames = u64::try_from(missing).unwrap_or(u64::MAX);
    }
    frames
}

/// The number of a frame that shows only its lowest bits: the next one up from the latest
/// frame for a later time, else the next one down.
fn unwrap(stamp: &Stamp, (latest, latest_us): (i128, f64), turn: i128) -> i128 {
    let up = (i128::from(stamp.frame) - latest).rem_euclid(turn);
    if stamp.t_us > latest_us + SAME_TIME_US {
        latest + if up == 0 { turn } else { up }
    } else if up == 0 {
        latest
    } else {
        latest + up - turn
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stamps(frames_and_times: &[(u64, f64)]) -> Vec<Stamp> {
        let stamp = |(profile, &(frame, t_us)): (usize, &(u64, f64))| Stamp {
            profile: profile as u64,
            frame,
            t_us,
            encoder: None,
        };
        frames_and_times.iter().enumerate().map(stamp).collect()
    }

    #[test]
    fn the_first_of_a_number_counts_and_gaps_are_counted() {
        let stamps = stamps(&[(7, 0.0), (8, 10.0), (8, 10.0), (11, 40.0), (7, 0.0)]);
        let frames = sort_out(&stamps, None);
        assert_eq!(frames.duplicates, [2, 4]);
        assert_eq!(frames.lost_frames, 2);
        assert_eq!(frames.renumbered, 0);
        assert_eq!(frames.stamps.len(), 3);
    }

    #[test]
    fn a_counter_that_wraps_loses_nothing_and_a_late_repetition_stays_one() {
        // Four bits: 14, 15, 0, 1 and, late, 14 again; then a loss of more than half a turn.
        let stamps = stamps(&[
            (14, 0.0),
            (15, 10.0),
            (0, 20.0),
            (1, 30.0),
            (14, 0.0),
            (12, 140.0),
            (12, 140.0),
        ]);
        let frames = sort_out(&stamps, Some(4));
        assert_eq!(frames.duplicates, [4, 6]);
        assert_eq!(frames.lost_frames, 10);
        assert_eq!(frames.renumbered, 0);
        // Without the width the second 14 is the same, and the wrap is no duplicate yet.
        assert_eq!(sort_out(&stamps, None).duplicates, [4, 6]);
    }

    #[test]
    fn a_counter_that_starts_anew_is_told_from_repetitions() {
        let stamps = stamps(&[(1, 0.0), (2, 10.0), (1, 500.0), (2, 510.0)]);
        let frames = sort_out(&stamps, None);
        assert_eq!(frames.duplicates, [2, 3]);
        assert_eq!(frames.renumbered, 2);
    }
}
