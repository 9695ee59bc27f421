//! A jump of the sensor's clock within the scan: what is before it and what is behind it want a shift each.

use std::ops::Range;

use super::search::{Reaches, reaches};
use super::streams::Streams;
use crate::ScanError;
use crate::profile::Stamp;
use crate::profile::frames::Frames;

/// Steps of a search that only says why: a part of a second.
const STEPS: u64 = 200_000_000;
/// Fewer profiles behind or before a step are single faults, and within so many its place is known.
const FEWEST: usize = 8;
/// So many of the largest steps are looked at where nothing is paired.
const LOOKED_AT: usize = 3;

/// Where the clock jumps.
pub(super) struct ClockJump {
    /// In words.
    pub text: String,
    /// The profiles on its other side than most of what is paired, where what one of them meets is chance; and the few next
    /// to it, since one that meets something by chance there moves the place.
    pub strangers: Range<usize>,
}

/// Where the clock jumps, if it does. `found`: the latch of each profile; none where nothing was paired.
///
/// A clock that goes back and stays there has jumped. Any other step may be a pause: it is a jump where one side of it is
/// paired and the other is not, or neither, and each has a shift of its own that explains most of it.
pub(super) fn clock_jump(
    streams: &Streams<'_>,
    found: Option<&[Option<usize>]>,
) -> Option<ClockJump> {
    let stamps = &streams.frames.stamps;
    let behind_of = |place: &usize| stamps.len() - place;
    let mut places: Vec<usize> = (1..stamps.len())
        .filter(|place| *place >= FEWEST && behind_of(place) >= FEWEST)
        .collect();
    let candidates = match found {
        Some(found) => {
            let parted = parted(found).into_iter();
            parted.filter(|place| places.contains(place)).collect()
        }
        None => {
            let step_us = |place: usize| (stamps[place].t_us - stamps[place - 1].t_us).abs();
            places.sort_by(|&a, &b| step_us(b).total_cmp(&step_us(a)));
            places.truncate(LOOKED_AT);
            places
        }
    };
    candidates
        .into_iter()
        .find(|&place| is_jump(streams, place, found))
        .map(|place| ClockJump {
            text: format!(
                "clock_jump: with profile {} the sensor's clock jumps: it goes from {} to {} µs, and what is before and behind that \
                 fits no one shift{}: pair the two parts as scans of their own",
                stamps[place].profile,
                stamps[place - 1].t_us,
                stamps[place].t_us,
                if found.is_some() {
                    "; the shorter part is left out, and what stands next to the jump"
                } else {
                    ""
                }
            ),
            strangers: match found {
                Some(found) if is_first_paired(found, place) => place - FEWEST..stamps.len(),
                Some(_) => 0..place + FEWEST,
                None => 0..0,
            },
        })
}

fn paired(found: &[Option<usize>]) -> usize {
    found.iter().flatten().count()
}

/// Whether most pairs are before this place.
fn is_first_paired(found: &[Option<usize>], place: usize) -> bool {
    paired(&found[..place]) > paired(&found[place..])
}

/// Where what is paired parts best from what is not: paired before, and paired behind.
fn parted(found: &[Option<usize>]) -> [usize; 2] {
    let (mut sum, mut most, mut least) = (0_i64, (0, 0), (0, 0));
    for (place, latch) in (1..).zip(found) {
        sum += if latch.is_some() { 1 } else { -1 };
        most = most.max((sum, place));
        least = least.min((sum, place));
    }
    [most.1, least.1]
}

fn is_jump(streams: &Streams<'_>, place: usize, found: Option<&[Option<usize>]>) -> bool {
    let stamps = &streams.frames.stamps;
    let (before, behind) = stamps.split_at(place);
    if let Some(found) = found {
        let (first, second) = found.split_at(place);
        let (most, fewest, left) = if is_first_paired(found, place) {
            (paired(first), paired(second), behind)
        } else {
            (paired(second), paired(first), before)
        };
        return 2 * most > stamps.len() - left.len()
            && 10 * fewest <= left.len()
            && (goes_back(before, behind) || fits(streams, left));
    }
    goes_back(before, behind) || (fits(streams, before) && fits(streams, behind))
}

/// Whether all of the next profiles are earlier than all of the last ones before.
fn goes_back(before: &[Stamp], behind: &[Stamp]) -> bool {
    let last = before[before.len() - FEWEST..].iter().map(|s| s.t_us);
    let next = behind[..FEWEST].iter().map(|s| s.t_us);
    next.fold(f64::NEG_INFINITY, f64::max) < last.fold(f64::INFINITY, f64::min)
}

/// Whether one shift explains most of these profiles.
fn fits(streams: &Streams<'_>, stamps: &[Stamp]) -> bool {
    let frames = Frames {
        stamps: stamps.to_vec(),
        duplicates: Vec::new(),
        renumbered: Vec::new(),
        restarts: Vec::new(),
        lost_frames: 0,
    };
    let part: Result<Streams<'_>, ScanError> =
        Streams::new(&frames, streams.triggers, streams.options);
    part.is_ok_and(|part| {
        let trains = part.within_reach(1.0).trains;
        let most = (stamps.len() * 4).div_ceil(5);
        matches!(reaches(&trains, most, STEPS), Reaches::Yes(_))
    })
}
