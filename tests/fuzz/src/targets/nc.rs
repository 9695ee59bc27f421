//! The NC interpreter under programs of all kinds. The first byte chooses the dialect and
//! the settings, the second what the axes answer; the rest is the text.
//!
//! No panic, and an end within the limits; what goes to the axes is finite; the checker
//! reads the same text without a panic, and an alarm names a line of the text.

use umi_core::units::Point;
use umi_virtual::nc::{
    AxisDrives, AxisMotion, Control, ControlFamily, ControlSettings, DecimalPoint, ExecutionLimits,
    LineEnd, MotionPath, ProgramState, Skip, Trip, check,
};

/// One input.
pub fn one(data: &[u8]) {
    let [mode, answers, text @ ..] = data else {
        return;
    };
    let text = String::from_utf8_lossy(text);
    let settings = settings(*mode);
    let lines = text.lines().count() as u32 + text.matches('\r').count() as u32 + 1;
    let _ = check(&text, &settings);
    let mut control = Control::new(settings);
    let Ok(numbers) = control.load(&text) else {
        return;
    };
    let mut machine = Machine {
        at: Point::from_mm(0.0, 0.0, 0.0),
        answers: *answers,
        printed: 0,
    };
    for number in numbers {
        control.select(number).expect("just loaded");
        // Stops are passed; the limits end the rest.
        loop {
            match control.step(&mut machine) {
                Ok(step) if step.state == ProgramState::Ended => break,
                Ok(step) => assert!(step.line <= lines),
                Err(alarm) => {
                    assert!(alarm.line <= lines);
                    assert!(!alarm.to_string().contains('\n'));
                    break;
                }
            }
            let _ = control.status();
        }
        assert!(control.variable(0).is_none() || *mode % 5 >= 3);
    }
}

fn settings(mode: u8) -> ControlSettings {
    let dialect = match mode % 5 {
        0 => ControlFamily::Fanuc,
        1 => ControlFamily::Haas,
        2 => ControlFamily::Mitsubishi,
        3 => ControlFamily::LinuxCnc,
        _ => ControlFamily::Grbl,
    };
    ControlSettings {
        increment_mm: if mode & 0x80 == 0 { 0.001 } else { 0.0001 },
        decimal_point: if mode & 0x40 == 0 {
            DecimalPoint::Increments
        } else {
            DecimalPoint::Calculator
        },
        line_end: LineEnd::CrLf,
        feed_mm_min: (mode & 0x20 == 0).then_some(100.0),
        second_reference_mm: Some([1.0, 2.0, 3.0]),
        limits: ExecutionLimits {
            blocks: 2000,
            loops: 500,
            call_depth: 10,
            text: 1 << 16,
            programs: 50,
            names: 50,
            ..ExecutionLimits::default()
        },
        ..ControlSettings::of(dialect)
    }
}

struct Machine {
    at: Point,
    answers: u8,
    printed: usize,
}

impl Machine {
    fn accept(&mut self, motion: &AxisMotion) {
        assert!(motion.to.is_finite());
        if let MotionPath::Arc {
            center,
            axis,
            sweep,
        } = motion.path
        {
            assert!(center.is_finite());
            assert!((axis.norm() - 1.0).abs() < 1e-9);
            assert!(sweep.0.is_finite());
        }
        self.at = motion.to;
    }
}

impl AxisDrives for Machine {
    fn position(&self) -> Point {
        self.at
    }
    fn reference_point(&self) -> Point {
        Point::from_mm(0.0, 0.0, 500.0)
    }
    fn travel(&mut self, motion: &AxisMotion) -> Result<(), Trip> {
        self.accept(motion);
        Ok(())
    }
    fn skip(&mut self, motion: &AxisMotion, _: bool) -> Result<Skip, Trip> {
        let from = self.at;
        self.accept(motion);
        self.answers = self.answers.rotate_left(1);
        let touched = self.answers & 1 == 1;
        if touched {
            self.at.mm = (from.mm + self.at.mm) / 2.0;
        }
        Ok(Skip {
            touched,
            stored: self.at,
        })
    }
    fn dwell(&mut self, seconds: f64) {
        assert!(seconds.is_finite() && seconds >= 0.0);
    }
    fn change_tool(&mut self, _: u32) -> Result<(), Trip> {
        Ok(())
    }
    fn auxiliary(&mut self, _: u32, s: f64) -> Result<(), Trip> {
        assert!(s.is_finite());
        Ok(())
    }
    fn print(&mut self, bytes: &[u8]) -> Result<(), Trip> {
        self.printed += bytes.len();
        Ok(())
    }
    fn input(&self, number: u16) -> bool {
        (u16::from(self.answers) >> (number % 8)) & 1 == 1
    }
    fn output(&mut self, _: u16, _: bool) {}
    fn seconds(&self) -> f64 {
        self.printed as f64
    }
}
