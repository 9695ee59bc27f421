//! The programs of the thesis (appendices C to F) run as they are printed.

use umi_core::units::Point;
use umi_virtual::nc::{
    AxisDrives, AxisMotion, Control, ControlSettings, OffsetSystem, ProgramState, Skip, Trip, check,
};

/// What the probe may touch.
#[derive(Clone, Copy)]
enum Thing {
    /// A ball: centre and radius.
    Ball([f64; 3], f64),
    /// A ring gauge about Z: radius of the bore.
    Ring(f64),
    Nothing,
}

/// Radius of the stylus tip, mm; positions are those of its centre.
const TIP_MM: f64 = 2.5;

struct Machine {
    at: [f64; 3],
    thing: Thing,
    printed: Vec<u8>,
    ends: Vec<[f64; 3]>,
    tool: Option<u32>,
}

impl Machine {
    fn new(thing: Thing) -> Self {
        Self {
            at: [0.0; 3],
            thing,
            printed: Vec::new(),
            ends: Vec::new(),
            tool: None,
        }
    }

    /// The part of the way at which the tip touches.
    fn contact(&self, to: [f64; 3]) -> Option<f64> {
        let way = [0, 1, 2].map(|i| to[i] - self.at[i]);
        let (from, way, radius) = match self.thing {
            Thing::Ball(center, radius) => (
                [0, 1, 2].map(|i| self.at[i] - center[i]),
                way,
                radius + TIP_MM,
            ),
            Thing::Ring(radius) => (
                [self.at[0], self.at[1], 0.0],
                [way[0], way[1], 0.0],
                radius - TIP_MM,
            ),
            Thing::Nothing => return None,
        };
        let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        let (a, b, c) = (
            dot(way, way),
            dot(from, way),
            dot(from, from) - radius * radius,
        );
        let root = b * b - a * c;
        if a == 0.0 || root < 0.0 {
            return None;
        }
        let t = match self.thing {
            Thing::Ring(_) => (-b + root.sqrt()) / a,
            _ => (-b - root.sqrt()) / a,
        };
        (0.0..=1.0).contains(&t).then_some(t)
    }
}

impl AxisDrives for Machine {
    fn position(&self) -> Point {
        Point::from_array_mm(self.at)
    }
    fn reference_point(&self) -> Point {
        Point::from_mm(0.0, 0.0, 400.0)
    }
    fn travel(&mut self, motion: &AxisMotion) -> Result<(), Trip> {
        self.at = motion.to.to_array_mm();
        self.ends.push(self.at);
        Ok(())
    }
    fn skip(&mut self, motion: &AxisMotion, _: bool) -> Result<Skip, Trip> {
        let to = motion.to.to_array_mm();
        let part = self.contact(to);
        let part_or_all = part.unwrap_or(1.0);
        self.at = [0, 1, 2].map(|i| self.at[i] + part_or_all * (to[i] - self.at[i]));
        Ok(Skip {
            touched: part.is_some(),
            stored: self.position(),
        })
    }
    fn dwell(&mut self, _: f64) {}
    fn change_tool(&mut self, number: u32) -> Result<(), Trip> {
        self.tool = Some(number);
        Ok(())
    }
    fn auxiliary(&mut self, _: u32, _: f64) -> Result<(), Trip> {
        Ok(())
    }
    fn print(&mut self, bytes: &[u8]) -> Result<(), Trip> {
        self.printed.extend_from_slice(bytes);
        Ok(())
    }
    fn input(&self, _: u16) -> bool {
        false
    }
    fn output(&mut self, _: u16, _: bool) {}
    fn seconds(&self) -> f64 {
        0.0
    }
}

/// The control of the thesis: zeros suppressed, as its point lines show.
fn settings() -> ControlSettings {
    ControlSettings {
        leading_blanks: false,
        feed_mm_min: Some(100.0),
        ..ControlSettings::default()
    }
}

fn run(settings: ControlSettings, machine: &mut Machine, text: &str) -> Control {
    let mut control = Control::new(settings);
    let numbers = control.load(text).expect("loads");
    control.select(numbers[0]).expect("in memory");
    match control.run(machine) {
        Ok(step) => assert_eq!(step.state, ProgramState::Ended),
        Err(alarm) => panic!("{alarm}"),
    }
    control
}

const RING: &str = include_str!("thesis/ring_gauge_c.nc");
const SPHERE: &str = include_str!("thesis/sphere_d.nc");
const NOMINAL: &str = include_str!("thesis/nominal_path_e.nc");
const TRANSFORMED: &str = include_str!("thesis/transformed_path_f.nc");

/// Appendix C in the ring gauge of 71.1327 mm: five hits, 5 degrees apart from +Y, to the
/// byte. Each line is a session of its own on the wire.
#[test]
fn ring_gauge() {
    let radius = 71.1327 / 2.0;
    let mut machine = Machine::new(Thing::Ring(radius));
    run(settings(), &mut machine, RING);
    let mut expected = String::from("\x12Index,X,Y\n\x14");
    for hit in 1..=5 {
        let angle = f64::from(5 * hit).to_radians();
        let reach = radius - TIP_MM;
        // IS-B: the stored position has three decimals; the programmed end does, too,
        // which turns the direction by less than it shows.
        let round = |mm: f64| (mm * 1000.0).round() / 1000.0;
        expected.push_str(&format!(
            "\x12{hit},{:.4},{:.4}\n\x14",
            round(reach * angle.sin()),
            round(reach * angle.cos())
        ));
    }
    assert_eq!(String::from_utf8_lossy(&machine.printed), expected);
}

/// Appendix C on a control just switched on: no feed, alarm 11 at the first G1.
#[test]
fn ring_gauge_without_feed() {
    let mut control = Control::new(ControlSettings {
        feed_mm_min: None,
        ..settings()
    });
    control.load(RING).expect("loads");
    control.select(1040).expect("O1040");
    let alarm = control
        .run(&mut Machine::new(Thing::Nothing))
        .expect_err("no feed");
    assert_eq!((alarm.number, alarm.line), (Some(11), 11));
}

/// Appendix D on a ball of one inch, begun 3 mm beside it: five points about the ball. The
/// program takes 0.062 mm of pretravel into account that this probe does not have, so X
/// and Y are that much too far out.
#[test]
fn sphere() {
    let center = [-136.715, 136.412, 136.121];
    let mut machine = Machine::new(Thing::Ball(center, 12.7));
    machine.at = [center[0] + 3.0, center[1] - 2.0, center[2] + 40.0];
    run(settings(), &mut machine, SPHERE);
    let text = String::from_utf8(machine.printed.clone()).expect("ASCII");
    let body = text
        .strip_prefix("\x12SPHERE1\n   \n5\n")
        .and_then(|text| text.strip_suffix("   \n\x14"))
        .expect(&text);
    let out = 12.7 + 0.062;
    let [x, y, z] = center;
    let expected = [
        [x, y, z + 12.7],
        [x + out, y, z],
        [x - out, y, z],
        [x, y + out, z],
        [x, y - out, z],
    ];
    let lines: Vec<&str> = body.lines().collect();
    assert_eq!(lines.len(), 5);
    for (line, expected) in lines.iter().zip(expected) {
        assert!(line.starts_with(' '), "{line}");
        let got: Vec<f64> = line
            .split_whitespace()
            .map(|word| word.parse().expect(line))
            .collect();
        for (got, expected) in got.iter().zip(expected) {
            assert!((got - expected).abs() < 0.0016, "{line}: {expected}");
        }
    }
    assert_eq!(lines[0], " -136.7150 136.4120 148.8210");
}

/// Appendix E: tool table, both work offsets, the first laces.
#[test]
fn nominal_path() {
    let mut machine = Machine::new(Thing::Nothing);
    let mut control = Control::new(settings());
    control.set_offset(OffsetSystem::Extended(1), [100.0, 0.0, 0.0]);
    control.set_offset(OffsetSystem::Standard(1), [7.0, 7.0, 7.0]);
    assert_eq!(control.load(NOMINAL), Ok(vec![1]));
    control.select(1).expect("O0001");
    let end = control.run(&mut machine);
    assert_eq!(end.map(|step| step.state), Ok(ProgramState::Ended));
    assert_eq!(control.offsets().length(1), 85.0);
    assert_eq!(control.offsets().radius(1), 4.0);
    assert_eq!(control.offset(OffsetSystem::Standard(1)), [0.0; 3]);
    assert_eq!(machine.tool, Some(0));
    let last = machine.ends.last().copied().expect("moves");
    for (got, expected) in last.iter().zip([100.0 - 25.399, 31.84, 24.707]) {
        assert!((got - expected).abs() < 1e-9);
    }
}

/// Appendix F: all its moves, in absolute coordinates.
#[test]
fn transformed_path() {
    let mut machine = Machine::new(Thing::Nothing);
    let control = run(settings(), &mut machine, TRANSFORMED);
    assert_eq!(machine.ends.len(), 43);
    assert_eq!(control.status().feed_mm_min, Some(250.0));
    assert_eq!(machine.ends[42], [6.512, 25.16, -14.97]);
}

/// The checker complains of nothing but the open brackets of appendix C.
#[test]
fn checked() {
    let found = check(RING, &settings());
    assert_eq!(found.len(), 5, "{found:?}");
    assert!(
        found
            .iter()
            .all(|alarm| alarm.message.contains("not closed"))
    );
    for text in [SPHERE, NOMINAL, TRANSFORMED] {
        let found = check(text, &settings());
        assert!(found.is_empty(), "{found:?}");
    }
}
