//! Places at which the sensor's clock and its frame counter disagree about how many triggers went by.
//!
//! A sensor that misses a trigger does not count it; its clock goes on. In a train as even as a clock a jump of that clock by
//! whole intervals looks the same, and then all that is behind it is paired as many triggers off. Nothing in the times tells
//! the two apart, so that it is said.

use super::streams::Streams;
use super::trains::median_interval;

/// So many different sizes of skips are looked at.
const SIZES: usize = 16;

/// The warning, where behind such a place the triggers that a jump of the clock would mean explain as many profiles.
pub(super) fn skips(streams: &Streams<'_>, found: &[Option<usize>]) -> Option<String> {
    let board = streams.board_us();
    let interval = median_interval(&board)?;
    let frames = streams.frames;
    // By latch.
    let mut pairs: Vec<(usize, usize)> = found
        .iter()
        .enumerate()
        .filter_map(|(profile, latch)| Some(((*latch)?, profile)))
        .collect();
    pairs.sort_unstable();
    let stands_off = |us: f64| (us - (us / interval).round() * interval).abs();
    let mut places: Vec<(usize, i64)> = Vec::new();
    for (place, pair) in (1..).zip(pairs.windows(2)) {
        let [(from, before), (to, behind)] = [pair[0], pair[1]];
        let us = board[to] - board[from];
        let counted = frames.numbers[behind] - frames.numbers[before];
        // At a new start of the counter nobody knows.
        let starts = frames
            .restarts
            .binary_search(&frames.stamps[behind].profile);
        let is_known = counted > 0 && starts.is_err();
        if is_known && stands_off(us) <= 2.0 * streams.options.jitter_us {
            let triggers = (us / interval).round() as i128;
            let skipped = i64::try_from(triggers - counted).unwrap_or(0);
            if skipped != 0 {
                places.push((place, skipped));
            }
        }
    }
    let mut sizes: Vec<i64> = places.iter().map(|(_, size)| *size).collect();
    sizes.sort_unstable_by_key(|size| (size.abs(), *size));
    sizes.dedup();
    sizes.truncate(SIZES);
    let unexplained = found.len() - pairs.len();
    // What a lost latch takes from either pairing differs by chance.
    let chance = (3.0 * (2.0 * unexplained as f64).sqrt()).ceil() as usize;
    let mut open: Vec<(usize, i64)> = Vec::new();
    for size in sizes {
        let fits = |&(latch, profile): &(usize, usize)| {
            let at = board[latch] - size as f64 * interval;
            let begin = board.partition_point(|&t| t < at - streams.options.jitter_us);
            let is_near = |&&t: &&f64| t <= at + streams.options.jitter_us;
            board[begin..].first().filter(is_near).is_some()
                && streams.agree((profile, latch), (profile, begin))
        };
        // How many of the pairs from each place on fit so many triggers earlier.
        let mut fit = vec![0; pairs.len() + 1];
        for place in (0..pairs.len()).rev() {
            fit[place] = fit[place + 1] + usize::from(fits(&pairs[place]));
        }
        let of_size = places.iter().filter(|(_, of)| *of == size);
        open.extend(of_size.filter(|(place, _)| fit[*place] + chance >= pairs.len() - place));
    }
    let &(place, size) = open.iter().min()?;
    let [before, behind] = [place - 1, place].map(|place| frames.stamps[pairs[place].1].profile);
    let counted = match size {
        1.. => format!("{size} more than its frame counter: the sensor missed them"),
        _ => format!("{} fewer than its frame counter", size.unsigned_abs()),
    };
    let others = match open.len() {
        1 => String::new(),
        n => format!(", and {} such places more", n - 1),
    };
    Some(format!(
        "skipped: between profiles {before} and {behind} the sensor's clock counts {} of an even train, {counted}{others}. If its \
         clock jumped there, all profiles behind are as many triggers off, and nothing here shows it: {}",
        if size.abs() == 1 {
            "a trigger"
        } else {
            "triggers"
        },
        streams.advice(),
    ))
}
