//! How two programs differ as motions: each motion of the first, carried by a transform, and
//! what the second makes of it.
//!
//! An end of the first program is found in the second in order; between, any number of
//! motions may stand (an arc as chords). What is measured is how far these lie from the image of the
//! first program's way. Motions in machine coordinates, and those with an axis that such a
//! motion has left somewhere, have no image: they are left out.

use nalgebra::{Rotation3, Unit, Vector3};
use umi_core::registration::RigidTransform;
use umi_core::units::Point;

type V = Vector3<f64>;

/// Further motions in which an end is looked for.
const WINDOW: usize = 20_000;

/// The way of a motion.
#[derive(Clone, Copy, Debug)]
pub enum Way {
    /// Straight.
    Line,
    /// On a circle or helix.
    Arc {
        /// A point of the axis, mm.
        center: V,
        /// The axis, a unit vector.
        axis: V,
        /// How far it turns about the axis, right-handed.
        sweep_rad: f64,
    },
}

/// A motion and the line that it comes from; coordinates are those of the work offset, mm.
#[derive(Clone, Debug)]
pub struct Move {
    /// Where it begins and ends.
    pub ends: [V; 2],
    /// Its way.
    pub path: Way,
    /// Whether it cuts.
    pub is_feed: bool,
    /// Line of the program, from 1.
    pub line: u32,
    /// An axis is where `G28`, `G30` or `G53` has sent it, or was not named yet: no place of
    /// the part.
    pub away: bool,
}

impl Move {
    /// The place after this part of the way, 0 to 1.
    #[must_use]
    pub fn at(&self, part: f64) -> V {
        let [from, to] = self.ends;
        match self.path {
            Way::Line => from + (to - from) * part,
            Way::Arc {
                center,
                axis,
                sweep_rad,
            } => {
                let arm = from - center;
                let turn = Rotation3::from_axis_angle(&Unit::new_unchecked(axis), sweep_rad * part);
                center + turn * arm + axis * (axis.dot(&(to - from)) * part)
            }
        }
    }

    /// How many straight pieces draw it.
    #[must_use]
    pub fn pieces(&self) -> u32 {
        match self.path {
            Way::Line => 1,
            Way::Arc { .. } => 64,
        }
    }

    /// Whether it goes nowhere, as the second of two equal blocks.
    fn stands(&self) -> bool {
        self.ends[0] == self.ends[1] && matches!(self.path, Way::Line)
    }

    /// How far a place lies from the way.
    fn distance(&self, place: &V) -> f64 {
        let off = |part: f64| (self.at(part) - place).norm();
        let [from, to] = self.ends;
        if matches!(self.path, Way::Line) {
            let along = to - from;
            let squares = along.norm_squared();
            let part = if squares > 0.0 {
                ((place - from).dot(&along) / squares).clamp(0.0, 1.0)
            } else {
                0.0
            };
            return off(part);
        }
        let steps = 2 * self.pieces();
        let part = |n: u32| f64::from(n) / f64::from(steps);
        let best = (0..=steps)
            .min_by(|a, b| off(part(*a)).total_cmp(&off(part(*b))))
            .unwrap_or(0);
        let (mut low, mut high) = (part(best.saturating_sub(1)), part((best + 1).min(steps)));
        for _ in 0..48 {
            let (a, b) = (low + (high - low) / 3.0, high - (high - low) / 3.0);
            if off(a) < off(b) {
                high = b;
            } else {
                low = a;
            }
        }
        off(f64::midpoint(low, high))
    }
}

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
    /// Its way, mm; 0 for a rapid.
    pub way_mm: f64,
}

/// How two programs differ.
#[derive(Clone, Debug)]
pub struct PathDifference {
    /// Motions of both.
    pub moves: [usize; 2],
    /// Motions of both that are left out: an axis is in machine coordinates.
    pub away: [usize; 2],
    /// Motions of the first whose ends are in the second.
    pub matched: usize,
    /// Lines of the first whose ends are not.
    pub missing: Vec<u32>,
    /// Motions that are cuts in one program only.
    pub other_rate: usize,
    /// Motions of the second behind the last of the first.
    pub left_over: usize,
    /// Of the motions that were found, in order.
    pub deviations: Vec<Deviation>,
    /// Root mean square of the deviations of the ends, mm.
    pub rms_mm: f64,
    /// The largest deviation of the ends.
    pub largest_end: Option<Largest>,
    /// The largest deviation of the ways, cuts only.
    pub largest_way: Option<Largest>,
}

impl PathDifference {
    /// Whether every motion has its image, and nothing else is there.
    #[must_use]
    pub fn is_complete(&self) -> bool {
        self.missing.is_empty() && self.left_over == 0 && self.other_rate == 0
    }

    /// The result in one sentence: the same, or by how much it differs, and at which lines.
    #[must_use]
    pub fn in_words(&self) -> String {
        let most = [&self.largest_end, &self.largest_way];
        let most = most
            .into_iter()
            .flatten()
            .max_by(|a, b| a.mm.total_cmp(&b.mm));
        if let Some(line) = self.missing.first() {
            return format!("different: the motion of line {line} is not in the second program");
        }
        if self.left_over > 0 {
            let motions = self.left_over;
            return format!("different: the second program goes on, by {motions} more motions");
        }
        if self.other_rate > 0 {
            let motions = self.other_rate;
            return format!("different: {motions} motions cut in one program only");
        }
        match most {
            Some(most) if most.mm >= 5e-7 => {
                let [a, b] = most.lines;
                format!(
                    "every motion has its image, different by at most {:.6} mm at lines {a} and {b}",
                    most.mm
                )
            }
            _ => "same: every motion has its image, to less than a nanometre".to_owned(),
        }
    }
}

/// Compares the second program with the image of the first. An end counts as found within
/// `near_mm`.
#[must_use]
pub fn compare(
    first: &[Move],
    second: &[Move],
    transform: &RigidTransform,
    near_mm: f64,
) -> PathDifference {
    let image = |p: V| transform.apply(Point { mm: p }).mm;
    let inverse = transform.inverse();
    let left_out = |moves: &[Move]| moves.iter().filter(|made| made.away).count();
    let mut found = PathDifference {
        moves: [first.len(), second.len()],
        away: [left_out(first), left_out(second)],
        matched: 0,
        missing: Vec::new(),
        other_rate: 0,
        left_over: 0,
        deviations: Vec::new(),
        rms_mm: 0.0,
        largest_end: None,
        largest_way: None,
    };
    let second: Vec<&Move> = second.iter().filter(|made| !made.away).collect();
    let mut squares = 0.0;
    let mut next = 0_usize;
    for wanted in first.iter().filter(|wanted| !wanted.away) {
        let [_, end] = wanted.ends.map(image);
        let off = |made: &Move| (made.ends[1] - end).norm();
        let here = next.checked_sub(1).and_then(|at| second.get(at));
        if wanted.stands() && here.is_some_and(|made| off(made) <= near_mm) {
            // It is there already.
            found.matched += 1;
            continue;
        }
        let rest = second.get(next..).unwrap_or_default();
        let window = rest.get(..WINDOW.min(rest.len())).unwrap_or_default();
        let Some(mut last) = window.iter().position(|made| off(made) <= near_mm) else {
            found.missing.push(wanted.line);
            continue;
        };
        // The nearest of those that come close one after another.
        while let (Some(now), Some(then)) = (window.get(last), window.get(last + 1))
            && off(then) < off(now)
        {
            last += 1;
        }
        let made = rest.get(..=last).unwrap_or_default();
        next += last + 1;
        found.matched += 1;
        let mut way_mm = 0.0_f64;
        for part in made.iter().filter(|part| !part.stands()) {
            found.other_rate += usize::from(part.is_feed != wanted.is_feed);
            if !(part.is_feed && wanted.is_feed) {
                continue;
            }
            for step in 0..=4 {
                let place = part.at(f64::from(step) / 4.0);
                let mm = wanted.distance(&inverse.apply(Point { mm: place }).mm);
                way_mm = way_mm.max(mm);
                larger(&mut found.largest_way, mm, [wanted.line, part.line], place);
            }
        }
        if let Some(part) = made.last() {
            let mm = off(part);
            squares += mm * mm;
            let lines = [wanted.line, part.line];
            larger(&mut found.largest_end, mm, lines, part.ends[1]);
            found.deviations.push(Deviation { end_mm: mm, way_mm });
        }
    }
    let rest = second.get(next..).unwrap_or_default();
    found.left_over = rest.iter().filter(|made| !made.stands()).count();
    if found.matched > 0 {
        found.rms_mm = (squares / found.matched as f64).sqrt();
    }
    found
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
