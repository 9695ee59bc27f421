//! Which profile belongs to which latch.
//!
//! The clocks of sensor and board differ by an unknown offset and an unknown small drift.
//! The right pairing is that of the shift of the clocks that explains more profiles than
//! any other (`search`); a tie is refused unless a narrower jitter decides it (`narrower`), and so is what explains less
//! than half of the shorter stream, or drifts by more than allowed. The sensor's frame counter sorts out duplicates before,
//! and where the sensor counts an axis too, encoder less counts must be the same for all pairs.
//!
//! It never pairs by order: a lost trigger, latch or profile shifts nothing.
//!
//! The frame counter alone pairs nothing, however the clock is. Nobody knows to which pulse its first frame
//! belongs: a sensor that is armed late, or misses a pulse while it is busy, counts on from there. In an even train
//! it says what the clock says already, the time in periods. A clock that stands, or is too coarse, is named
//! (`no_match`).
//!
//! # Limitations
//! A noise edge within the jitter of an edge whose own latch was missed is taken for it:
//! nothing tells them apart but a narrower jitter. Where both edges have a latch, or both a profile, the shift is settled
//! all the same, and what is near two of the other is left unpaired and named (`doubtful`).

mod apart;
mod blame;
mod clock;
mod even;
mod margin;
mod narrower;
mod search;
#[cfg(test)]
mod simulated;
mod skips;
mod streams;
mod trains;

use serde::Serialize;

pub use clock::ClockFit;
pub use streams::PairOptions;

use crate::ScanError;
use crate::format::triggers::Triggers;
use crate::profile::Stamp;
use crate::profile::frames::{FrameCounter, Frames, WildFirst, sort_out};
use blame::{encoder, jump, units};
use narrower::Narrower;
use search::SearchOutcome;
use streams::{Reach, Streams};
use trains::near_two::{self, NearTwo};

/// A profile and its latch.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Pair {
    /// The profile's place in the stream.
    pub profile: u64,
    /// Its frame, as the file has it.
    pub frame: u64,
    /// The number of the latch.
    pub number: u64,
    /// The place of the latch in the table.
    #[serde(skip)]
    pub latch: usize,
}

/// The answer of `umi scan pair`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ScanPairing {
    /// By profile.
    pub pairs: Vec<Pair>,
    /// Profiles without a latch: extra, misplaced, or their latch was lost.
    pub unpaired_profiles: Vec<u64>,
    /// Those of the unpaired profiles that have a latch within the jitter: another latch or profile is as near.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub doubtful: Vec<u64>,
    /// Profiles whose frame was there before; or came again, where the first had a wrong time.
    pub duplicates: Vec<u64>,
    /// Those of the duplicates that have another time than the first of their frame: profiles of their own, behind a
    /// counter that wrapped or started anew.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub renumbered: Vec<u64>,
    /// Profiles with which the sensor's counter started anew.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub restarts: Vec<u64>,
    /// Numbers of latches without a profile.
    pub unpaired_triggers: Vec<u64>,
    /// Numbers that are missing between the first and the last of the frame counter, of each of its starts by itself.
    pub lost_frames: u64,
    /// Latches that the table says are missing.
    pub missed_latches: u64,
    /// `board = offset + (1 + drift·1e-6) · sensor`.
    pub clock: ClockFit,
    /// What is odd, but no reason to refuse.
    pub warnings: Vec<String>,
}

/// Pairs profiles with latches.
///
/// # Errors
/// `no_profiles`, `frame_bits`, `no_match`, `ambiguous_pairing`, `missing_axis`, `no_encoder`; `faults`
/// with [`PairOptions::strict`].
pub fn pair(
    stamps: &[Stamp],
    triggers: &Triggers,
    options: &PairOptions,
) -> Result<ScanPairing, ScanError> {
    if stamps.is_empty() {
        return Err(ScanError::refused("no_profiles", "there is no profile"));
    }
    refuse_narrow(stamps, options.counter)?;
    let frames = sort_out(stamps, options.counter);
    let streams = Streams::new(&frames, triggers, options)?;
    if let Some(error) = units::other_unit(&streams) {
        return Err(error);
    }
    let stamps_seen = frames.stamps.len();
    let reach = streams.within_reach(1.0);
    let trains = &reach.trains;
    let mut by_less_jitter = None;
    let found = match search::search(trains) {
        SearchOutcome::Only(found) => found,
        SearchOutcome::Tie {
            explained,
            runner_up,
        } => {
            let less = narrower::narrower(trains, explained);
            if let Narrower::Decides(found, jitter_us) = less {
                by_less_jitter = Some(format!(
                    "jitter: within {} µs two shifts of the clocks explain {explained} and {runner_up} profiles; within \
                     {jitter_us:.1} µs one alone does, by more than chance, and is taken. Give a narrower --jitter-us",
                    options.jitter_us
                ));
                found
            } else {
                let why = jump::back(&streams).or_else(|| encoder::is_why(&streams, explained));
                return Err(ambiguous(why.unwrap_or_else(|| {
                    format!(
                        "of {stamps_seen} profiles one shift of the clocks explains {explained}, another {runner_up}, and the \
                         faults leave both possible: {}{}{}",
                        streams.advice(),
                        by_jitter(&less, trains, options.jitter_us),
                        left_out(&frames)
                    )
                })));
            }
        }
        SearchOutcome::Undecided => {
            let why = jump::back(&streams);
            return Err(ambiguous(why.unwrap_or_else(|| {
                format!(
                    "the rhythm of the triggers is too even, or the jitter too wide, to find the only best pairing in \
                     reasonable time: {}; or give a narrower --jitter-us",
                    streams.advice()
                )
            })));
        }
        SearchOutcome::Beyond { drift, explained } => {
            return Err(ScanError::refused(
                "no_match",
                format_args!(
                    "{} --drift-ppm {}: {}",
                    "the shift that explains most profiles drifts by more than",
                    options.drift_ppm,
                    drifts(drift, explained, stamps_seen)
                ),
            ));
        }
        SearchOutcome::NoMatch => return Err(no_match(&streams, &reach)),
    };
    let doubts = near_two::all(trains, &found, trains.clock(&found).centred);
    let mut told = found.clone();
    let in_doubt = doubts.iter().flat_map(NearTwo::profiles);
    in_doubt.for_each(|profile| told[profile] = None);
    let in_words = doubts.first().map(|first| {
        let profile = |profile: usize| frames.stamps[reach.profiles[profile]].profile;
        let latch = |latch: usize| triggers.latches[reach.latches[latch]].number;
        first.in_words(profile, latch, options.jitter_us)
    });
    if let Some(words) = &in_words
        && told.iter().flatten().count() < trains.need()
    {
        return Err(ambiguous(format!(
            "{words}; so are so many others that less than half is left: give a narrower --jitter-us"
        )));
    }
    let clock = trains.clock(&told);
    let told = reach.of_all(&told, stamps_seen);
    let mut of_all = reach.of_all(&found, stamps_seen);
    let jump = jump::among_pairs(&streams, &of_all);
    if let Some(jump) = &jump {
        of_all[jump.strangers.clone()].fill(None);
    }
    // What is in doubt is part of the shift, and says where the sensor missed a trigger; it is no pair.
    let pairs: Vec<Option<usize>> = (of_all.iter().zip(&told))
        .map(|(latch, told)| latch.filter(|_| told.is_some()))
        .collect();
    let mut pairing = answer(&pairs, &frames, triggers, clock);
    let mut doubtful: Vec<u64> = (doubts.iter().flat_map(NearTwo::profiles))
        .map(|profile| frames.stamps[reach.profiles[profile]].profile)
        .collect();
    doubtful.sort_unstable();
    doubtful.dedup();
    pairing.doubtful = doubtful;
    let even = even::even_train(trains, &found, &streams.advice());
    if options.strict {
        refuse_faults(&pairing, triggers, even.as_deref())?;
    }
    let explained = of_all.iter().flatten().count();
    let odd = encoder::is_why(&streams, explained).or(jump.map(|jump| jump.text));
    pairing
        .warnings
        .extend(odd.or_else(|| reach.apart(&streams)));
    pairing.warnings.extend(frames.wild.iter().map(came_again));
    pairing.warnings.extend(in_words.map(|words| {
        format!(
            "doubtful: {} profiles are left unpaired, since nothing but a narrower --jitter-us tells what is theirs: {words}",
            pairing.doubtful.len()
        )
    }));
    pairing.warnings.extend(by_less_jitter);
    pairing.warnings.extend(even);
    pairing.warnings.extend(skips::skips(&streams, &of_all));
    if triggers.right_until_ns.is_some() {
        pairing.warnings.push(format!(
            "motion_lost: the board lost motion of an axis; the counts of {} latches behind that are wrong",
            triggers.latches.len() - triggers.right()
        ));
    }
    Ok(pairing)
}

fn came_again(wild: &WildFirst) -> String {
    format!(
        "misplaced: profile {} at {} µs has a time that is wrong, as the frames about it say; its frame came again as profile {}, \
         which is taken",
        wild.first.profile, wild.first.t_us, wild.again
    )
}

/// Refuses a counter of fewer bits than its numbers have.
fn refuse_narrow(stamps: &[Stamp], counter: FrameCounter) -> Result<(), ScanError> {
    let FrameCounter::Bits(bits) = counter else {
        return Ok(());
    };
    let needs = |stamp: &Stamp| u64::BITS - stamp.frame.leading_zeros();
    let most = stamps.iter().max_by_key(|stamp| stamp.frame);
    let Some(most) = most.filter(|stamp| needs(stamp) > bits) else {
        return Ok(());
    };
    Err(ScanError::refused(
        "frame_bits",
        format_args!(
            "profile {} has the frame {}, which {bits} bits cannot show: give --frame-bits {} or more, as the sensor's counter has",
            most.profile,
            most.frame,
            needs(most)
        ),
    )
    .with("frame", most.frame)
    .with("bits", needs(most)))
}

fn answer(
    found: &[Option<usize>],
    frames: &Frames,
    triggers: &Triggers,
    clock: ClockFit,
) -> ScanPairing {
    let mut pairs = Vec::with_capacity(found.len());
    let mut unpaired_profiles = Vec::new();
    let mut taken = vec![false; triggers.latches.len()];
    for (stamp, latch) in frames.stamps.iter().zip(found) {
        match *latch {
            Some(latch) => {
                taken[latch] = true;
                pairs.push(Pair {
                    profile: stamp.profile,
                    frame: stamp.frame,
                    number: triggers.latches[latch].number,
                    latch,
                });
            }
            None => unpaired_profiles.push(stamp.profile),
        }
    }
    let unpaired_triggers = taken
        .iter()
        .zip(&triggers.latches)
        .filter(|(taken, _)| !**taken)
        .map(|(_, latch)| latch.number)
        .collect();
    let mut warnings = Vec::new();
    if !frames.renumbered.is_empty() {
        warnings.push(format!(
            "frame_counter: {} profiles are left out because their frame number was there before, at another time: the \
             counter wrapped (give --frame-bits) or started anew (give --counter-restarts){}",
            frames.renumbered.len(),
            if frames.restarts.is_empty() {
                ""
            } else {
                "; frames that were lost about that moment are not counted"
            }
        ));
    } else if let Some(first) = frames.restarts.first() {
        warnings.push(format!(
            "frame_counter: the sensor's counter started anew with profile {first}{}; frames that were lost about that moment \
             are not counted",
            match frames.restarts.len() {
                1 => String::new(),
                more => format!(" and {} others", more - 1),
            }
        ));
    }
    ScanPairing {
        pairs,
        unpaired_profiles,
        doubtful: Vec::new(),
        duplicates: frames.duplicates.clone(),
        renumbered: frames.renumbered.clone(),
        restarts: frames.restarts.clone(),
        unpaired_triggers,
        lost_frames: frames.lost_frames,
        missed_latches: triggers.missed,
        clock,
        warnings,
    }
}

fn ambiguous(why: String) -> ScanError {
    ScanError::refused("ambiguous_pairing", why)
}

/// What a drift beyond the limit would explain, and how to ask for it.
fn drifts(drift: f64, explained: usize, profiles: usize) -> String {
    format!(
        "a drift of {:+.1} ppm explains {explained} of {} profiles; if the clocks may differ so much, give \
         --drift-ppm {:.0}",
        drift * 1e6,
        profiles,
        (drift.abs() * 1.1e6).ceil()
    )
}

/// How much more drift than asked for is tried, to say why nothing matches, and in how many steps.
const MORE_DRIFT: f64 = 10.0;
const MORE_DRIFT_STEPS: u64 = 200_000_000;

fn no_match(streams: &Streams<'_>, reach: &Reach) -> ScanError {
    let (frames, options, trains) = (streams.frames, streams.options, &reach.trains);
    let mut why = format!(
        "no shift of the clocks explains half of {} profiles and {} latches within {} µs and {} ppm",
        frames.stamps.len(),
        streams.triggers.latches.len(),
        options.jitter_us,
        options.drift_ppm
    );
    why += &left_out(frames);
    if let Some(encoder) = encoder::is_why(streams, 0) {
        return ScanError::refused("no_match", format!("{why}; {encoder}"));
    }
    if let Some(bad) = bad_clock(frames, options.jitter_us) {
        why += &format!(
            "; {bad}. The frame counter cannot stand for the times: it counts frames, and nobody knows to which pulse the first \
             belongs"
        );
    }
    let more = trains.within(MORE_DRIFT * trains.drift.max(1e-6));
    if let SearchOutcome::Only(found) = search::search_in(&more, MORE_DRIFT_STEPS) {
        let explained = found.iter().flatten().count();
        let drift = more.clock(&found).drift_ppm * 1e-6;
        why += &format!("; {}", drifts(drift, explained, frames.stamps.len()));
    }
    let (hints, factor) = units::hints(streams, reach);
    why += &hints;
    let odd = jump::of_no_match(streams).or_else(|| reach.apart(streams));
    why += &odd.map_or(String::new(), |odd| format!("; {odd}"));
    let refused = ScanError::refused("no_match", why);
    match factor {
        Some(factor) => refused.with("factor", factor),
        None => refused,
    }
}

/// Triggers that are closer than so many jitters are met by chance.
const NEAR: f64 = 8.0;

/// What a narrower jitter may do for a tie, in words behind other advice; nothing where it can do nothing.
fn by_jitter(less: &Narrower, trains: &trains::Trains, jitter_us: f64) -> String {
    let close = trains.closest_us().filter(|us| *us < NEAR * jitter_us);
    match (less, close) {
        (Narrower::Leaves(us), _) => format!(
            "; or give --jitter-us {us:.1}, with which one of them alone is left, if the clocks agree so well"
        ),
        (_, Some(us)) => format!(
            "; or give a narrower --jitter-us: triggers come within {us:.0} µs of each other, and the jitter is {jitter_us} µs \
             to either side"
        ),
        _ => String::new(),
    }
}

/// That profiles were left out by their numbers, and what to do.
fn left_out(frames: &Frames) -> String {
    if frames.renumbered.is_empty() {
        return String::new();
    }
    format!(
        "; {} profiles were left out because their frame number was there before: if the counter wraps, give --frame-bits; if it \
         started anew, --counter-restarts",
        frames.renumbered.len()
    )
}

/// That the sensor's clock stands still, or shows whole steps that are wider than the jitter.
fn bad_clock(frames: &Frames, jitter_us: f64) -> Option<String> {
    let mut times: Vec<f64> = frames.stamps.iter().map(|stamp| stamp.t_us).collect();
    times.sort_by(f64::total_cmp);
    let apart = times.windows(2).map(|pair| pair[1] - pair[0]);
    let steps: Vec<f64> = apart.filter(|us| *us > 0.0).collect();
    let n = times.len();
    if n > 2 && 2 * steps.len() < n {
        return Some(format!(
            "the sensor's clock stands still, or is too coarse: {n} profiles have {} times",
            steps.len() + 1
        ));
    }
    // The widest step that all whole microseconds between profiles are multiples of.
    let whole = steps.iter().all(|us| us.fract() == 0.0 && *us < 1e15);
    let common = |a: u64, b: u64| {
        let (mut a, mut b) = (a, b);
        while b > 0 {
            (a, b) = (b, a % b);
        }
        a
    };
    let step = steps.iter().fold(0, |step, us| common(step, *us as u64));
    // Half of it to either side, and something for what else is unsharp.
    let within_us = 0.6 * step as f64;
    // An even train has steps of its own, as wide as its intervals.
    let shortest = steps.iter().copied().fold(f64::INFINITY, f64::min);
    let is_coarse = whole && within_us > jitter_us && 2.0 * step as f64 <= shortest;
    (is_coarse && n > 10).then(|| {
        format!(
            "the profiles' times come in steps of {step} µs: give --jitter-us {within_us:.0} or more, if that is still less than \
             half of the shortest interval"
        )
    })
}

fn refuse_faults(
    pairing: &ScanPairing,
    triggers: &Triggers,
    even: Option<&str>,
) -> Result<(), ScanError> {
    let faults = [
        (pairing.unpaired_profiles.len() as u64, "unpaired profiles"),
        (pairing.doubtful.len() as u64, "doubtful profiles"),
        (pairing.duplicates.len() as u64, "duplicates"),
        (pairing.unpaired_triggers.len() as u64, "unpaired triggers"),
        (pairing.lost_frames, "lost frames"),
        (pairing.missed_latches, "missed latches"),
        (pairing.restarts.len() as u64, "restarts of the counter"),
        (
            u64::from(triggers.right_until_ns.is_some()),
            "loss of motion",
        ),
    ];
    let named: Vec<String> = faults
        .iter()
        .filter(|(count, _)| *count > 0)
        .map(|(count, what)| format!("{count} {what}"))
        .chain(even.map(str::to_owned))
        .collect();
    if named.is_empty() {
        return Ok(());
    }
    Err(ScanError::refused(
        "faults",
        format_args!("--strict takes no fault: {}", named.join(", ")),
    ))
}
