//! Random programs out of a grammar of all that the rewriter follows, written by somebody who does
//! not know where the tool is: offsets, both distance modes, planes, arcs, cycles, subprograms,
//! optional blocks, units, modes that are taken for granted, main programs that M99 begins again.
//! What the rewriter takes moves as its image does, with optional blocks and without them.

use core::fmt::Write as _;

use umi_core::registration::RigidTransform;
use umi_core::rewrite::StartModes;
use umi_virtual::nc::ControlFamily;

use crate::rewrite::turned;

/// A generator of which the seed says all that follows (SplitMix64).
pub struct Random(u64);

impl Random {
    pub const fn new(seed: u64) -> Self {
        Self(seed)
    }

    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn below(&mut self, count: usize) -> usize {
        (self.next() % count as u64) as usize
    }

    /// True this many times of a hundred.
    fn is(&mut self, percent: usize) -> bool {
        self.below(100) < percent
    }

    fn one<T: Copy>(&mut self, of: &[T]) -> T {
        of[self.below(of.len())]
    }

    /// Evenly between two numbers.
    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.next() >> 11) as f64 / (1_u64 << 53) as f64
    }
}

/// First, second and normal axis of G17, G18, G19.
const PLANES: [[usize; 3]; 3] = [[0, 1, 2], [2, 0, 1], [1, 2, 0]];
const AXES: [char; 3] = ['X', 'Y', 'Z'];
const CENTRES: [char; 3] = ['I', 'J', 'K'];

/// A program, and what is in force where it begins.
#[derive(Clone, Debug)]
pub struct Case {
    pub family: ControlFamily,
    /// What the control has carried out before: it sets offsets and modes.
    pub before: String,
    pub program: String,
    /// Modes that the rewriter is told.
    pub start: StartModes,
    /// Origins that it is told.
    pub origins_mm: [Option<[f64; 3]>; 6],
    /// The origin of the transform's frame: the work offset of the first motion, in the text.
    pub frame_mm: [f64; 3],
    pub transform: RigidTransform,
    pub has_calls: bool,
}

impl Case {
    /// Half a step on each axis; of a called program half a step more.
    pub fn rounding_mm(&self) -> f64 {
        let text = format!("{}{}", self.before, self.program);
        let step = if text.contains("G20") { 0.00254 } else { 0.001 };
        let times = if self.has_calls { 2.0 } else { 1.0 };
        times * step / 2.0 + 1e-6
    }
}

/// Which words the programs may have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scope {
    /// What the virtual machine interprets.
    Machine,
    /// What LinuxCNC's interpreter does.
    Referee,
}

struct Writer<'a> {
    random: &'a mut Random,
    family: ControlFamily,
    scope: Scope,
    text: String,
    work: usize,
    origins: [[f64; 3]; 6],
    frame: Option<[f64; 3]>,
    is_incremental: bool,
    is_inch: bool,
    plane: usize,
    /// Programs that may be called from here.
    callable: Vec<u32>,
    has_calls: bool,
}

impl Writer<'_> {
    /// In the manner of LinuxCNC: GRBL, too, as far as its words go.
    fn is_linuxcnc(&self) -> bool {
        self.family == ControlFamily::LinuxCnc || self.is_grbl()
    }

    /// It has no cycles, G52, variables, tools.
    fn is_grbl(&self) -> bool {
        self.family == ControlFamily::Grbl
    }

    /// What is in force where the program begins, as far as it says so itself.
    fn say(&mut self, header: &str, work: usize) {
        self.text += header;
        self.text.push('\n');
        if header.contains(" G54") || header.contains(" G55") {
            self.work = work;
        }
    }

    fn number(&mut self, most: f64) -> f64 {
        match self.random.below(8) {
            0 => 0.0,
            1 => self.random.between(-most, most).round(),
            2 => self.random.between(-0.01, 0.01),
            3 => self.random.between(-2.0, 2.0),
            _ => self.random.between(-most, most),
        }
    }

    fn word(&mut self, letter: char, value: f64) {
        let value = (value * 1000.0).round() / 1000.0;
        let value = if value == 0.0 { 0.0 } else { value };
        let _ = write!(self.text, " {letter}{value:.3}");
    }

    fn axes(&mut self, most: f64) {
        let which = 1 + self.random.below(7);
        for (axis, letter) in AXES.into_iter().enumerate() {
            if which & (1 << axis) != 0 {
                let value = self.number(most);
                self.word(letter, value);
            }
        }
    }

    fn begin(&mut self) {
        if self.random.is(3) {
            self.text.push('/');
        }
    }

    fn end(&mut self) {
        if self.random.is(4) {
            self.text += " F200.";
        }
        self.text.push('\n');
    }

    fn settle(&mut self) {
        let origin = self.origins[self.work];
        self.frame.get_or_insert(origin);
    }

    fn distance(&mut self, is_incremental: bool) {
        self.is_incremental = is_incremental;
        self.text += if is_incremental { " G91" } else { " G90" };
    }

    fn place(&mut self) {
        self.settle();
        self.begin();
        self.distance(false);
        self.text += " G0";
        for letter in AXES {
            let value = self.number(50.0) + if letter == 'Z' { 30.0 } else { 0.0 };
            self.word(letter, value);
        }
        self.end();
    }

    fn straight(&mut self) {
        self.settle();
        self.begin();
        if self.random.is(15) {
            let is = self.random.is(50);
            self.distance(is);
        }
        if self.random.is(60) {
            self.text += self.random.one(&[" G0", " G1", " G1"]);
        }
        self.axes(40.0);
        self.end();
    }

    fn select(&mut self) {
        let plane = if self.random.is(60) {
            self.plane
        } else {
            self.random.below(3)
        };
        if plane != self.plane || self.random.is(30) {
            self.plane = plane;
            let _ = write!(self.text, " G{}", 17 + plane);
        }
    }

    /// An arc in increments: it exists wherever the tool is.
    fn arc(&mut self) {
        self.settle();
        self.begin();
        self.distance(true);
        self.select();
        let [first, second, normal] = PLANES[self.plane];
        let left = self.random.is(50);
        self.text += if left { " G3" } else { " G2" };
        let radius = 10f64.powf(self.random.between(-1.5, 1.8));
        let from = self.random.between(0.0, 360.0).to_radians();
        let sweep = match self.random.below(6) {
            0 => 90.0,
            1 => 180.0,
            2 => self.random.between(0.1, 3.0),
            _ => self.random.between(3.0, 357.0),
        }
        .to_radians();
        let grid = |mm: f64| (mm * 1000.0).round() / 1000.0;
        let to_centre = [-radius * from.cos(), -radius * from.sin()].map(grid);
        let radius = to_centre[0].hypot(to_centre[1]);
        let begin = (-to_centre[1]).atan2(-to_centre[0]);
        let end = begin + if left { sweep } else { -sweep };
        let way = [
            grid(to_centre[0] + radius * end.cos()),
            grid(to_centre[1] + radius * end.sin()),
        ];
        let is_full = self.random.is(15);
        if !is_full {
            self.word(AXES[first], way[0]);
            self.word(AXES[second], way[1]);
        }
        if self.random.is(30) {
            let rise = self.number(5.0);
            self.word(AXES[normal], rise);
        }
        if !is_full && self.random.is(30) {
            let sign = if sweep > core::f64::consts::PI {
                -1.0
            } else {
                1.0
            };
            self.word('R', sign * (radius * 1000.0).ceil() / 1000.0);
        } else {
            self.word(CENTRES[first], to_centre[0]);
            self.word(CENTRES[second], to_centre[1]);
        }
        if self.scope == Scope::Referee && self.random.is(15) {
            let turns = 1 + self.random.below(3);
            let _ = write!(self.text, " P{turns}");
        }
        self.end();
        if self.random.is(70) {
            self.distance(false);
            self.end();
        }
    }

    fn cycle(&mut self) {
        if self.is_grbl() {
            return self.straight();
        }
        self.settle();
        self.begin();
        if self.random.is(70) {
            self.select();
        }
        if self.random.is(60) {
            self.text += self.random.one(&[" G98", " G99"]);
        }
        let code = match self.scope {
            Scope::Machine => self.random.one(&["73", "81", "82", "83"]),
            Scope::Referee => self.random.one(&["73", "81", "82", "83", "85", "86", "89"]),
        };
        let _ = write!(self.text, " G{code}");
        let holes = 1 + self.random.below(4);
        for hole in 0..holes {
            let [first, second, normal] = PLANES[self.plane];
            if hole > 0 {
                self.begin();
                if self.random.is(8) {
                    self.text += self.random.one(&[" G98", " G99"]);
                }
                if self.random.is(6) {
                    let is = self.random.is(50);
                    self.distance(is);
                }
            }
            for axis in [first, second] {
                if self.random.is(75) {
                    let value = self.number(30.0);
                    self.word(AXES[axis], value);
                }
            }
            let [r, bottom] = if self.is_incremental {
                [
                    self.random.between(-15.0, 3.0),
                    self.random.between(-12.0, 0.0),
                ]
            } else {
                [
                    self.random.between(-5.0, 20.0),
                    self.random.between(-30.0, -5.0),
                ]
            };
            if hole == 0 || self.random.is(12) {
                self.word(AXES[normal], bottom);
            }
            if hole == 0 || self.random.is(12) {
                self.word('R', r);
            }
            if matches!(code, "73" | "83") && (hole == 0 || self.random.is(5)) {
                let peck = self.random.between(1.0, 6.0);
                self.word('Q', peck);
            }
            if matches!(code, "82" | "86" | "89") && hole == 0 {
                self.text += if self.is_linuxcnc() { " P0.1" } else { " P100" };
            }
            if self.random.is(12) {
                let count = 1 + self.random.below(3);
                let letter = if self.is_linuxcnc() { 'L' } else { 'K' };
                let _ = write!(self.text, " {letter}{count}");
            }
            self.end();
            if self.random.is(5) {
                self.offset();
            }
        }
        match self.random.below(8) {
            0 => {}
            1 => self.text += " G1\n",
            _ => self.text += " G80\n",
        }
    }

    fn offset(&mut self) {
        self.begin();
        let which = match self.random.below(5) {
            2 if self.is_grbl() => 3,
            which => which,
        };
        match which {
            0 | 1 => {
                let work = self.random.below(3);
                self.work = work;
                let _ = write!(self.text, " G{}", 54 + work);
                if self.random.is(30) {
                    self.settle();
                    self.text += " G0";
                    self.axes(40.0);
                }
            }
            2 => {
                self.text += " G52";
                self.axes(20.0);
            }
            3 => {
                if self.is_linuxcnc() && self.random.is(30) {
                    self.text += " G92.1";
                } else {
                    self.text += " G92";
                    self.axes(20.0);
                }
            }
            _ => {
                let number = self.random.below(3);
                let _ = write!(self.text, " G10 L2 P{}", number + 1);
                let adds = self.is_incremental && !self.is_linuxcnc();
                for (axis, letter) in AXES.into_iter().enumerate() {
                    if self.random.is(60) {
                        let value = (self.number(60.0) * 1000.0).round() / 1000.0;
                        self.word(letter, value);
                        let value = if self.is_inch { value * 25.4 } else { value };
                        let origin = &mut self.origins[number][axis];
                        *origin = if adds { *origin + value } else { value };
                    }
                }
            }
        }
        self.end();
    }

    fn mode(&mut self) {
        self.begin();
        match self.random.below(9) {
            0..=2 => {
                let is = self.random.is(50);
                self.distance(is);
            }
            3 => self.select(),
            4 if !self.is_grbl() => self.text += self.random.one(&[" G98", " G99"]),
            5 => self.text += self.random.one(&[" G0", " G1", " G80"]),
            6 if self.random.is(30) => {
                self.is_inch = self.random.is(50);
                self.text += if self.is_inch { " G20" } else { " G21" };
            }
            7 if self.is_grbl() => self.text += " G91.1",
            7 if self.is_linuxcnc() => self.text += self.random.one(&[" G90.1", " G91.1"]),
            _ => self.text += " G94 F150.",
        }
        self.end();
    }

    fn call(&mut self) {
        // A first call from where nobody knows leaves what it moves nowhere: it has directions only.
        if self.callable.is_empty() || self.frame.is_none() {
            return self.place();
        }
        self.begin();
        let number = self.random.one(&self.callable.clone());
        let _ = write!(self.text, " M98 P{number}");
        if self.random.is(30) {
            let times = 1 + self.random.below(3);
            let _ = write!(self.text, " L{times}");
        }
        self.text.push('\n');
        self.has_calls = true;
        if self.random.is(75) {
            self.place();
        }
    }

    fn machine(&mut self) {
        self.begin();
        let most = if self.is_grbl() { 3 } else { 7 };
        match self.random.below(most) {
            0 => self.text += " G91 G28 Z0.\n G90",
            1 => self.text += " G91 G28 X0. Y0.\n G90",
            2 => self.text += " G53 G0 Z666.666",
            3 => self.text += " T1 M6",
            4 => self.text += " G43 H1",
            5 => self.text += " G49",
            _ => self.text += " G4 P100",
        }
        if self.text.ends_with("G90") {
            self.is_incremental = false;
        }
        self.text.push('\n');
    }

    fn line(&mut self) {
        match self.random.below(100) {
            0..=17 => self.place(),
            18..=47 => self.straight(),
            48..=59 => self.arc(),
            60..=71 => self.cycle(),
            72..=80 => self.offset(),
            81..=87 => self.mode(),
            88..=93 => self.call(),
            94..=96 => self.machine(),
            97 if !self.is_grbl() => self.text += "#101=[#102+2.5]\n",
            98 => self.text += "(NOTHING)\n",
            _ => self.text += "M8\n",
        }
    }

    fn lines(&mut self, most: usize) {
        let count = 1 + self.random.below(most);
        for _ in 0..count {
            self.line();
        }
    }
}

fn transform(random: &mut Random) -> RigidTransform {
    let shift = [0; 3].map(|_: i32| random.between(-20.0, 20.0));
    let degrees = match random.below(8) {
        0 => [0.0; 3],
        1 | 2 => [0.0, 0.0, random.between(-180.0, 180.0)],
        3 => [0.0, 0.0, random.one(&[90.0, 180.0, -90.0])],
        4 => [0; 3].map(|_: i32| random.between(-0.02, 0.02)),
        5 => [0; 3].map(|_: i32| random.between(-3.0, 3.0)),
        6 => [0; 3].map(|_: i32| random.between(-60.0, 60.0)),
        _ => [random.between(-1.0, 1.0), 0.0, 0.0],
    };
    turned(degrees, shift)
}

/// A program, its control and a transform.
pub fn case(random: &mut Random, family: ControlFamily, scope: Scope) -> Case {
    let is_linuxcnc = matches!(family, ControlFamily::LinuxCnc | ControlFamily::Grbl);
    let mut origins = [[0.0; 3]; 6];
    let mut origins_mm = [None; 6];
    let mut before = String::from("G21 G90\n");
    for (number, origin) in origins.iter_mut().enumerate().take(3) {
        if random.is(70) {
            for value in origin.iter_mut() {
                *value = random.between(-80.0, 80.0).round();
            }
        }
        let [x, y, z] = *origin;
        let _ = writeln!(before, "G10 L2 P{} X{x:.3} Y{y:.3} Z{z:.3}", number + 1);
        if random.is(80) {
            origins_mm[number] = Some(*origin);
        }
    }
    // What is in force, in tenths, and whether it is said to the rewriter or by the program.
    let mut start = StartModes::default();
    let mut header = String::new();
    let mut state = [900, 210, 170, 980, 540];
    if !is_linuxcnc && random.is(30) {
        state = [
            random.one(&[900, 910]),
            if random.is(10) { 200 } else { 210 },
            random.one(&[170, 180, 190]),
            random.one(&[980, 990]),
            random.one(&[540, 550]),
        ];
    }
    let defaults = [0, 0, 170, 980, 540];
    for (code, default) in state.into_iter().zip(defaults) {
        if family == ControlFamily::Grbl && code == 980 {
            continue;
        }
        let _ = write!(before, "G{} ", code / 10);
        if random.is(25) || code != default && random.is(20) {
            start = start.with(code).expect("one of each group");
        } else if code != default || random.is(50) {
            let _ = write!(header, " G{}", code / 10);
        }
    }
    if !is_linuxcnc && random.is(20) {
        start = start.with(0).expect("one of each group");
    }
    before += if is_linuxcnc { "\nM2\n" } else { "G0\nM30\n" };
    let work = usize::from(state[4] == 550);
    let mut writer = Writer {
        random,
        family,
        scope,
        text: String::new(),
        work,
        origins,
        frame: None,
        is_incremental: state[0] == 910,
        is_inch: state[1] == 200,
        plane: (usize::from(state[2]) - 170) / 10,
        callable: Vec::new(),
        has_calls: false,
    };
    let has_subs = !is_linuxcnc && writer.random.is(50);
    let subs_first = has_subs && writer.random.is(25);
    let sub = |writer: &mut Writer<'_>, number: u32| {
        let _ = writeln!(writer.text, "O{number}");
        writer.callable = if number == 100 { vec![200] } else { Vec::new() };
        if !has_subs {
            writer.callable.clear();
        }
        if subs_first || writer.random.is(20) {
            writer.say(&header, work);
        }
        if writer.random.is(40) {
            writer.place();
        }
        writer.lines(5);
        if writer.random.is(60) && writer.is_incremental != (state[0] == 910) {
            let is = state[0] == 910;
            writer.distance(is);
            writer.text.push('\n');
        }
        writer.text += "M99\n";
    };
    if subs_first {
        sub(&mut writer, 100);
        sub(&mut writer, 200);
    }
    if !is_linuxcnc {
        writer.text += "O1\n";
    }
    writer.say(&header, work);
    // Behind others the text could be that of a subprogram: called from anywhere, directions turn.
    if subs_first || writer.random.is(90) {
        writer.place();
    }
    writer.callable = if has_subs { vec![100, 200] } else { Vec::new() };
    writer.lines(12);
    let loops = !is_linuxcnc && writer.random.is(20);
    writer.text += match (is_linuxcnc, loops) {
        (true, _) => "M2\n",
        (_, true) => "M99\n",
        (_, false) => "M30\n",
    };
    if has_subs && !subs_first {
        sub(&mut writer, 100);
        sub(&mut writer, 200);
    }
    let program = writer.text.replace("\n ", "\n").replace("/ ", "/");
    let program = program.trim_start().to_owned();
    let frame_mm = writer.frame.unwrap_or(origins[work]);
    let has_calls = writer.has_calls;
    Case {
        family,
        before,
        program,
        start,
        origins_mm,
        frame_mm,
        transform: transform(random),
        has_calls,
    }
}
