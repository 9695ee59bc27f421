//! A jump of the sensor's clock within the scan: what is before it and what is behind it want a shift each.

use std::ops::Range;

use crate::pair::search::{Reaches, reaches};
use crate::pair::streams::Streams;
use crate::profile::Stamp;
use crate::profile::frames::Frames;

/// Steps of a search that only says why: a part of a second.
const STEPS: u64 = 200_000_000;
/// Fewer profiles behind or before a step are single faults, and within so many its place is known.
const FEWEST: usize = 8;
/// So many of the largest steps are looked at where nothing is paired.
const LOOKED_AT: usize = 3;

/// Where the clock jumps.
pub(in crate::pair) struct ClockJump {
    /// In words.
    pub text: String,
    /// The profiles on its other side than most of what is paired, where what one of them meets is chance; and the few next
    /// to it, since one that meets something by chance there moves the place.
    pub strangers: Range<usize>,
}

/// Where the clock jumps, if it does, by the latch of each profile.
///
/// Of the profiles on one side nearly all have a latch and on the other nearly none, though one shift explains most of those
/// by the latches that are left, or the clock goes back there. Without such latches the board has ended first, or begun later.
pub(in crate::pair) fn among_pairs(
    streams: &Streams<'_>,
    found: &[Option<usize>],
) -> Option<ClockJump> {
    let stamps = &streams.frames.stamps;
    let mut is_left = vec![true; streams.triggers.latches.len()];
    found
        .iter()
        .flatten()
        .for_each(|&latch| is_left[latch] = false);
    let paired = |found: &[Option<usize>]| found.iter().flatten().count();
    parted(found).into_iter().find_map(|place| {
        let (before, behind) = sides(stamps, place)?;
        let (first, second) = found.split_at(place);
        let (first, second) = (paired(first), paired(second));
        let (most, kept, fewest, left, strangers) = if first > second {
            (first, before, second, behind, place - FEWEST..stamps.len())
        } else {
            (second, behind, first, before, 0..place + FEWEST)
        };
        let is_parted = 2 * most > kept.len() && 10 * fewest <= left.len();
        let is_jump =
            is_parted && (goes_back(before, behind) || fits(streams, left, |latch| is_left[latch]));
        is_jump.then(|| ClockJump {
            text: told(
                stamps,
                place,
                "; the shorter part is left out, and what stands next to the jump",
            ),
            strangers,
        })
    })
}

/// Where the clock of a scan jumps that no shift explains: at one of its largest steps, if each side has a shift of its own.
pub(in crate::pair) fn of_no_match(streams: &Streams<'_>) -> Option<String> {
    let stamps = &streams.frames.stamps;
    largest_steps(stamps)
        .into_iter()
        .find(|&place| {
            sides(stamps, place).is_some_and(|(before, behind)| {
                let any = |_| true;
                goes_back(before, behind)
                    || fits(streams, before, any) && fits(streams, behind, any)
            })
        })
        .map(|place| told(stamps, place, ""))
}

/// Where the clock of a scan goes back and stays there. Of a scan that more than one shift explains nothing else tells: each
/// part of an even train fits somewhere.
pub(in crate::pair) fn back(streams: &Streams<'_>) -> Option<String> {
    let stamps = &streams.frames.stamps;
    largest_steps(stamps)
        .into_iter()
        .find(|&place| {
            sides(stamps, place).is_some_and(|(before, behind)| goes_back(before, behind))
        })
        .map(|place| told(stamps, place, ""))
}

fn told(stamps: &[Stamp], place: usize, left_out: &str) -> String {
    format!(
        "clock_jump: with profile {} the sensor's clock jumps: it goes from {} to {} µs, and what is before and behind that \
         fits no one shift{left_out}: pair the two parts as scans of their own",
        stamps[place].profile,
        stamps[place - 1].t_us,
        stamps[place].t_us,
    )
}

/// What is before a place and what is behind it, if both are more than single faults.
fn sides(stamps: &[Stamp], place: usize) -> Option<(&[Stamp], &[Stamp])> {
    stamps
        .split_at_checked(place)
        .filter(|(before, behind)| before.len() >= FEWEST && behind.len() >= FEWEST)
}

/// The places behind the largest steps.
fn largest_steps(stamps: &[Stamp]) -> Vec<usize> {
    let step_us = |place: usize| (stamps[place].t_us - stamps[place - 1].t_us).abs();
    let mut places: Vec<usize> = (1..stamps.len())
        .filter(|&place| sides(stamps, place).is_some())
        .collect();
    places.sort_by(|&a, &b| step_us(b).total_cmp(&step_us(a)));
    places.truncate(LOOKED_AT);
    places
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

/// Whether all of the next profiles are earlier than all of the last ones before.
fn goes_back(before: &[Stamp], behind: &[Stamp]) -> bool {
    let last = before[before.len() - FEWEST..].iter().map(|s| s.t_us);
    let next = behind[..FEWEST].iter().map(|s| s.t_us);
    next.fold(f64::NEG_INFINITY, f64::max) < last.fold(f64::INFINITY, f64::min)
}

/// Whether one shift explains most of these profiles by these latches.
fn fits(streams: &Streams<'_>, stamps: &[Stamp], is_meant: impl Fn(usize) -> bool) -> bool {
    let frames = Frames {
        stamps: stamps.to_vec(),
        ..Frames::default()
    };
    let mut triggers = streams.triggers.clone();
    let mut latch = 0..;
    triggers
        .latches
        .retain(|_| latch.next().is_some_and(&is_meant));
    let most = (stamps.len() * 4).div_ceil(5);
    Streams::new(&frames, &triggers, streams.options).is_ok_and(|part| {
        let trains = part.within_reach(1.0).trains;
        matches!(reaches(&trains, most, STEPS), Reaches::Yes(_))
    })
}
