//! How two programs differ as motions: each motion of the first, carried by a transform, and
//! what the second makes of it.
//!
//! An end of the first program is found in the second in order; between, any number of
//! motions may stand (an arc as chords). What is measured is how far these stray from the image of
//! the first program's way, walked from its begin to its end: another direction, another centre,
//! a turn too few are as far off as they lie apart. Ends and ways have one limit. Motions in machine
//! coordinates have no image: they must lead to the same places in both programs. An axis that such
//! a motion has left somewhere, or that was never named, stays where it is while the others are
//! compared; where the transform leans, it would move them, and cuts that nobody can compare are no
//! same ones. The way of a motion that brings an axis back is not measured, as nobody knows where it
//! begins.
//!
//! What a program says beside its motions ([`BesideMotions`]) is compared by its text, and has to stand
//! between the same two of the motions that were found.

mod beside;
mod way;

use umi_core::registration::RigidTransform;
use umi_core::units::Point;

pub use beside::{BesideMotions, Depends, ModeUse};
pub use way::{Move, Way};

use way::{Follower, V};

/// Further motions in which an end is looked for.
const WINDOW: usize = 20_000;

/// What is not looked at.
const NOT_COMPARED: &str =
    "feeds, dwells, spindle, coolant, prints, comments and N numbers are not compared";

/// Where the second program lies farthest from the first.
#[derive(Clone, Copy, Debug)]
pub struct Largest {
    /// How far, mm.
    pub mm: f64,
    /// The lines of both programs.
    pub lines: [u32; 2],
    /// The place in the second program, mm.
    pub at_mm: [f64; 3],
}

/// How far one motion is from its image.
#[derive(Clone, Copy, Debug)]
pub struct Deviation {
    /// Its end, mm.
    pub end_mm: f64,
    /// Its way, mm; 0 where that is not measured.
    pub way_mm: f64,
}

/// From when on two programs differ.
#[derive(Clone, Copy, Debug)]
pub struct DiffLimits {
    /// An end is looked for within this, mm.
    pub near_mm: f64,
    /// Ends and ways may lie this far from their images, mm.
    pub within_mm: f64,
}

/// How two programs differ.
#[derive(Clone, Debug)]
pub struct PathDifference {
    /// What counts as different.
    pub limits: DiffLimits,
    /// Motions of both.
    pub moves: [usize; 2],
    /// Motions of both that are left out: `G28`, `G30` or `G53` is in their block, or nobody can say
    /// where they are to be.
    pub away: [usize; 2],
    /// Lines of cuts of both that are left out.
    pub not_compared: [Vec<u32>; 2],
    /// Blocks of the first that the machine places.
    pub sent: usize,
    /// The first motion of each that `G28`, `G30` or `G53` sends elsewhere than the other's, or over
    /// another place, or that the other has not.
    pub sent_elsewhere: [Option<u32>; 2],
    /// Motions of the first whose ends are in the second.
    pub matched: usize,
    /// Those of them whose ways are not measured: they come from a motion that is left out.
    pub from_away: usize,
    /// Lines of the first whose ends are not.
    pub missing: Vec<u32>,
    /// Motions that are cuts in one program only.
    pub other_rate: usize,
    /// Lines of the second whose motions stand before the end of one that comes from a motion
    /// that is left out: they lead elsewhere first.
    pub inserted: Vec<u32>,
    /// Motions of the second behind the last of the first.
    pub left_over: usize,
    /// So many motions of both lead to the same place, or are sent there: what stands between two of
    /// these has to stand there in both.
    pub met: Vec<[usize; 2]>,
    /// What depends on the control, or acts there, in the first only, and in the second only, or
    /// elsewhere in the other.
    pub decides: [Vec<Depends>; 2],
    /// Modes that only one of both takes for granted.
    pub granted: [Vec<Depends>; 2],
    /// Blocks of both that were not run and are not the same in the other, or would have to be moved.
    pub not_run: [Vec<Depends>; 2],
    /// Of the motions that were found, in order.
    pub deviations: Vec<Deviation>,
    /// Root mean square of the deviations of the ends, mm.
    pub rms_mm: f64,
    /// The largest deviation of the ends.
    pub largest_end: Option<Largest>,
    /// The largest deviation of the ways of cuts.
    pub largest_way: Option<Largest>,
    /// The largest deviation of the ways of rapids.
    pub largest_rapid: Option<Largest>,
}

impl PathDifference {
    /// The largest deviation of all.
    fn largest(&self) -> Option<&Largest> {
        let all = [&self.largest_way, &self.largest_rapid, &self.largest_end];
        all.into_iter()
            .flatten()
            .max_by(|a, b| a.mm.total_cmp(&b.mm))
    }

    /// Whether ends and ways lie within the limit.
    #[must_use]
    pub fn is_within(&self) -> bool {
        self.largest()
            .is_none_or(|most| most.mm <= self.limits.within_mm)
    }

    /// Whether every motion has its image within the limit, all the way, and nothing else is
    /// there.
    #[must_use]
    pub fn is_complete(&self) -> bool {
        self.missing.is_empty()
            && self.inserted.is_empty()
            && self.left_over == 0
            && self.other_rate == 0
            && [&self.decides, &self.granted, &self.not_run]
                .iter()
                .all(|of| of.iter().all(Vec::is_empty))
            && !self.is_blind()
            && self.sent_elsewhere == [None; 2]
            && self.is_within()
    }

    /// Whether cuts are left out, or there is nothing that is not.
    fn is_blind(&self) -> bool {
        let is_nothing = self.matched == 0 && self.moves != [0; 2] && self.away == self.moves;
        self.not_compared.iter().any(|lines| !lines.is_empty()) || (is_nothing && self.sent == 0)
    }

    /// The result in one sentence: the same, or by how much it differs, and at which lines.
    #[must_use]
    pub fn in_words(&self) -> String {
        if let Some(line) = self.missing.first() {
            return format!("different: the motion of line {line} is not in the second program");
        }
        if let Some(line) = self.inserted.first() {
            return format!("different: the motion of line {line} is not in the first program");
        }
        if self.left_over > 0 {
            let motions = self.left_over;
            return format!("different: the second program goes on, by {motions} more motions");
        }
        if self.other_rate > 0 {
            let motions = self.other_rate;
            return format!("different: {motions} motions cut in one program only");
        }
        let place = match self.sent_elsewhere {
            [None, None] => None,
            [Some(a), Some(b)] => Some(format!("lines {a} and {b} each send")),
            [Some(line), None] => Some(format!("only line {line} of the first program sends")),
            [None, Some(line)] => Some(format!("only line {line} of the second program sends")),
        };
        if let Some(place) = place {
            return format!("different: {place} an axis somewhere in machine coordinates");
        }
        for (of, other, at) in [("second", "first", 1), ("first", "second", 0)] {
            if let Some(Depends { what, line, .. }) = self.decides[at].first() {
                return format!(
                    "different: line {line} of the {of} program has {what}, and the {other} has it \
                     elsewhere or not at all"
                );
            }
            if let Some(Depends { what, line, .. }) = self.granted[at].first() {
                return format!(
                    "different: line {line} of the {of} program takes {what} for granted, and the \
                     {other} does not"
                );
            }
        }
        for (of, lines) in ["first", "second"].iter().zip(&self.not_compared) {
            if let Some(line) = lines.first() {
                return format!(
                    "not compared: the cut in line {line} of the {of} program: an axis is where G28, G30 \
                     or G53 has sent it, or not named yet, and the part leans; name X, Y and Z before it"
                );
            }
        }
        for (of, blocks) in ["first", "second"].iter().zip(&self.not_run) {
            if let Some(Depends { line, .. }) = blocks.first() {
                return format!(
                    "not compared: line {line} of the {of} program was not run, and with another variable \
                     or switch it would be; compare it by hand"
                );
            }
        }
        if self.is_blind() {
            return "not compared: no motion of the first program is at a place of the part"
                .to_owned();
        }
        let most = self.largest().filter(|most| most.mm >= 5e-7);
        let Some(Largest { mm, lines, .. }) = most else {
            return format!(
                "same: every motion has its image, to less than a nanometre; {NOT_COMPARED}"
            );
        };
        let ([a, b], within) = (lines, self.limits.within_mm);
        if self.is_within() {
            format!(
                "every motion has its image, different by at most {mm:.6} mm at lines {a} and {b}; \
                 {NOT_COMPARED}"
            )
        } else {
            format!("different: by {mm:.6} mm at lines {a} and {b}, more than {within} mm")
        }
    }
}

/// Compares the second program with the image of the first.
#[must_use]
pub fn compare(
    first: &[Move],
    second: &[Move],
    transform: &RigidTransform,
    limits: DiffLimits,
) -> PathDifference {
    let near_mm = limits.near_mm;
    let is_left_out = |made: &&Move| made.by_machine || kept(transform, made.away).is_none();
    let left_out = |moves: &[Move]| moves.iter().filter(is_left_out).count();
    let cuts = |moves: &[Move]| {
        let of = moves.iter().filter(|made| made.is_feed && !made.stands());
        of.filter(is_left_out).map(|made| made.line).collect()
    };
    let [sent_first, sent_second] = [sent(first), sent(second)];
    let mut found = PathDifference {
        limits,
        moves: [first.len(), second.len()],
        away: [left_out(first), left_out(second)],
        not_compared: [cuts(first), cuts(second)],
        sent: sent_first.len(),
        sent_elsewhere: sent_elsewhere(&sent_first, &sent_second, transform, near_mm),
        matched: 0,
        from_away: 0,
        missing: Vec::new(),
        other_rate: 0,
        inserted: Vec::new(),
        left_over: 0,
        met: Vec::new(),
        decides: [Vec::new(), Vec::new()],
        granted: [Vec::new(), Vec::new()],
        not_run: [Vec::new(), Vec::new()],
        deviations: Vec::new(),
        rms_mm: 0.0,
        largest_end: None,
        largest_way: None,
        largest_rapid: None,
    };
    // What goes nowhere is the image of what goes nowhere.
    let all = second;
    let (counts, second): (Vec<usize>, Vec<&Move>) = (1..)
        .zip(second)
        .filter(|(_, made)| !is_left_out(made) && !made.stands())
        .unzip();
    let mut squares = 0.0;
    let mut next = 0_usize;
    // Nobody knows where the first one begins.
    let mut were_away = [true; 3];
    let mut is_lost = true;
    for (count, wanted) in (1..).zip(first) {
        let were_away = core::mem::replace(&mut were_away, wanted.away);
        let Some(kept) = kept(transform, wanted.away).filter(|_| !wanted.by_machine) else {
            is_lost |= !wanted.by_machine;
            continue;
        };
        let image = |p: V| kept.apply(Point { mm: p }).mm;
        let inverse = kept.inverse();
        let back = |p: V| inverse.apply(Point { mm: p }).mm;
        let [_, end] = wanted.ends.map(image);
        let off = |made: &Move| match made.away == wanted.away {
            true => (made.ends[1] - end).norm(),
            false => f64::INFINITY,
        };
        let rest = second.get(next..).unwrap_or_default();
        // What the machine has moved since, is away.
        let before = next.checked_sub(1).and_then(|at| second.get(at));
        let before_mm = before.map_or(f64::INFINITY, |made| {
            let known = |axis: &usize| !wanted.away[*axis];
            let off = |axis| made.ends[1][axis] - end[axis];
            match (0..3).filter(known).any(|axis| made.away[axis]) {
                true => f64::INFINITY,
                false => (0..3)
                    .filter(known)
                    .map(off)
                    .map(|mm: f64| mm * mm)
                    .sum::<f64>()
                    .sqrt(),
            }
        });
        let is_there = before_mm <= near_mm;
        if wanted.stands() && is_there {
            found.matched += 1;
            continue;
        }
        let comes_back = (0..3).any(|axis| were_away[axis] && !wanted.away[axis]);
        let is_from_away = core::mem::take(&mut is_lost) || comes_back;
        // Hardly a way may have been rounded to none.
        let comes = rest.first().is_some_and(|made| off(made) <= near_mm);
        if let Some(before) = before
            && is_there
            && wanted.is_below(limits.within_mm)
            && !comes
        {
            found.matched += 1;
            squares += before_mm * before_mm;
            let lines = [wanted.line, before.line];
            larger(&mut found.largest_end, before_mm, lines, before.ends[1]);
            continue;
        }
        let window = rest.get(..WINDOW.min(rest.len())).unwrap_or_default();
        let Some(mut last) = ends_here(wanted, window, near_mm, off, back) else {
            found.missing.push(wanted.line);
            continue;
        };
        // The nearest of those that come close one after another. What goes farther than between two
        // close places is a motion of its own, as a whole circle.
        while let (Some(now), Some(then)) = (window.get(last), window.get(last + 1))
            && off(then) + 1e-6 < off(now)
            && then.length_mm() <= 2.0 * near_mm
        {
            last += 1;
        }
        let made = rest.get(..=last).unwrap_or_default();
        next += last + 1;
        found.matched += 1;
        found
            .met
            .extend(counts.get(next - 1).map(|there| [count, *there]));
        let other = |part: &&&Move| part.is_feed != wanted.is_feed;
        found.other_rate += made.iter().filter(other).count();
        let Some(part) = made.last() else { continue };
        let end_mm = off(part);
        squares += end_mm * end_mm;
        let lines = [wanted.line, part.line];
        larger(&mut found.largest_end, end_mm, lines, part.ends[1]);
        let mut way_mm = 0.0;
        if is_from_away {
            found.from_away += 1;
            let before = made.split_last().map_or(made, |(_, before)| before);
            found.inserted.extend(before.iter().map(|part| part.line));
        } else {
            let mut follower = Follower::new(wanted);
            let mut line = part.line;
            for part in made {
                let before = follower.strays.mm;
                follower.go(part, back);
                if follower.strays.mm > before {
                    line = part.line;
                }
            }
            let strays = follower.end(back(part.ends[1]));
            way_mm = strays.mm;
            let largest = if wanted.is_feed {
                &mut found.largest_way
            } else {
                &mut found.largest_rapid
            };
            larger(largest, way_mm, [wanted.line, line], image(strays.at));
        }
        found.deviations.push(Deviation { end_mm, way_mm });
    }
    found.left_over = second.len() - next;
    let pairs = sent_first.iter().zip(&sent_second);
    found.met.extend(pairs.map(|(a, b)| [a.count, b.count]));
    found.met.sort_unstable();
    // What one sends behind a motion, and the other before it.
    let crosses = |pair: &&[[usize; 2]]| matches!(pair, [[_, a], [_, b]] if a >= b);
    if found.sent_elsewhere == [None; 2]
        && let Some([_, [a, b]]) = found.met.windows(2).find(crosses)
    {
        let line = |of: &[Move], count: usize| of.get(count - 1).map(|made| made.line);
        found.sent_elsewhere = [line(first, *a), line(all, *b)];
    }
    if found.matched > 0 {
        found.rms_mm = (squares / found.matched as f64).sqrt();
    }
    found
}

/// What a transform makes of the axes that are at places of the part, while those stay that the
/// machine has placed. None where these would move the others.
fn kept(transform: &RigidTransform, away: [bool; 3]) -> Option<RigidTransform> {
    let mut kept = *transform;
    for (axis, _) in away.into_iter().enumerate().filter(|(_, away)| *away) {
        for other in (0..3).filter(|other| !away[*other]) {
            let pair = [(axis, other), (other, axis)];
            if pair.iter().any(|at| transform.rotation[*at].abs() > 1e-12) {
                return None;
            }
        }
        for other in 0..3 {
            let same = f64::from(u8::from(axis == other));
            (kept.rotation[(axis, other)], kept.rotation[(other, axis)]) = (same, same);
        }
        kept.translation_mm[axis] = 0.0;
    }
    // Turned over, nobody knows.
    (kept.rotation.determinant() > 0.0).then_some(kept)
}

/// With which of the motions the wanted one ends: with the first that comes near its end after
/// all turns of it; where none does, with the first that comes near.
fn ends_here(
    wanted: &Move,
    window: &[&Move],
    near_mm: f64,
    off: impl Fn(&Move) -> f64,
    back: impl Fn(V) -> V,
) -> Option<usize> {
    let is_near = |made: &Move| off(made) <= near_mm;
    if matches!(wanted.path, Way::Line) {
        return window.iter().position(|made| is_near(made));
    }
    let mut follower = Follower::new(wanted);
    let mut first_near = None;
    let mut gone_mm = 0.0;
    // What takes a way that much longer takes another.
    let most_mm = 2.0 * wanted.length_mm() + 100.0 * near_mm;
    for (number, made) in window.iter().enumerate() {
        let is_too_long = gone_mm > most_mm;
        if is_too_long && first_near.is_some() {
            break;
        }
        if !is_too_long {
            follower.turn(made, &back);
            gone_mm += made.length_mm();
        }
        if is_near(made) {
            if follower.may_end() {
                return Some(number);
            }
            first_near = first_near.or(Some(number));
        }
    }
    first_near
}

/// A block with `G28`, `G30` or `G53`.
struct Sent<'a> {
    /// Where it begins.
    from: V,
    /// Its last motion: `G28` goes over a place that it names.
    last: &'a Move,
    /// Motions up to that one.
    count: usize,
}

impl Sent<'_> {
    /// How far it leads to the place over which it goes; nothing where it names none.
    fn over(&self) -> V {
        self.last.ends[0] - self.from
    }
}

/// Where `G28`, `G30` and `G53` send axes.
fn sent(moves: &[Move]) -> Vec<Sent<'_>> {
    let mut sent: Vec<Sent<'_>> = Vec::new();
    let mut was_sent = false;
    for (count, made) in (1..).zip(moves) {
        if made.by_machine {
            match sent.last_mut() {
                Some(of) if was_sent && of.last.line == made.line => {
                    (of.last, of.count) = (made, count);
                }
                _ => sent.push(Sent {
                    from: made.ends[0],
                    last: made,
                    count,
                }),
            }
        }
        was_sent = made.by_machine;
    }
    sent
}

/// The lines of the first two that send axes to different places, or over different ones.
fn sent_elsewhere(
    first: &[Sent<'_>],
    second: &[Sent<'_>],
    transform: &RigidTransform,
    near_mm: f64,
) -> [Option<u32>; 2] {
    let differs = |a: &Sent<'_>, b: &Sent<'_>| {
        let (over, a, b) = (transform.rotation * a.over() - b.over(), a.last, b.last);
        over.norm() > near_mm
            || a.away != b.away
            || (0..3)
                .any(|axis| a.away[axis] && (a.ends[1][axis] - b.ends[1][axis]).abs() > near_mm)
    };
    let line = |of: &[Sent<'_>], at: usize| of.get(at).map(|sent| sent.last.line);
    let many = first.len().max(second.len());
    (0..many)
        .find(|at| match (first.get(*at), second.get(*at)) {
            (Some(a), Some(b)) => differs(a, b),
            _ => true,
        })
        .map_or([None; 2], |at| [line(first, at), line(second, at)])
}

fn larger(largest: &mut Option<Largest>, mm: f64, lines: [u32; 2], at: V) {
    if largest.is_none_or(|old| mm > old.mm) {
        *largest = Some(Largest {
            mm,
            lines,
            at_mm: at.into(),
        });
    }
}

#[cfg(test)]
mod tests;
