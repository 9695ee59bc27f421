//! Duplicates and losses, by the sensor's frame counter.

use std::collections::{BTreeSet, HashMap, HashSet};

use super::Stamp;

/// Stamps without those that came again.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Frames {
    /// The first stamp of each frame that has a time, in the order of the stream.
    pub stamps: Vec<Stamp>,
    /// The number of each, counted on where the counter wraps or starts anew.
    pub numbers: Vec<i128>,
    /// Places in the stream of those whose frame number was there before; or came again, where the first had a wild time.
    pub duplicates: Vec<u64>,
    /// First messages with a wild time, whose frame came again with a right one.
    pub wild: Vec<WildFirst>,
    /// Those of the duplicates that have another time than the first of their number: the
    /// counter wrapped or started anew, rather than a message that came again.
    pub renumbered: Vec<u64>,
    /// Profiles that are later than all before them and have a lower number than the latest: with them the counter
    /// started anew.
    pub restarts: Vec<u64>,
    /// Numbers between the counter's first and last that no profile has; each start of the counter has its own first and last.
    pub lost_frames: u64,
}

/// The first message of a frame, with a time that cannot be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WildFirst {
    /// As it came.
    pub first: Stamp,
    /// The profile that stands for it.
    pub again: u64,
}

/// Two stamps of one frame agree within this, in microseconds.
const SAME_TIME_US: f64 = 1.0;

/// What a sensor's frame counter does.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum FrameCounter {
    /// It rises: a number that was there before is a repetition.
    #[default]
    Rises,
    /// It shows so many of its lowest bits, and starts at 0 again behind the last number.
    Bits(u32),
    /// It may start anew at any number, while the clock goes on.
    Restarts,
}

/// Sorts duplicates out and counts the missing numbers.
///
/// A counter of so many bits starts at 0 again behind its last number. Whether a profile is
/// new is then told by the sensor's clock: a later time than any before is a later frame, so
/// that neither a long loss nor a late repetition shifts the count. Without a width the
/// counter never wraps; where it may start anew, the clock tells a repetition from a profile of its own.
#[must_use]
pub fn sort_out(stamps: &[Stamp], counter: FrameCounter) -> Frames {
    let mut first_times: HashMap<i128, f64> = HashMap::with_capacity(stamps.len());
    let mut frames = Frames {
        stamps: Vec::with_capacity(stamps.len()),
        numbers: Vec::with_capacity(stamps.len()),
        ..Frames::default()
    };
    let mut again = Vec::new();
    // What the counter shows less the number of the frame, since each start of it.
    let mut bases: Vec<i128> = vec![0];
    let mut last: Option<(i128, f64)> = None;
    // All numbers with their times, and when the counter started anew.
    let mut counted: Vec<(i128, f64)> = Vec::with_capacity(stamps.len());
    let mut starts: Vec<f64> = Vec::new();
    let mut earliest_us = f64::INFINITY;
    for (place, stamp) in stamps.iter().enumerate() {
        let shown = i128::from(stamp.frame);
        let is_same = |number: &i128| {
            let first = first_times.get(number);
            first.is_some_and(|first_us| (stamp.t_us - first_us).abs() <= SAME_TIME_US)
        };
        let since = |base: &i128| shown - base;
        // A time that is wrong says nothing of a turn or a new start.
        let is_ahead = is_ahead(stamp, &stamps[place + 1..]);
        let is_later = |than_us: f64| stamp.t_us > than_us + SAME_TIME_US && !is_ahead;
        let is_at_once = |us: f64| (stamp.t_us - us).abs() <= SAME_TIME_US;
        let number = match (counter, last) {
            (FrameCounter::Bits(bits), Some(last)) if bits < 64 => {
                let turn = 1_i128 << bits;
                let up = (shown - last.0).rem_euclid(turn);
                let is_near = 2 * up < turn;
                // The next one up from the latest frame for a later time, else the next one down; at the same time the nearer.
                let number = match up {
                    0 if is_later(last.1) => last.0 + turn,
                    0 => last.0,
                    _ if is_later(last.1) || is_ahead && is_near => last.0 + up,
                    // Frames may follow each other within what two stamps of one differ by.
                    _ if is_near && is_at_once(last.1) && !is_same(&(last.0 + up - turn)) => {
                        last.0 + up
                    }
                    _ => last.0 + up - turn,
                };
                // A time that fits neither a repetition nor what came before is wrong: the next one up.
                let is_other = first_times
                    .get(&number)
                    .is_some_and(|&us| !is_same(&number) && can_be(&first_times, number, us));
                let before_all = stamp.t_us < earliest_us - SAME_TIME_US;
                if number < last.0 && (is_other || before_all) && is_near {
                    last.0 + up
                } else {
                    number
                }
            }
            // The same frame at the same time, before whichever start, came again.
            (FrameCounter::Restarts, Some((latest, latest_us))) => {
                let again = bases.iter().map(since).find(is_same);
                let base = bases[bases.len() - 1];
                let starts = again.is_none() && shown - base <= latest && is_later(latest_us);
                if starts {
                    frames.restarts.push(stamp.profile);
                    bases.push(shown - latest - 1);
                }
                again.unwrap_or(shown - bases[bases.len() - 1])
            }
            (_, Some((latest, latest_us))) => {
                if shown < latest && is_later(latest_us) {
                    frames.restarts.push(stamp.profile);
                    starts.push(stamp.t_us);
                }
                shown
            }
            _ => shown,
        };
        let rises = last.is_none_or(|(_, t_us)| stamp.t_us > t_us);
        if rises && !is_ahead {
            last = Some((number, stamp.t_us));
        }
        earliest_us = earliest_us.min(stamp.t_us);
        counted.push((number, stamp.t_us));
        if let Some(first_us) = first_times.get(&number) {
            frames.duplicates.push(stamp.profile);
            if (stamp.t_us - first_us).abs() > SAME_TIME_US {
                again.push((number, *stamp));
            }
            continue;
        }
        first_times.insert(number, stamp.t_us);
        frames.stamps.push(*stamp);
        frames.numbers.push(number);
    }
    frames.lost_frames = missing(&counted, &starts);
    take_again(&mut frames, &first_times, again);
    frames
}

/// The numbers that are missing between the first and the last of each run of the counter. What was lost about the moment
/// that it started anew nothing tells.
fn missing(counted: &[(i128, f64)], starts: &[f64]) -> u64 {
    let mut runs: Vec<BTreeSet<i128>> = vec![BTreeSet::new(); starts.len() + 1];
    for &(number, t_us) in counted {
        // What came again late is of the run that it was seen in. Times of runs rise.
        let run = starts.partition_point(|start| *start <= t_us + SAME_TIME_US);
        runs[run].insert(number);
    }
    let mut all: Vec<BTreeSet<i128>> = Vec::with_capacity(runs.len());
    for run in runs {
        let Some(before) = all.last_mut() else {
            all.push(run);
            continue;
        };
        // One number that was there before, and then the next ones as if nothing had been: a repetition with a wrong time.
        let goes_on = before.last().is_some_and(|latest| {
            let (old, new): (Vec<i128>, Vec<i128>) = run.iter().partition(|n| *n <= latest);
            !new.is_empty() && old.iter().all(|n| before.contains(n))
        });
        if goes_on {
            before.extend(run);
        } else {
            all.push(run);
        }
    }
    let sum: i128 = (all.iter())
        .filter_map(|run| Some(run.last()? - run.first()? + 1 - run.len() as i128))
        .sum();
    u64::try_from(sum).unwrap_or(u64::MAX)
}

/// So many frames about one say when it was, of as many numbers before and behind it.
const ABOUT: i128 = 8;
/// At the ends of the scan a time is wild that is farther from the frames next to it than so many of their intervals.
const WILD_INTERVALS: f64 = 10.0;

/// Lets a message that came again stand for its frame, where the first one has a time that cannot be and it has one that can.
fn take_again(frames: &mut Frames, first_times: &HashMap<i128, f64>, again: Vec<(i128, Stamp)>) {
    let mut taken = HashMap::new();
    for (number, stamp) in again {
        let first_us = first_times.get(&number).copied().unwrap_or(stamp.t_us);
        let is_better =
            !can_be(first_times, number, first_us) && can_be(first_times, number, stamp.t_us);
        if is_better && !taken.contains_key(&number) {
            taken.insert(number, stamp);
        } else {
            frames.renumbered.push(stamp.profile);
        }
    }
    if taken.is_empty() {
        return;
    }
    let mut wild = Vec::new();
    for (number, place) in frames.numbers.iter().zip(&mut frames.stamps) {
        if let Some(stamp) = taken.get(number) {
            let (first, again) = (std::mem::replace(place, *stamp), stamp.profile);
            wild.push(WildFirst { first, again });
        }
    }
    let stands: HashSet<u64> = wild.iter().map(|wild| wild.again).collect();
    frames
        .duplicates
        .retain(|profile| !stands.contains(profile));
    frames
        .duplicates
        .extend(wild.iter().map(|wild| wild.first.profile));
    frames.duplicates.sort_unstable();
    frames.wild = wild;
    let stamps = std::mem::take(&mut frames.stamps).into_iter();
    let mut both: Vec<(Stamp, i128)> = stamps.zip(std::mem::take(&mut frames.numbers)).collect();
    both.sort_by_key(|(stamp, _)| stamp.profile);
    (frames.stamps, frames.numbers) = both.into_iter().unzip();
}

/// Whether a frame may have this time, by most of the frames before it and most of those behind it.
fn can_be(first_times: &HashMap<i128, f64>, number: i128, us: f64) -> bool {
    let seen = |number: i128| Some((number, *first_times.get(&number)?));
    let before: Vec<(i128, f64)> = (1..=ABOUT).filter_map(|n| seen(number - n)).collect();
    let behind: Vec<(i128, f64)> = (1..=ABOUT).filter_map(|n| seen(number + n)).collect();
    let earlier = before.iter().filter(|(_, t)| *t < us).count();
    let later = behind.iter().filter(|(_, t)| *t > us).count();
    if 2 * earlier < before.len() || 2 * later < behind.len() {
        return false;
    }
    // With frames on one side only their pace tells.
    let side = match (before.is_empty(), behind.is_empty()) {
        (true, false) => behind,
        (false, true) => before,
        _ => return true,
    };
    let (Some(next), Some(far)) = (side.first(), side.get(1..).and_then(<[_]>::last)) else {
        return true;
    };
    let pace = ((far.1 - next.1) / (far.0 - next.0) as f64).abs();
    let intervals = (number - next.0).unsigned_abs() as f64;
    (us - next.1).abs() <= WILD_INTERVALS * pace * intervals
}

/// Whether most of the next profiles are earlier than this one: its time is wrong, and says nothing of theirs.
fn is_ahead(stamp: &Stamp, next: &[Stamp]) -> bool {
    const NEXT: usize = 8;
    let next = &next[..next.len().min(NEXT)];
    let is_earlier = |later: &&Stamp| later.t_us < stamp.t_us - SAME_TIME_US;
    2 * next.iter().filter(is_earlier).count() > next.len()
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
        let frames = sort_out(&stamps, FrameCounter::Rises);
        assert_eq!(frames.duplicates, [2, 4]);
        assert_eq!(frames.lost_frames, 2);
        assert_eq!(frames.renumbered, [0; 0]);
        assert_eq!(frames.stamps.len(), 3);
    }

    #[test]
    fn a_repetition_with_a_right_time_stands_for_a_first_with_a_wild_one() {
        let counters = [
            FrameCounter::Rises,
            FrameCounter::Bits(4),
            FrameCounter::Restarts,
        ];
        for counter in counters {
            for wild in [9e15, -9e15, 5e4, -5e4] {
                // Of the first frame, within, of the last; the repetition follows at once or some frames later.
                for (place, late) in [(0, 1), (5, 1), (5, 4), (13, 1)] {
                    if place == 0 && wild < 0.0 && counter != FrameCounter::Rises {
                        // The first time of all is what a turn or a new start is told by.
                        continue;
                    }
                    let mut seen: Vec<(u64, f64)> = (0..14).map(|i| (i, 10.0 * i as f64)).collect();
                    let right = seen[place];
                    seen[place].1 = wild;
                    seen.insert(place + late, right);
                    let frames = sort_out(&stamps(&seen), counter);
                    let by = (place + late) as u64;
                    let told = format!("{counter:?} {wild} {place} {late}: {frames:?}");
                    assert_eq!(frames.duplicates, [place as u64], "{told}");
                    assert_eq!(frames.renumbered, [0; 0], "{told}");
                    let kept = frames.stamps.iter().map(|stamp| (stamp.frame, stamp.t_us));
                    let due: Vec<(u64, f64)> = (0..14).map(|i| (i, 10.0 * i as f64)).collect();
                    let mut kept: Vec<(u64, f64)> = kept.collect();
                    kept.sort_by_key(|(frame, _)| *frame);
                    assert_eq!(kept, due, "{told}");
                    assert!(
                        frames.stamps.is_sorted_by_key(|stamp| stamp.profile),
                        "{told}"
                    );
                    assert_eq!(frames.wild.len(), 1, "{told}");
                    assert_eq!(
                        (frames.wild[0].first.profile, frames.wild[0].again),
                        (place as u64, by)
                    );
                    // Where the repetition is the wild one, the first counts.
                    seen[place] = right;
                    seen[place + late].1 = wild;
                    let frames = sort_out(&stamps(&seen), counter);
                    assert!(frames.wild.is_empty(), "{told}");
                    // Nothing behind the last one says that its time is wrong.
                    if place < 13 {
                        assert_eq!(
                            frames.duplicates,
                            [by],
                            "{counter:?} {wild} {place} {late}: {frames:?}"
                        );
                        let counted = (frames.lost_frames, frames.restarts.len());
                        assert_eq!(
                            counted,
                            (0, 0),
                            "{counter:?} {wild} {place} {late}: {frames:?}"
                        );
                    }
                }
            }
        }
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
        let frames = sort_out(&stamps, FrameCounter::Bits(4));
        assert_eq!(frames.duplicates, [4, 6]);
        assert_eq!(frames.lost_frames, 10);
        assert_eq!(frames.renumbered, [0; 0]);
        // Without the width the second 14 is the same, and the wrap is no duplicate yet.
        assert_eq!(sort_out(&stamps, FrameCounter::Rises).duplicates, [4, 6]);
    }

    #[test]
    fn frames_within_a_microsecond_turn_no_counter_back() {
        // Four bits, over the turn: two within half a microsecond, three at one time, one that comes again at once.
        let stamps = stamps(&[
            (12, 0.0),
            (13, 0.5),
            (14, 40.0),
            (15, 40.0),
            (0, 40.0),
            (1, 80.0),
            (2, 80.9),
            (1, 80.0),
            (12, 0.0),
            (4, 160.0),
            (3, 159.5),
        ]);
        let frames = sort_out(&stamps, FrameCounter::Bits(4));
        assert_eq!(frames.numbers, [12, 13, 14, 15, 16, 17, 18, 20, 19]);
        assert_eq!(frames.duplicates, [7, 8]);
        assert_eq!(frames.lost_frames, 0);
    }

    #[test]
    fn a_wild_time_does_not_shift_the_count_of_those_behind_it() {
        for wild in [9e15, -9e15] {
            for place in [0, 5, 14, 39] {
                // Four bits, two turns and a half; 12 lost, one repetition.
                let mut seen: Vec<(u64, f64)> =
                    (0..40).map(|i| (i % 16, 10.0 * i as f64)).collect();
                seen[place].1 = wild;
                seen.remove(12);
                seen.insert(30, seen[29]);
                let frames = sort_out(&stamps(&seen), FrameCounter::Bits(4));
                assert_eq!(frames.duplicates, [30], "{wild} at {place}");
                assert_eq!(frames.lost_frames, 1, "{wild} at {place}");
                assert_eq!(frames.renumbered, [0; 0], "{wild} at {place}");
            }
        }
        // A counter that starts anew behind a wild one.
        let seen = [
            (5, 0.0),
            (6, 9e15),
            (7, 20.0),
            (8, 30.0),
            (1, 40.0),
            (2, 50.0),
            (3, 60.0),
        ];
        let frames = sort_out(&stamps(&seen), FrameCounter::Restarts);
        assert_eq!((frames.restarts, frames.duplicates), (vec![4], vec![]));
    }

    /// Without the width of a counter that wraps, or word that it starts anew, each of its runs is counted by itself: what
    /// lies between the old numbers and the new ones was not lost.
    #[test]
    fn losses_are_counted_within_each_run_of_the_counter() {
        let lost = |frames: &[u64]| {
            let seen: Vec<(u64, f64)> = (frames.iter().enumerate())
                .map(|(i, frame)| (*frame, 100.0 * i as f64))
                .collect();
            let frames = sort_out(&stamps(&seen), FrameCounter::Rises);
            (frames.lost_frames, frames.restarts.len())
        };
        // 16 bits, a hundred frames, one lost behind the wrap; one before; none.
        let wraps = |i: u64| (65_500 + i) % 65_536;
        let without = |lost: &[u64]| -> Vec<u64> {
            (0..100).filter(|i| !lost.contains(i)).map(wraps).collect()
        };
        assert_eq!(lost(&without(&[50])), (1, 1));
        assert_eq!(lost(&without(&[10, 11, 60])), (3, 1));
        assert_eq!(lost(&without(&[])), (0, 1));
        // From 1000 and from a million on, and then anew from 0; the third start, with losses in each part.
        let anew = |from: u64| -> Vec<u64> {
            (0..100)
                .map(|i| if i < 50 { from + i } else { i - 50 })
                .collect()
        };
        assert_eq!(lost(&anew(1000)), (0, 1));
        assert_eq!(lost(&anew(1_000_000)), (0, 1));
        assert_eq!(lost(&anew(0)), (0, 1));
        assert_eq!(lost(&[10, 12, 13, 1, 2, 5, 0, 1, 2, 3, 9]), (1 + 2 + 5, 2));
        // A frame that comes again with a wrong time starts nothing, and what was lost about it counts.
        assert_eq!(lost(&[1, 2, 3, 5, 2, 6, 7, 9]).0, 2);
    }

    #[test]
    fn a_counter_that_starts_anew_is_told_from_repetitions() {
        let stamps = stamps(&[(1, 0.0), (2, 10.0), (1, 500.0), (2, 510.0)]);
        let frames = sort_out(&stamps, FrameCounter::Rises);
        assert_eq!(frames.duplicates, [2, 3]);
        assert_eq!(frames.renumbered, [2, 3]);
        assert_eq!(frames.restarts, [2]);
    }

    #[test]
    fn behind_a_restart_profiles_are_their_own_and_repetitions_are_found() {
        // 5, 6, 8; anew with 1, 1 again, 2, late 6 and 8 of before, 4; anew with 3, 8.
        let stamps = stamps(&[
            (5, 0.0),
            (6, 10.0),
            (8, 30.0),
            (1, 500.0),
            (1, 500.0),
            (2, 510.0),
            (6, 10.0),
            (8, 30.0),
            (4, 530.0),
            (3, 900.0),
            (8, 950.0),
        ]);
        let frames = sort_out(&stamps, FrameCounter::Restarts);
        assert_eq!(frames.duplicates, [4, 6, 7]);
        assert_eq!(frames.renumbered, [0; 0]);
        assert_eq!(frames.restarts, [3, 9]);
        assert_eq!(frames.stamps.len(), 8);
        // 7, 3 behind the first start, and 4 to 7 behind the second.
        assert_eq!(frames.lost_frames, 6);
        // A counter that never starts anew is as it always was, misplaced frames included.
        let rising = [
            (7, 0.0),
            (8, 10.0),
            (10, 30.0),
            (9, 20.0),
            (8, 10.0),
            (12, 50.0),
        ];
        let rising = self::stamps(&rising);
        let counters = [FrameCounter::Rises, FrameCounter::Restarts];
        let [plain, anew] = counters.map(|counter| sort_out(&rising, counter));
        assert_eq!(plain, anew);
        assert_eq!(plain.restarts, [0; 0]);
    }
}
