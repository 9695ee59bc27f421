//! There and back: rewritten by T and then by its inverse, every program moves as it did.
//!
//! Random programs that say all that the rewriter follows, written by somebody who knows where
//! the tool is ([`Writer`]), so that none of them may be refused: in neither direction, by no
//! transform.
//!
//! # What is promised
//!
//! With h half a step (0.0005 mm, 0.00127 mm in inches):
//!
//! * Every end comes back within h (1 + √3) on each axis: what the first pass rounds on three
//!   axes the second turns onto one, and rounds again. Twice that around a subprogram in `G91`,
//!   whose tool is within a whole step.
//! * A path comes back within the chords' tolerance of each pass and that rounding. Arcs in
//!   a plane that the transform keeps stay arcs, and come back within [`LEVEL_STEPS`] steps.
//! * Feeds come back as they were; in inverse time, the time of each block.

use std::cell::RefCell;

use proptest::prelude::*;
use proptest::test_runner::TestRunner;
use umi_core::registration::RigidTransform;
use umi_virtual::nc::ControlFamily;

use crate::rewrite::follow::{AWAY_MM, Judge, LOOSE_MM, interpreted};
use crate::rewrite::{rewritten, settings, turned};

/// How far arcs may lie from their images, of each pass.
const CHORD_MM: f64 = 0.01;
/// How far an arc that stays one may come back beside itself, in steps: in each pass its
/// centre is within two of them, and its ends within half a step on each axis.
const LEVEL_STEPS: f64 = 6.0;

/// What a program does next. Lengths in micrometres, angles in hundredths of a degree.
#[derive(Clone, Debug)]
enum Part {
    Straight {
        cuts: bool,
        by: [i64; 3],
        named: [bool; 3],
    },
    Arc {
        plane: usize,
        radius: i64,
        from: i64,
        sweep: i64,
        rise: i64,
        by_radius: bool,
    },
    Circle {
        plane: usize,
        radius: i64,
        from: i64,
        left: bool,
        rise: i64,
        is_named: bool,
    },
    Holes {
        plane: usize,
        code: usize,
        above: i64,
        deep: i64,
        peck: i64,
        to_r: bool,
        by: Vec<[i64; 2]>,
        count: u32,
    },
    Incremental(bool),
    Inch(bool),
    AbsoluteCentres(bool),
    InverseTime(bool),
    Feed(u32),
    Work(usize),
    Local([i64; 3]),
    Here {
        to: [i64; 3],
        named: [bool; 3],
    },
    Home,
    ByMachine,
    Length,
    Call(u32),
}

/// Where the origins of G54 to G56 are, machine coordinates, nm.
const ORIGINS: [[i64; 3]; 3] = [
    [10_000_000, -20_000_000, 30_000_000],
    [-55_123_000, 2_500_000, 31_250_000],
    [0, 0, 0],
];
/// First, second and normal axis of G17, G18, G19.
const PLANES: [[usize; 3]; 3] = [[0, 1, 2], [2, 0, 1], [1, 2, 0]];
const NM_PER_UM: i64 = 1000;

/// Writes a program, and knows where the tool is.
struct Writer {
    dialect: ControlFamily,
    text: String,
    /// Machine coordinates of the nominal tool, nm: all words are whole steps.
    at: [i64; 3],
    work: usize,
    local: [i64; 3],
    here: [i64; 3],
    plane: usize,
    is_inch: bool,
    is_incremental: bool,
    has_absolute_centres: bool,
    is_inverse_time: bool,
    /// The motion code in force, where it is known to be.
    motion: Option<u8>,
    feed: u32,
    has_inches: bool,
    has_calls: bool,
    has_tilted_arcs: bool,
    /// Arcs that may become chords where the transform is level.
    maybe_chords: u64,
    /// G43 or G92: a subprogram is called with the same modes and shifts, or refused.
    has_shifted: bool,
    /// G92 has taken over a shift of G52: another G52 is refused.
    took_local: bool,
}

impl Writer {
    fn new(dialect: ControlFamily) -> Self {
        let mut text = String::from("%\n");
        if dialect == ControlFamily::Fanuc {
            text += "O0007\n";
        }
        text += "G21 G90 G17 G94 G98 G54\n";
        for (number, [x, y, z]) in (1..).zip(ORIGINS) {
            let mm = |nm: i64| nm as f64 / 1e6;
            text += &format!(
                "G10 L2 P{number} X{:.3} Y{:.3} Z{:.3}\n",
                mm(x),
                mm(y),
                mm(z)
            );
        }
        let mut writer = Self {
            dialect,
            text,
            at: [0; 3],
            work: 0,
            local: [0; 3],
            here: [0; 3],
            plane: 0,
            is_inch: false,
            is_incremental: false,
            has_absolute_centres: false,
            is_inverse_time: false,
            motion: None,
            feed: 100,
            has_inches: false,
            has_calls: false,
            has_tilted_arcs: false,
            maybe_chords: 0,
            has_shifted: false,
            took_local: false,
        };
        writer.text += "F100.\n";
        writer.go_anew();
        writer
    }

    const fn step(&self) -> i64 {
        if self.is_inch { 2540 } else { 1000 }
    }

    fn shift(&self, axis: usize) -> i64 {
        ORIGINS[self.work][axis] + self.local[axis] + self.here[axis]
    }

    fn word(&mut self, letter: char, steps: i64) {
        let (decimals, steps_per_unit) = if self.is_inch { (4, 1e4) } else { (3, 1e3) };
        self.text += &format!(" {letter}{:.decimals$}", steps as f64 / steps_per_unit);
    }

    /// A length that is not a place.
    fn length(&mut self, letter: char, nm: i64) {
        self.word(letter, nm / self.step());
    }

    /// A word of an axis, as near to a machine coordinate as words come; where that is.
    fn axis(&mut self, axis: usize, to: i64) -> i64 {
        let base = if self.is_incremental {
            self.at[axis]
        } else {
            self.shift(axis)
        };
        let steps = (to - base).div_euclid(self.step());
        self.word(['X', 'Y', 'Z'][axis], steps);
        base + steps * self.step()
    }

    fn code(&mut self, motion: u8) {
        if self.motion != Some(motion) {
            self.text += &format!(" G{motion}");
            self.motion = Some(motion);
        }
    }

    fn feed_word(&mut self) {
        if self.is_inverse_time {
            self.text += &format!(" F{}.{}", self.feed % 7 + 1, self.feed % 10);
        }
    }

    fn end(&mut self) {
        self.text += "\n";
    }

    /// All axes by their places, from anywhere.
    fn go_anew(&mut self) {
        let was_incremental = core::mem::replace(&mut self.is_incremental, false);
        self.motion = Some(0);
        self.text += "G90 G0";
        let place = [20_000_000, -7_000_000, 60_000_000];
        for (axis, to) in place.into_iter().enumerate() {
            self.at[axis] = self.axis(axis, to);
        }
        self.end();
        if was_incremental {
            self.is_incremental = true;
            self.text += "G91\n";
        }
    }

    fn select(&mut self, plane: usize) {
        if self.plane != plane {
            self.plane = plane;
            self.text += &format!("G{}\n", 17 + plane);
        }
    }

    /// The way from the start of an arc to its centre, and from there to a place on it.
    fn arms(&self, radius: i64, from: i64, sweep: i64) -> ([i64; 2], [i64; 2]) {
        let step = self.step();
        let on_grid = |mm: f64| (mm * 1e6 / step as f64).round() as i64 * step;
        let radius = radius as f64 / 1000.0;
        let angle = |hundredths: i64| (hundredths as f64 / 100.0).to_radians();
        let (start, end) = (angle(from), angle(from + sweep));
        let to_center = [-radius * start.cos(), -radius * start.sin()].map(on_grid);
        // From the centre that the words give.
        let [i, j] = to_center.map(|nm| nm as f64 / 1e6);
        let radius = i.hypot(j);
        let off = (-j).atan2(-i) - start;
        let end = [radius * (end + off).cos(), radius * (end + off).sin()].map(on_grid);
        (to_center, end)
    }

    #[allow(clippy::too_many_arguments, reason = "the words of an arc")]
    fn arc(
        &mut self,
        plane: usize,
        radius: i64,
        from: i64,
        sweep: i64,
        rise: i64,
        by_radius: bool,
        is_named: bool,
    ) {
        let is_full = sweep.abs() == 36_000;
        // A step of an inch is a lot for the smallest.
        let radius = radius.max(10 * self.step() / NM_PER_UM);
        self.select(plane);
        let axes = PLANES[plane];
        let [first, second, normal] = axes;
        let (to_center, mut to_end) = self.arms(radius, from, sweep);
        if is_full {
            to_end = to_center.map(|nm| -nm);
        }
        let ways = [to_center[0] + to_end[0], to_center[1] + to_end[1]];
        // An R needs two places; around half a turn rounding puts them too far apart.
        let by_radius = by_radius
            && !is_full
            && ways != [0; 2]
            && (sweep.abs() - 18_000).abs() > 300
            && sweep.abs() < 35_000;
        // Places of the other unit are between steps: an arc with a centre that is a
        // coordinate, or that ends at one, would not close.
        let is_between = |axis: usize| (self.at[axis] - self.shift(axis)) % self.step() != 0;
        if (!self.is_incremental || self.has_absolute_centres) && axes.into_iter().any(is_between) {
            return;
        }
        self.code(if sweep > 0 { 3 } else { 2 });
        let center = [first, second].map(|axis| self.at[axis]);
        let start = self.at;
        for (axis, way) in [(first, ways[0]), (second, ways[1])] {
            if way != 0 || is_named {
                self.at[axis] = self.axis(axis, start[axis] + way);
            }
        }
        if rise != 0 {
            self.at[normal] = self.axis(normal, start[normal] + rise * NM_PER_UM);
        }
        if by_radius {
            let [i, j] = to_center.map(|nm| nm as f64);
            // Never too short for its ends.
            let steps = (i.hypot(j) / self.step() as f64).ceil() as i64;
            self.word('R', if sweep.abs() > 18_000 { -steps } else { steps });
        } else {
            for (slot, axis) in [first, second].into_iter().enumerate() {
                let letter = ['I', 'J', 'K'][axis];
                if self.has_absolute_centres {
                    let nm = center[slot] + to_center[slot] - self.shift(axis);
                    self.length(letter, nm);
                } else if to_center[slot] != 0 {
                    self.length(letter, to_center[slot]);
                }
            }
        }
        self.feed_word();
        self.end();
        self.has_tilted_arcs |= plane != 0;
        // Another plane, hardly a way or hardly less than a circle, a place between steps.
        let is_plain = plane == 0
            && radius >= 500
            && (is_full || (100..35_900).contains(&sweep.abs()))
            && !self.has_inches;
        self.maybe_chords += u64::from(!is_plain);
    }

    fn holes(&mut self, part: &Part) {
        let Part::Holes {
            plane,
            code,
            above,
            deep,
            peck,
            to_r,
            by,
            count,
        } = part
        else {
            return;
        };
        let was_inverse = self.is_inverse_time;
        self.inverse_time(false);
        self.select(*plane);
        let [first, second, normal] = PLANES[*plane];
        let initial = self.at[normal];
        let code = ["81", "82", "83", "73"][*code];
        self.text += &format!("G{} G{code}", if *to_r { 99 } else { 98 });
        for (number, way) in by.iter().enumerate() {
            for (axis, um) in [first, second].into_iter().zip(way) {
                self.at[axis] = self.axis(axis, self.at[axis] + um * NM_PER_UM);
            }
            if number == 0 {
                // R and the bottom are seen from other places in increments.
                let step = self.step();
                let base = if self.is_incremental {
                    initial
                } else {
                    self.shift(normal)
                };
                let letter = ['X', 'Y', 'Z'][normal];
                let r = (initial - above * NM_PER_UM - base).div_euclid(step);
                self.word('R', r);
                let r_at = base + r * step;
                let base = if self.is_incremental { r_at } else { base };
                let bottom = (r_at - deep * NM_PER_UM - base).div_euclid(step);
                self.word(letter, bottom);
                if matches!(code, "83" | "73") {
                    self.length('Q', peck * NM_PER_UM);
                }
                if code == "82" {
                    self.text += " P100";
                }
                if *to_r {
                    self.at[normal] = r_at;
                }
            } else if self.is_incremental && *count > 1 {
                let letter = if self.dialect == ControlFamily::LinuxCnc {
                    'L'
                } else {
                    'K'
                };
                self.text += &format!(" {letter}{count}");
                for (axis, um) in [first, second].into_iter().zip(way) {
                    let way = (um * NM_PER_UM).div_euclid(self.step()) * self.step();
                    self.at[axis] += way * i64::from(count - 1);
                }
            }
            self.end();
        }
        self.text += "G80\n";
        if self.dialect == ControlFamily::LinuxCnc {
            self.motion = None;
        }
        self.inverse_time(was_inverse);
    }

    fn inverse_time(&mut self, is: bool) {
        if self.is_inverse_time != is && self.dialect == ControlFamily::LinuxCnc {
            self.is_inverse_time = is;
            self.text += if is { "G93\n" } else { "G94 F100.\n" };
        }
    }

    fn inch(&mut self, is: bool) {
        if self.is_inch != is {
            self.is_inch = is;
            self.has_inches |= is;
            self.text += if is { "G20" } else { "G21" };
            self.text += if self.is_inverse_time {
                "\n"
            } else {
                " F30.\n"
            };
        }
    }

    fn incremental(&mut self, is: bool) {
        self.is_incremental = is;
        self.text += if is { "G91\n" } else { "G90\n" };
    }

    fn part(&mut self, part: &Part) {
        match *part {
            Part::Straight { cuts, by, named } => {
                if named == [false; 3] {
                    return;
                }
                self.code(cuts.into());
                for axis in (0..3).filter(|axis| named[*axis]) {
                    self.at[axis] = self.axis(axis, self.at[axis] + by[axis] * NM_PER_UM);
                }
                if cuts {
                    self.feed_word();
                }
                self.end();
            }
            Part::Arc {
                plane,
                radius,
                from,
                sweep,
                rise,
                by_radius,
            } => {
                self.arc(plane, radius, from, sweep, rise, by_radius, true);
            }
            Part::Circle {
                plane,
                radius,
                from,
                left,
                rise,
                is_named,
            } => {
                let sweep = if left { 36_000 } else { -36_000 };
                self.arc(plane, radius, from, sweep, rise, false, is_named);
            }
            Part::Holes { .. } => self.holes(part),
            Part::Incremental(is) => self.incremental(is),
            Part::Inch(is) => self.inch(is),
            Part::AbsoluteCentres(is) => {
                if self.dialect == ControlFamily::LinuxCnc {
                    self.has_absolute_centres = is;
                    self.text += if is { "G90.1\n" } else { "G91.1\n" };
                }
            }
            Part::InverseTime(is) => self.inverse_time(is),
            Part::Feed(feed) => {
                self.feed = feed;
                if !self.is_inverse_time {
                    self.text += &format!("F{feed}.5\n");
                }
            }
            Part::Work(work) => {
                self.work = work;
                self.text += &format!("G{}\n", 54 + work);
            }
            Part::Local(um) => {
                // LinuxCNC has none.
                if self.dialect == ControlFamily::Fanuc && !self.took_local {
                    self.text += "G52";
                    for axis in 0..3 {
                        let steps = um[axis] * NM_PER_UM / self.step();
                        self.word(['X', 'Y', 'Z'][axis], steps);
                        self.local[axis] = steps * self.step();
                    }
                    self.end();
                }
            }
            Part::Here { to, named } => {
                if named == [false; 3] {
                    return;
                }
                self.text += "G92";
                self.has_shifted = true;
                for axis in (0..3).filter(|axis| named[*axis]) {
                    let steps = to[axis] * NM_PER_UM / self.step();
                    self.word(['X', 'Y', 'Z'][axis], steps);
                    self.here[axis] += self.at[axis] - self.shift(axis) - steps * self.step();
                    // The local coordinates of this axis end.
                    self.took_local |= self.local[axis] != 0;
                    self.here[axis] += core::mem::take(&mut self.local[axis]);
                }
                self.end();
            }
            Part::Home => {
                self.text += "G91 G28 Z0\n";
                self.text += if self.is_incremental { "" } else { "G90\n" };
                self.go_anew();
            }
            Part::ByMachine => {
                self.text += &format!("G90 G53 G0 Z{AWAY_MM}\n");
                self.text += if self.is_incremental { "G91\n" } else { "" };
                self.go_anew();
            }
            Part::Length => {
                self.text += "G43 H1\n";
                self.has_shifted = true;
                self.go_anew();
            }
            Part::Call(times) => {
                // It is written for these modes only.
                let is_as_begun = self.work == 0 && self.local == [0; 3] && !self.has_shifted;
                if self.dialect == ControlFamily::Fanuc && is_as_begun {
                    self.inch(false);
                    self.select(0);
                    self.incremental(false);
                    self.text += &format!("M98 P8 L{times}\n");
                    self.has_calls = true;
                    self.go_anew();
                }
            }
        }
    }

    fn finish(mut self, is_tight: bool) -> Written {
        self.text += "M30\n";
        if self.has_calls {
            self.text += "O0008\nG91 G1 X3.333 Y1.111 Z-0.5\nG3 X-4. Y4. I-4. J0.\nG1 X0.667 Y-5.111 \
                          Z0.5\nG90\nM99\n";
        }
        self.text += "%\n";
        if is_tight {
            self.text = self.text.replace(' ', "");
        }
        let step_mm = if self.has_inches { 0.00254 } else { 0.001 };
        Written {
            step_mm: if self.has_calls {
                2.0 * step_mm
            } else {
                step_mm
            },
            is_flat: !self.has_tilted_arcs,
            maybe_chords: self.maybe_chords,
            text: self.text,
        }
    }
}

/// A program.
#[derive(Debug)]
struct Written {
    text: String,
    /// The tool is within half of this.
    step_mm: f64,
    /// All arcs are in the XY plane.
    is_flat: bool,
    maybe_chords: u64,
}

fn short() -> impl Strategy<Value = i64> {
    // All magnitudes of a way, from a step to some hundred millimetres.
    prop_oneof![
        2 => -150_000i64..150_000,
        1 => -3000i64..3000,
        1 => -5i64..5,
        1 => Just(0),
    ]
}

fn radius() -> impl Strategy<Value = i64> {
    prop_oneof![4 => 500i64..40_000, 1 => 8i64..500, 1 => 40_000i64..400_000]
}

fn sweep() -> impl Strategy<Value = i64> {
    let some = prop_oneof![
        4 => 100i64..35_900,
        1 => prop::sample::select(vec![9_000, 18_000, 27_000]),
        1 => 1i64..100,
        1 => 35_900i64..35_999,
    ];
    (some, any::<bool>()).prop_map(|(sweep, left)| if left { sweep } else { -sweep })
}

fn part() -> impl Strategy<Value = Part> {
    let named = || prop::array::uniform3(any::<bool>());
    let ways = || prop::array::uniform3(short());
    let rise = || prop_oneof![2 => Just(0i64), 1 => -8000i64..8000];
    prop_oneof![
        8 => (any::<bool>(), ways(), named())
            .prop_map(|(cuts, by, named)| Part::Straight { cuts, by, named }),
        8 => (0usize..3, radius(), 0i64..36_000, sweep(), rise(), any::<bool>()).prop_map(
            |(plane, radius, from, sweep, rise, by_radius)| Part::Arc {
                plane, radius, from, sweep, rise, by_radius,
            }
        ),
        2 => (0usize..3, radius(), 0i64..36_000, any::<bool>(), rise(), any::<bool>()).prop_map(
            |(plane, radius, from, left, rise, is_named)| Part::Circle {
                plane, radius, from, left, rise, is_named,
            }
        ),
        3 => (
            (0usize..3, 0usize..4, 100i64..9000, 100i64..9000, 500i64..4000),
            any::<bool>(),
            prop::collection::vec(prop::array::uniform2(-20_000i64..20_000), 1..4),
            1u32..5,
        ).prop_map(|((plane, code, above, deep, peck), to_r, by, count)| Part::Holes {
            plane, code, above, deep, peck, to_r, by, count,
        }),
        3 => any::<bool>().prop_map(Part::Incremental),
        1 => any::<bool>().prop_map(Part::Inch),
        2 => any::<bool>().prop_map(Part::AbsoluteCentres),
        2 => any::<bool>().prop_map(Part::InverseTime),
        1 => (1u32..2000).prop_map(Part::Feed),
        2 => (0usize..3).prop_map(Part::Work),
        1 => ways().prop_map(Part::Local),
        1 => (ways(), named()).prop_map(|(to, named)| Part::Here { to, named }),
        1 => prop::sample::select(vec![Part::Home, Part::ByMachine, Part::Length]),
        1 => (1u32..3).prop_map(Part::Call),
    ]
}

fn program(dialect: ControlFamily) -> impl Strategy<Value = Written> {
    (prop::collection::vec(part(), 1..16), any::<bool>()).prop_map(move |(parts, is_tight)| {
        let mut writer = Writer::new(dialect);
        for part in &parts {
            writer.part(part);
        }
        writer.finish(is_tight)
    })
}

/// Angles and lengths of all magnitudes: the exponent of ten is random.
fn of_any_size(smallest: f64, largest: f64) -> impl Strategy<Value = f64> {
    let exponent = smallest.log10()..largest.log10();
    (exponent, any::<bool>()).prop_map(|(exponent, less)| {
        let size = 10f64.powf(exponent);
        if less { -size } else { size }
    })
}

/// About Z only, if the part may not lean.
fn transform(leans: bool) -> impl Strategy<Value = RigidTransform> {
    let shift = prop::array::uniform3(of_any_size(1e-4, 300.0));
    let turn = prop_oneof![
        4 => of_any_size(1e-5, 180.0),
        1 => prop::sample::select(vec![0.0, 90.0, 180.0, -90.0]),
    ];
    let lean = prop_oneof![
        4 => prop::array::uniform2(of_any_size(1e-5, 60.0)),
        1 => Just([180.0, 0.0]),
        1 => Just([0.0, 90.0]),
    ];
    (turn, lean, shift).prop_map(move |(c, [a, b], shift)| {
        turned(if leans { [a, b, c] } else { [0.0, 0.0, c] }, shift)
    })
}

/// Rewritten twice, interpreted, compared.
fn there_and_back(
    dialect: ControlFamily,
    program: &Written,
    transform: RigidTransform,
) -> Result<Seen, String> {
    let clearance = if dialect == ControlFamily::LinuxCnc {
        0.254
    } else {
        1.0
    };
    let text = &program.text;
    let nominal = interpreted(dialect, text)?;
    let (there, first) = rewritten(&settings(transform, clearance), text)
        .map_err(|refusal| format!("there: {refusal}"))?;
    let (back, second) = rewritten(&settings(transform.inverse(), clearance), &there)
        .map_err(|refusal| format!("back: {refusal}\n{there}"))?;
    // Two passes that err alike would find back.
    let image = Judge {
        transform,
        origin: nalgebra::Vector3::from(ORIGINS[0].map(|nm| nm as f64 / 1e6)),
        rounding_mm: program.step_mm / 2.0 + 1e-6,
        path_mm: CHORD_MM + program.step_mm,
        loose_mm: LOOSE_MM,
    };
    interpreted(dialect, &there)
        .and_then(|written| image.moves(&nominal, &written))
        .map_err(|why| format!("there: {why}\n{there}"))?;
    let chorded = first.chorded + second.chorded;
    let rounding_mm = program.step_mm / 2.0 * (1.0 + 3f64.sqrt()) + 1e-6;
    let r = transform.rotation;
    let is_level = r.m31.hypot(r.m32) < 1e-9;
    if is_level && first.chorded.max(second.chorded) > program.maybe_chords {
        return Err(format!("an arc became chords\n{there}"));
    }
    let path_mm = if is_level && program.is_flat && chorded == 0 {
        LEVEL_STEPS * program.step_mm
    } else {
        2.0 * CHORD_MM + rounding_mm
    };
    let judge = Judge {
        transform: RigidTransform::identity(),
        origin: nalgebra::Vector3::zeros(),
        rounding_mm,
        path_mm,
        loose_mm: LOOSE_MM,
    };
    let written = interpreted(dialect, &back).map_err(|why| format!("{why}\n{there}\n{back}"))?;
    let compared = judge
        .moves(&nominal, &written)
        .map_err(|why| format!("{why}\nthere:\n{there}\nand back:\n{back}"))?;
    Ok(Seen {
        ends: compared.ends,
        arcs: first.arcs,
        chorded: first.chorded,
    })
}

/// What was seen of the programs.
#[derive(Debug, Default)]
struct Seen {
    ends: usize,
    arcs: u64,
    chorded: u64,
}

/// Random programs under random transforms, 128 or half of `PROPTEST_CASES`.
fn every_program_comes_back(dialect: ControlFamily, leans: bool) -> Seen {
    let config = ProptestConfig {
        cases: ProptestConfig::default().cases / 2,
        failure_persistence: None,
        ..ProptestConfig::default()
    };
    let cases = f64::from(config.cases);
    let mut runner = TestRunner::new(config);
    let seen = RefCell::new(Seen::default());
    let given = (program(dialect), transform(leans));
    let done = runner.run(&given, |(program, transform)| {
        let compared = there_and_back(dialect, &program, transform).map_err(|why| {
            TestCaseError::fail(format!("{why}\n{transform:?}\n{}", program.text))
        })?;
        let mut seen = seen.borrow_mut();
        seen.ends += compared.ends;
        seen.arcs += compared.arcs;
        seen.chorded += compared.chorded;
        Ok(())
    });
    if let Err(why) = done {
        panic!("{why}");
    }
    let seen = seen.into_inner();
    println!("{seen:?}");
    assert!(seen.ends as f64 > 10.0 * cases, "{seen:?}");
    seen
}

/// Turned about Z only: arcs in the XY plane stay arcs.
#[test]
fn turned_programs_come_back() {
    let seen = every_program_comes_back(ControlFamily::Fanuc, false);
    assert!(seen.arcs > seen.chorded, "{seen:?}");
}

/// Leaning: most arcs become chords, cycles are written out.
#[test]
fn leaning_programs_come_back() {
    let seen = every_program_comes_back(ControlFamily::Fanuc, true);
    assert!(seen.arcs > 0 && seen.chorded > seen.arcs, "{seen:?}");
}

/// The same with LinuxCNC's words: absolute centres, inverse time.
#[test]
fn turned_programs_of_linuxcnc_come_back() {
    let seen = every_program_comes_back(ControlFamily::LinuxCnc, false);
    assert!(seen.arcs > seen.chorded, "{seen:?}");
}

/// Leaning ones, too.
#[test]
fn leaning_programs_of_linuxcnc_come_back() {
    let seen = every_program_comes_back(ControlFamily::LinuxCnc, true);
    assert!(seen.arcs > 0 && seen.chorded > seen.arcs, "{seen:?}");
}
