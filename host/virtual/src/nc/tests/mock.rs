//! Axes that note what they are told, with a wall or two.

use std::collections::BTreeSet;

use umi_core::units::Point;

use crate::nc::{
    Alarm, AxisDrives, AxisMotion, BlockStep, Control, ControlFamily, ControlSettings, MotionPath,
    MotionRate, Skip, Trip,
};

/// What the axes did.
#[derive(Clone, Debug, Default)]
pub struct Mock {
    pub at: [f64; 3],
    pub moves: Vec<AxisMotion>,
    pub printed: Vec<u8>,
    pub codes: Vec<u32>,
    pub dwelt: f64,
    pub tool: u32,
    pub inputs: BTreeSet<u16>,
    pub outputs: BTreeSet<u16>,
    /// The skip signal comes at this coordinate: axis and value.
    pub wall: Option<(usize, f64)>,
    /// How far the axes run on behind it.
    pub overrun: f64,
}

impl AxisDrives for Mock {
    fn position(&self) -> Point {
        Point::from_array_mm(self.at)
    }

    fn reference_point(&self) -> Point {
        Point::from_mm(0.0, 0.0, 500.0)
    }

    fn travel(&mut self, motion: &AxisMotion) -> Result<(), Trip> {
        self.at = motion.to.to_array_mm();
        self.moves.push(motion.clone());
        Ok(())
    }

    fn skip(&mut self, motion: &AxisMotion, _: bool) -> Result<Skip, Trip> {
        self.moves.push(motion.clone());
        let from = self.at;
        let to = motion.to.to_array_mm();
        if let Some((axis, wall)) = self.wall {
            let (a, b) = (from[axis], to[axis]);
            if (a - wall) * (b - wall) <= 0.0 && a != b {
                let part = (wall - a) / (b - a);
                let stored = [0, 1, 2].map(|i| from[i] + part * (to[i] - from[i]));
                self.at = stored;
                self.at[axis] += self.overrun * (b - a).signum();
                return Ok(Skip {
                    touched: true,
                    stored: Point::from_array_mm(stored),
                });
            }
        }
        self.at = to;
        Ok(Skip {
            touched: false,
            stored: motion.to,
        })
    }

    fn dwell(&mut self, seconds: f64) {
        self.dwelt += seconds;
    }

    fn change_tool(&mut self, number: u32) -> Result<(), Trip> {
        self.tool = number;
        Ok(())
    }

    fn auxiliary(&mut self, m: u32, _: f64) -> Result<(), Trip> {
        self.codes.push(m);
        if m == 66 {
            return Err(Trip {
                message: "no such function".into(),
            });
        }
        Ok(())
    }

    fn print(&mut self, bytes: &[u8]) -> Result<(), Trip> {
        self.printed.extend_from_slice(bytes);
        Ok(())
    }

    fn input(&self, number: u16) -> bool {
        self.inputs.contains(&number)
    }

    fn output(&mut self, number: u16, on: bool) {
        if on {
            self.outputs.insert(number);
        } else {
            self.outputs.remove(&number);
        }
    }

    fn seconds(&self) -> f64 {
        12.5
    }
}

impl Mock {
    /// What was printed.
    pub fn text(&self) -> String {
        String::from_utf8(self.printed.clone()).expect("ASCII")
    }

    /// The ends of the motions, rounded to a micrometre, with the feed (0 rapid).
    pub fn ends(&self) -> Vec<[f64; 4]> {
        self.moves
            .iter()
            .map(|motion| {
                let [x, y, z] = motion.to.to_array_mm().map(round);
                let feed = match motion.rate {
                    MotionRate::Rapid => 0.0,
                    MotionRate::Feed(feed) => feed,
                };
                [x, y, z, feed]
            })
            .collect()
    }

    /// Centre, axis and sweep in degrees of the only arc.
    pub fn arc(&self) -> ([f64; 3], [f64; 3], f64) {
        let arcs: Vec<_> = self
            .moves
            .iter()
            .filter_map(|motion| match motion.path {
                MotionPath::Arc {
                    center,
                    axis,
                    sweep,
                } => Some((
                    center.to_array_mm().map(round),
                    [axis.x, axis.y, axis.z].map(round),
                    round(sweep.to_degrees()),
                )),
                MotionPath::Line => None,
            })
            .collect();
        assert_eq!(arcs.len(), 1, "one arc");
        arcs[0]
    }
}

pub fn round(value: f64) -> f64 {
    (value * 1e6).round() / 1e6 + 0.0
}

/// A Fanuc with DC codes off and zero suppression on.
pub fn fanuc() -> ControlSettings {
    ControlSettings {
        leading_blanks: false,
        dc_codes: false,
        ..ControlSettings::default()
    }
}

/// Loads a text and runs its first program to the end.
pub fn run_with(
    settings: ControlSettings,
    mock: &mut Mock,
    text: &str,
) -> (Control, Result<BlockStep, Alarm>) {
    let mut control = Control::new(settings);
    let numbers = control.load(text).expect("loads");
    control.select(numbers[0]).expect("in memory");
    let end = control.run(mock);
    (control, end)
}

/// Runs a Fanuc program to its end.
pub fn run(text: &str) -> (Control, Mock) {
    let mut mock = Mock::default();
    let (control, end) = run_with(fanuc(), &mut mock, &format!("O1\n{text}\nM30\n"));
    if let Err(alarm) = end {
        panic!("{alarm}");
    }
    (control, mock)
}

/// Runs a Fanuc program to its alarm.
pub fn alarm(text: &str) -> Alarm {
    let mut mock = Mock::default();
    let (_, end) = run_with(fanuc(), &mut mock, &format!("O1\n{text}\nM30\n"));
    end.expect_err(text)
}

/// Runs a program of another dialect to its end.
pub fn run_in(dialect: ControlFamily, text: &str) -> (Control, Mock) {
    let mut mock = Mock::default();
    let (control, end) = run_with(ControlSettings::of(dialect), &mut mock, text);
    if let Err(alarm) = end {
        panic!("{alarm}");
    }
    (control, mock)
}
