//! Motions of a program by the virtual machine's interpreter, and whether one program's are
//! the images of another's.

use core::f64::consts::{PI, TAU};
use core::ops::RangeInclusive;

use nalgebra::Vector3;
use umi_core::registration::RigidTransform;
use umi_core::units::Point;
use umi_virtual::nc::{
    Control, ControlFamily, ControlSettings, DecimalPoint, ExecutionLimits, MotionPath, MotionRate,
    Recorder,
};

pub type V = Vector3<f64>;

/// More than a machine is high.
pub const LOOSE_MM: f64 = 20_000.0;

/// Where axes at home are: no program goes there otherwise. Four decimals, as LinuxCNC's
/// interpreter prints; the tests' programs have three of a millimetre, or four of an inch, which
/// is a multiple of 0.00254 mm.
pub const HOME_MM: [f64; 3] = [1.1113, 2.2227, 777.7773];
/// Where the corpus goes by G53, in mm or in inches.
pub const AWAY_MM: f64 = 666.666;

/// A motion, machine coordinates, mm.
#[derive(Clone, Debug)]
pub struct Move {
    pub from: V,
    pub to: V,
    pub path: MotionPath,
    /// Along the path, mm/min; none: rapid.
    pub feed_mm_min: Option<f64>,
    /// Axes that are at its end where the machine says, not the program.
    pub by_machine: [bool; 3],
}

/// Axes that are where only the machine can have sent them: at home, or by the corpus' G53.
pub fn by_machine(p: &V) -> [bool; 3] {
    core::array::from_fn(|axis| {
        let by_g53 = [AWAY_MM, AWAY_MM * 25.4];
        (p[axis] - HOME_MM[axis]).abs() < 1e-6
            || (axis == 2 && by_g53.iter().any(|away| (p.z - away).abs() < 1e-6))
    })
}

impl Move {
    fn length_mm(&self) -> f64 {
        let way = self.to - self.from;
        match self.path {
            MotionPath::Line => way.norm(),
            MotionPath::Arc { axis, sweep, .. } => {
                (self.radius_mm() * sweep.0).hypot(axis.dot(&way))
            }
        }
    }

    /// Of an arc; 0 of a line.
    fn radius_mm(&self) -> f64 {
        match self.path {
            MotionPath::Line => 0.0,
            MotionPath::Arc { center, axis, .. } => {
                let arm = self.from - center.mm;
                (arm - axis * axis.dot(&arm)).norm()
            }
        }
    }

    /// The place after this part of the way.
    pub fn at(&self, part: f64) -> V {
        match self.path {
            MotionPath::Line => self.from + (self.to - self.from) * part,
            MotionPath::Arc {
                center,
                axis,
                sweep,
            } => {
                let arm = self.from - center.mm;
                let arm = arm - axis * axis.dot(&arm);
                let end = self.to - center.mm;
                let end_radius = (end - axis * axis.dot(&end)).norm();
                let turned = nalgebra::Rotation3::from_axis_angle(
                    &nalgebra::Unit::new_unchecked(axis),
                    sweep.0 * part,
                ) * arm;
                let radius = arm.norm() + (end_radius - arm.norm()) * part;
                let along = axis.dot(&(self.to - self.from)) * part;
                let start = axis * axis.dot(&(self.from - center.mm));
                center.mm + start + turned / arm.norm() * radius + axis * along
            }
        }
    }
}

/// What the virtual machine makes of a program.
pub fn interpreted(dialect: ControlFamily, program: &str) -> Result<Vec<Move>, String> {
    let settings = ControlSettings {
        decimal_point: DecimalPoint::Calculator,
        increment_mm: 1e-7,
        feed_mm_min: Some(100.0),
        limits: ExecutionLimits {
            text: 1 << 28,
            ..ExecutionLimits::default()
        },
        ..ControlSettings::of(dialect)
    };
    let mut control = Control::new(settings);
    let loaded = control.load(program).map_err(|alarm| alarm.to_string())?;
    let main = loaded.first().copied().unwrap_or_default();
    control.select(main).map_err(|alarm| alarm.to_string())?;
    let mut axes = Recorder::new(Point::from_mm(0.0, 0.0, 0.0), Point::from_array_mm(HOME_MM));
    control.run(&mut axes).map_err(|alarm| alarm.to_string())?;
    let moves = axes.motions.iter().map(|(from, motion)| Move {
        from: from.mm,
        to: motion.to.mm,
        path: motion.path,
        feed_mm_min: match motion.rate {
            MotionRate::Rapid => None,
            MotionRate::Feed(feed) => Some(feed),
        },
        by_machine: by_machine(&motion.to.mm),
    });
    Ok(moves.collect())
}

/// What images are judged by.
pub struct Judge {
    /// In the coordinates of the work offset.
    pub transform: RigidTransform,
    pub origin: V,
    /// Half a step, and what the interpreters print.
    pub rounding_mm: f64,
    /// How far a path may lie from its image.
    pub path_mm: f64,
    /// How high an axis may stand that the machine has placed: a rapid over it may end beside its
    /// image by the lean times this.
    pub loose_mm: f64,
}

/// What was compared.
#[derive(Clone, Copy, Debug, Default)]
pub struct Compared {
    pub ends: usize,
    pub largest_end_mm: f64,
    pub largest_path_mm: f64,
}

impl Judge {
    fn image(&self, p: V) -> V {
        self.transform
            .apply(Point {
                mm: p - self.origin,
            })
            .mm
            + self.origin
    }

    /// How much the axes that the machine has placed may move one of the others.
    fn allowance(&self, nominal: &Move, axis: usize) -> f64 {
        if !nominal.by_machine.contains(&true) {
            return self.rounding_mm;
        }
        let r = &self.transform.rotation;
        let lean = r
            .m13
            .abs()
            .max(r.m23.abs())
            .max(r.m31.abs())
            .max(r.m32.abs());
        // What stands still beside it is where it was.
        let stands = (nominal.to[axis] - nominal.from[axis]).abs() < 1e-9;
        let loose_mm = if stands { LOOSE_MM } else { self.loose_mm };
        self.rounding_mm + lean * loose_mm
    }

    /// The distance of a place from the image of an end, over the axes of the program.
    fn apart(&self, nominal: &Move, place: &V) -> (f64, f64) {
        let (end, machine) = (nominal.to, nominal.by_machine);
        let image = self.image(end);
        let apart = (0..3)
            .map(|axis| {
                let wanted = if machine[axis] {
                    end[axis]
                } else {
                    image[axis]
                };
                let off = (place[axis] - wanted).abs();
                // What the machine has placed, it has placed exactly.
                let allowed = if machine[axis] {
                    self.rounding_mm
                } else {
                    self.allowance(nominal, axis)
                };
                if off <= allowed {
                    off.min(self.rounding_mm)
                } else {
                    off
                }
            })
            .fold(0.0, f64::max);
        (apart, self.rounding_mm)
    }

    /// Follows both lists of ends: each end of the nominal program has its image, in order.
    /// `may_end` says of a nominal motion whether it may end with the last of these written ones, or
    /// without any. Returns how many of the written ends belong to each.
    pub fn ends(
        &self,
        nominal: &[Move],
        written: &[V],
        may_end: impl Fn(usize, Option<RangeInclusive<usize>>) -> bool,
    ) -> Result<(Compared, Vec<usize>), String> {
        let mut compared = Compared::default();
        let mut counts = Vec::new();
        let mut next = 0_usize;
        for (number, end) in nominal.iter().enumerate() {
            // It may be where it is already.
            let here = next
                .checked_sub(1)
                .and_then(|last| written.get(last))
                .map(|place| self.apart(end, place));
            let stays = here.is_some_and(|(apart, allowed)| apart <= allowed)
                && number > 0
                && may_end(number, None)
                && (nominal[number - 1].to - end.to).norm() < 2.0 * self.rounding_mm;
            let mut count = 0;
            let mut closest = f64::INFINITY;
            let found = stays
                || loop {
                    let Some(place) = written.get(next + count) else {
                        break false;
                    };
                    count += 1;
                    let (apart, allowed) = self.apart(end, place);
                    closest = closest.min(apart);
                    if apart <= allowed && may_end(number, Some(next..=next + count - 1)) {
                        if !end.by_machine.contains(&true) {
                            compared.ends += 1;
                            compared.largest_end_mm = compared.largest_end_mm.max(apart);
                        }
                        break true;
                    }
                };
            if !found && here.is_none_or(|(apart, allowed)| apart > allowed) {
                return Err(format!(
                    "end {number} of {}: {:?}, its image {:?} never comes after {next}, closest \
                     {closest}",
                    nominal.len(),
                    end.to.as_slice(),
                    self.image(end.to).as_slice()
                ));
            }
            if !found {
                count = 0;
            }
            next += count;
            counts.push(count);
        }
        // Behind the last end only what comes back to it: a whole circle has one end.
        let comes_back = written
            .last()
            .zip(nominal.last())
            .is_none_or(|(place, end)| {
                let (apart, allowed) = self.apart(end, place);
                apart <= allowed
            });
        if !comes_back {
            return Err(format!("{} motions more", written.len() - next));
        }
        Ok((compared, counts))
    }

    /// Ends and ways: what is cut lies within the tolerance of the image, all the way.
    pub fn moves(&self, nominal: &[Move], written: &[Move]) -> Result<Compared, String> {
        let ends = |moves: &[Move]| -> Vec<V> { moves.iter().map(|m| m.to).collect() };
        let is_still = |m: &Move| m.length_mm() < 3.0 * self.rounding_mm;
        let (mut compared, counts) = self.ends(nominal, &ends(written), |number, last| {
            let MotionPath::Arc { center, sweep, .. } = nominal[number].path else {
                return true;
            };
            // A circle ends where it begins: what has not moved has not gone round.
            let wanted = &nominal[number];
            let is_closed = (wanted.to - wanted.from).norm() < 3.0 * self.rounding_mm
                && sweep.0.abs() > PI
                && (wanted.from - center.mm).norm() > 3.0 * self.rounding_mm;
            let Some(range) = last else { return false };
            let made = &written[range];
            // Of several turns each comes by the end, and all have to be gone.
            let gone_mm: f64 = made.iter().map(Move::length_mm).sum();
            let turn_mm = TAU * wanted.radius_mm();
            let has_gone = sweep.0.abs() <= TAU + 1e-9
                || gone_mm > wanted.length_mm() - 0.5 * turn_mm - 10.0 * self.path_mm;
            has_gone && !(is_closed && made.last().is_some_and(is_still))
        })?;
        let more = written.len() - counts.iter().sum::<usize>();
        if !written[written.len() - more..].iter().all(is_still) {
            return Err(format!("{more} motions more"));
        }
        let mut next = 0_usize;
        for (number, (wanted, count)) in nominal.iter().zip(counts).enumerate() {
            let made = &written[next..next + count];
            next += count;
            let before = number.checked_sub(1).map(|before| &nominal[before]);
            let machine = before
                .into_iter()
                .chain([wanted])
                .any(|moved| moved.by_machine.contains(&true));
            if machine || before.is_none() {
                continue;
            }
            for part in made {
                if is_still(part) {
                    continue;
                }
                if part.feed_mm_min.is_some() != wanted.feed_mm_min.is_some() {
                    return Err(format!("motion {number} is a feed in one program only"));
                }
                for step in 0..=16 {
                    let place = part.at(f64::from(step) / 16.0);
                    let apart = self.off_way(wanted, &place);
                    compared.largest_path_mm = compared.largest_path_mm.max(apart);
                    if apart > self.path_mm {
                        return Err(format!(
                            "motion {number} is {apart} mm off its way: {wanted:?}, {part:?}"
                        ));
                    }
                }
            }
            // Hardly a way may be another motion's.
            let moved = made.iter().filter(|part| !is_still(part));
            let same_feed = moved
                .clone()
                .all(|part| part.feed_mm_min == wanted.feed_mm_min);
            if !same_feed && !same_time(wanted, made.iter()) && !same_time(wanted, moved) {
                return Err(format!("motion {number} has another feed"));
            }
            // And it goes all the way: no half circle is left out, and no turn.
            if matches!(wanted.path, MotionPath::Arc { .. }) && count > 0 {
                let made_mm: f64 = made.iter().map(Move::length_mm).sum();
                let wanted_mm = wanted.length_mm();
                // A chord of a quarter turn is a tenth shorter than its arc.
                if (made_mm - wanted_mm).abs() > 0.15 * wanted_mm + 10.0 * self.path_mm {
                    return Err(format!(
                        "motion {number} goes {made_mm} mm of {wanted_mm} mm"
                    ));
                }
                for step in 0..=64 {
                    let image = self.image(wanted.at(f64::from(step) / 64.0));
                    let apart = made
                        .iter()
                        .map(|part| distance(part, &image))
                        .fold(f64::INFINITY, f64::min);
                    if apart > self.path_mm {
                        return Err(format!("motion {number} leaves out {apart} mm"));
                    }
                }
            }
        }
        Ok(compared)
    }

    /// The distance of a place from the image of a way.
    fn off_way(&self, wanted: &Move, place: &V) -> f64 {
        let inverse = self.transform.inverse();
        let back = inverse
            .apply(Point {
                mm: place - self.origin,
            })
            .mm
            + self.origin;
        distance(wanted, &back)
    }
}

/// Whether a way takes as long in its parts as in one: inverse time.
fn same_time<'a>(wanted: &Move, made: impl Iterator<Item = &'a Move>) -> bool {
    let minutes = |m: &Move| m.feed_mm_min.map_or(0.0, |feed| m.length_mm() / feed);
    let all: f64 = made.map(minutes).sum();
    (all - minutes(wanted)).abs() <= 1e-6 * all
}

/// The distance of a place from a way.
fn distance(way: &Move, place: &V) -> f64 {
    let off = |part: f64| (way.at(part) - place).norm();
    let forth = way.to - way.from;
    let MotionPath::Arc {
        center,
        axis,
        sweep,
    } = way.path
    else {
        let part = forth.dot(&(place - way.from)) / forth.norm_squared().max(1e-18);
        return off(part.clamp(0.0, 1.0));
    };
    let ends = off(0.0).min(off(1.0));
    if axis.dot(&forth).abs() < 1e-9 {
        // Of a flat arc the nearest is at the angle of the place.
        let ahead = way.from - center.mm;
        let arm = place - center.mm;
        let angle = axis.cross(&ahead).dot(&arm).atan2(ahead.dot(&arm));
        let part = (angle * sweep.0.signum()).rem_euclid(2.0 * PI) / sweep.0.abs();
        return off(part.min(1.0)).min(ends);
    }
    // Of a helix: the nearest of many on each turn, then by thirds. On one turn the way may have
    // ended short of the place, while another passes it.
    let turns = (sweep.0.abs() / (2.0 * PI)).ceil() as u32;
    let steps = 128 * turns;
    let part = |n: u32| f64::from(n) / f64::from(steps);
    let of_turn = |turn: u32| {
        let best = (128 * turn..=128 * (turn + 1))
            .min_by(|a, b| off(part(*a)).total_cmp(&off(part(*b))))
            .unwrap_or(0);
        let (mut low, mut high) = (part(best.saturating_sub(1)), part((best + 1).min(steps)));
        for _ in 0..40 {
            let (a, b) = (low + (high - low) / 3.0, high - (high - low) / 3.0);
            if off(a) < off(b) {
                high = b;
            } else {
                low = a;
            }
        }
        off(f64::midpoint(low, high))
    };
    (0..turns).map(of_turn).fold(ends, f64::min)
}
