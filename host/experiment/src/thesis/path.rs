//! The finishing path as an NC program, in the style of the thesis' appendix E.

use std::fmt::Write as _;

use umi_virtual::nc::ControlFamily;

use super::part::{BALL_RADIUS_MM, NOMINAL, OUTERMOST_SINE, PASS_X_MM, SEAT_MM, SECTIONS};

/// Number of the tool and of its length offset.
pub const TOOL: u32 = 2;

/// The path between two passes and before the first: far above the part.
const SAFE_Z_MM: f64 = SEAT_MM + 50.0;

/// Rapid ends and feed begins this far above a pass.
const APPROACH_MM: f64 = 5.0;

/// The passes of the whole surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Passes {
    /// Gaps between two passes.
    gaps: u32,
    /// Between two passes, about the arc's axis, radians.
    step_rad: f64,
}

/// Why there are no such passes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepoverFault(pub f64);

impl std::fmt::Display for StepoverFault {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "a stepover of {} mm: it must be from {} to {} mm",
            self.0,
            Passes::STEPOVER_MM[0],
            Passes::STEPOVER_MM[1]
        )
    }
}

impl Passes {
    /// The stepovers that can be asked for, mm: below, block numbers outgrow their
    /// digits; above, a pass no longer meets its neighbour.
    pub const STEPOVER_MM: [f64; 2] = [0.05, 4.0];

    /// The stepover of appendix E on the surface, mm: its passes are 0.5655 mm apart
    /// on the circle of the tips, radius 92.87.
    pub const THESIS_MM: f64 = 0.5655 * (92.87 - BALL_RADIUS_MM) / 92.87;

    /// Passes at most this far from one another on the finished surface, mm.
    ///
    /// # Errors
    /// Beyond [`Self::STEPOVER_MM`].
    pub fn new(stepover_mm: f64) -> Result<Self, StepoverFault> {
        let [least, most] = Self::STEPOVER_MM;
        if !(least..=most).contains(&stepover_mm) {
            return Err(StepoverFault(stepover_mm));
        }
        let whole = 2.0 * OUTERMOST_SINE.asin();
        let gaps = (whole * NOMINAL.radius_mm / stepover_mm).ceil();
        Ok(Self {
            step_rad: whole / gaps,
            #[allow(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "below 2000 by the limits"
            )]
            gaps: gaps as u32,
        })
    }

    /// How many passes there are.
    #[must_use]
    pub fn count(&self) -> u32 {
        self.gaps + 1
    }

    /// Between two passes on the finished surface, mm.
    #[must_use]
    pub fn stepover_mm(&self) -> f64 {
        self.step_rad * NOMINAL.radius_mm
    }

    /// Height of the cusps between two passes, mm: where two circles of the ball's
    /// radius meet, over the arc.
    #[must_use]
    pub fn cusp_mm(&self) -> f64 {
        let ball = NOMINAL.radius_mm + BALL_RADIUS_MM;
        let (sin, cos) = (self.step_rad / 2.0).sin_cos();
        let half = ball * sin;
        ball * cos - (BALL_RADIUS_MM * BALL_RADIUS_MM - half * half).sqrt() - NOMINAL.radius_mm
    }

    /// Angle of a pass about the arc's axis, positive to +Y; the first is outermost
    /// at +Y.
    fn angle_rad(&self, pass: u32) -> f64 {
        OUTERMOST_SINE.asin() - self.step_rad * f64::from(pass)
    }

    /// The passes of a section, and of sections beyond the last one none.
    fn of_section(&self, section: usize) -> std::ops::Range<u32> {
        let from = |section: usize| {
            let part = section.min(SECTIONS) as u32 * self.count();
            part / SECTIONS as u32
        };
        from(section)..from(section + 1)
    }

    /// The section's stretch in Y on the finished surface, mm, from the border or the
    /// middle between its pass and the neighbour's.
    #[must_use]
    pub fn section_y_mm(&self, section: usize) -> [f64; 2] {
        let passes = self.of_section(section);
        let between = |pass: u32| {
            if pass == 0 || pass == self.count() {
                // Rounding must not lose the border's nodes.
                return if pass == 0 {
                    f64::INFINITY
                } else {
                    f64::NEG_INFINITY
                };
            }
            let angle = self.angle_rad(pass) + self.step_rad / 2.0;
            NOMINAL.axis_y_mm + NOMINAL.radius_mm * angle.sin()
        };
        [between(passes.end), between(passes.start)]
    }

    /// The program of a section.
    ///
    /// `offset` is the block that brings the work offset into force: `G54`, or the
    /// call of a correction program, which sets an offset and a rotation. Everything
    /// that would be disturbed by a rotation (reference point, tool change) comes
    /// before it. Numbers have three decimals, the control's increment; that moves
    /// the surface by no more than 0.0007 mm.
    #[must_use]
    pub fn program(&self, number: u32, section: usize, offset: &str) -> String {
        let mut blocks = Blocks::default();
        blocks.add("G21 G90 G40 G49 G69 G17 G94");
        blocks.add("G28 G91 Z0.");
        blocks.add("G90");
        blocks.add(&format!("T{TOOL:02} M06 (8.0 MM DIA BALL NOSE MILL)"));
        blocks.add(offset);
        blocks.add("S5000 M3");
        let [left, right] = PASS_X_MM;
        let mut first = true;
        for pass in self.of_section(section) {
            let (sin, cos) = self.angle_rad(pass).sin_cos();
            let ball = NOMINAL.radius_mm + BALL_RADIUS_MM;
            let y = NOMINAL.axis_y_mm + ball * sin;
            let z = NOMINAL.axis_z_mm + ball * cos - BALL_RADIUS_MM;
            let place = |x: f64, z: f64| format!("X{} Y{} Z{}", Word(x), Word(y), Word(z));
            if first {
                blocks.add(&format!("G0 X{} Y{}", Word(left), Word(y)));
                blocks.add(&format!("G43 Z{} H{TOOL:02} M8", Word(SAFE_Z_MM)));
            } else {
                blocks.add(&format!("G0 {}", place(left, SAFE_Z_MM)));
            }
            blocks.add(&format!("G0 {}", place(left, z + APPROACH_MM)));
            let feed = if first { " F1000." } else { "" };
            blocks.add(&format!("G1 {}{feed}", place(left, z)));
            blocks.add(&format!("G1 {}", place(right, z)));
            blocks.add(&format!("G0 {}", place(right, SAFE_Z_MM)));
            first = false;
        }
        blocks.add("M5 M9");
        blocks.add("G69");
        blocks.add("G49 G54");
        blocks.add("G28 G91 Z0.");
        blocks.add("G90");
        blocks.add("M30");
        format!(
            "%\nO{number:04}(CYLINDER ARC - SECTION {section})\n(DEFINE OPERATION - PARALLEL LACE OPERATION)\n{}%\n",
            blocks.text
        )
    }

    /// Points of the whole path in the reference clamping, mm: both ends and the
    /// middle of the outermost passes and of the middle one, at the ball's tip.
    #[must_use]
    pub fn landmarks_mm(&self) -> Vec<[f64; 3]> {
        let [left, right] = PASS_X_MM;
        let ball = NOMINAL.radius_mm + BALL_RADIUS_MM;
        [0, self.gaps / 2, self.gaps]
            .iter()
            .flat_map(|&pass| {
                let (sin, cos) = self.angle_rad(pass).sin_cos();
                let y = NOMINAL.axis_y_mm + ball * sin;
                let z = NOMINAL.axis_z_mm + ball * cos - BALL_RADIUS_MM;
                [left, f64::midpoint(left, right), right].map(|x| [x, y, z])
            })
            .collect()
    }
}

/// A finishing program as another control takes it: LinuxCNC and GRBL have no O number and
/// no `G69`, GRBL neither tool changes nor lengths by number.
#[must_use]
pub fn in_language(program: &str, language: ControlFamily) -> String {
    if language.is_macro_b() {
        return program.to_owned();
    }
    let is_grbl = language == ControlFamily::Grbl;
    let mut made = String::new();
    for line in program.lines() {
        let is_name = line.starts_with('O') || line == "%";
        if is_name || line.ends_with(" G69") || (is_grbl && line.contains(" M06")) {
            continue;
        }
        let mut line = line.replace(" G69", "");
        if is_grbl {
            line = line
                .replace(" G43", " G0")
                .replace(&format!(" H{TOOL:02}"), "");
        }
        made += &line;
        made.push('\n');
    }
    made
}

/// Numbered blocks.
#[derive(Default)]
struct Blocks {
    text: String,
    number: u32,
}

impl Blocks {
    fn add(&mut self, block: &str) {
        self.number += 10;
        // Writing to a String cannot fail.
        let _ = writeln!(self.text, "N{} {block}", self.number);
    }
}

/// A length as appendix E writes it: a point always, three decimals, no zeros at the
/// end but one.
struct Word(f64);

impl std::fmt::Display for Word {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let text = format!("{:.3}", self.0);
        let text = text.trim_end_matches('0');
        let point = if text.ends_with('.') { "0" } else { "" };
        let text = if text == "-0." { "0." } else { text };
        write!(f, "{text}{point}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Motion blocks without their numbers.
    fn motions(program: &str) -> Vec<String> {
        program
            .lines()
            .filter_map(|line| line.split_once(' '))
            .map(|(_, block)| block.to_owned())
            .filter(|block| block.starts_with("G0 ") || block.starts_with("G1 "))
            .collect()
    }

    fn numbers(block: &str) -> Vec<f64> {
        block
            .split(' ')
            .filter(|word| word.starts_with(['X', 'Y', 'Z']))
            .map(|word| word[1..].parse().unwrap())
            .collect()
    }

    /// With the thesis' stepover the passes are those of appendix E: Y and Z of its
    /// first seven, 64 mm higher; the CAM's own chord error is 7 µm.
    #[test]
    fn the_passes_are_those_of_appendix_e() {
        const PRINTED: [[f64; 2]; 7] = [
            [35.004, 18.486],
            [34.48, 18.698],
            [33.955, 18.909],
            [33.431, 19.12],
            [32.901, 19.316],
            [32.37, 19.511],
            [31.84, 19.707],
        ];
        let passes = Passes::new(Passes::THESIS_MM + 1e-3).unwrap();
        let program = passes.program(1, 0, "G54");
        let cuts: Vec<Vec<f64>> = motions(&program)
            .iter()
            .filter(|block| block.starts_with("G1 X25.391"))
            .map(|block| numbers(block))
            .collect();
        for (cut, printed) in cuts.iter().zip(PRINTED) {
            let off = (cut[1] - printed[0]).hypot(cut[2] - SEAT_MM - printed[1]);
            assert!(off < 0.03, "{cut:?} {printed:?}");
            let ball = NOMINAL.radius_mm + BALL_RADIUS_MM;
            let radius =
                (cut[1] - NOMINAL.axis_y_mm).hypot(cut[2] + BALL_RADIUS_MM - NOMINAL.axis_z_mm);
            assert!((radius - ball).abs() < 0.0008, "{radius}");
        }
        assert!(
            (passes.cusp_mm() - 0.0095).abs() < 0.0002,
            "{}",
            passes.cusp_mm()
        );
    }

    /// The sections together are every pass once, and their stretches join.
    #[test]
    fn sections_are_the_whole_surface() {
        for stepover in [0.05, 0.2, 0.541, 4.0] {
            let passes = Passes::new(stepover).unwrap();
            assert!(passes.stepover_mm() <= stepover);
            let mut seen = 0;
            let mut above = f64::INFINITY;
            for section in 0..SECTIONS {
                seen += passes.of_section(section).len() as u32;
                let [low, high] = passes.section_y_mm(section);
                assert!(low < high);
                assert_eq!(high.to_bits(), above.to_bits());
                above = low;
            }
            assert_eq!(seen, passes.count());
            assert!(above == f64::NEG_INFINITY);
            let all: usize = (0..SECTIONS)
                .map(|section| motions(&passes.program(1, section, "G54")).len())
                .sum();
            assert_eq!(all, 5 * passes.count() as usize);
        }
        assert_eq!(Passes::new(0.0), Err(StepoverFault(0.0)));
        assert!(Passes::new(f64::NAN).is_err());
    }

    /// Words as a control wants them: a point, no negative zero.
    #[test]
    fn words_have_a_point() {
        let words = [50.0, -25.399, 34.48, -0.0001, 0.0, 1000.0].map(|n| Word(n).to_string());
        assert_eq!(words, ["50.0", "-25.399", "34.48", "0.0", "0.0", "1000.0"]);
    }

    /// What is left for a control without O numbers, rotations, tools is the same motions.
    #[test]
    fn another_language_is_the_same_path() {
        let program = Passes::new(1.0).unwrap().program(2, 3, "G54");
        assert_eq!(in_language(&program, ControlFamily::Haas), program);
        for language in [ControlFamily::LinuxCnc, ControlFamily::Grbl] {
            let made = in_language(&program, language);
            let words = |text: &str| -> Vec<String> {
                motions(text)
                    .iter()
                    .filter(|block| block.contains('X'))
                    .cloned()
                    .collect()
            };
            assert_eq!(words(&made), words(&program));
            assert!(!made.contains("G69") && !made.contains('%') && !made.contains("O0"));
            let is_grbl = language == ControlFamily::Grbl;
            assert_eq!(made.contains("M06") || made.contains('H'), !is_grbl);
        }
    }

    /// The offset is called after everything that a rotation would disturb.
    #[test]
    fn the_offset_comes_after_the_tool() {
        let program = Passes::new(1.0).unwrap().program(2, 3, "M98 P9010");
        let place = |text: &str| program.find(text).unwrap();
        assert!(place("M06") < place("M98 P9010"));
        assert!(place("M98 P9010") < place("G43"));
        assert!(program.starts_with("%\nO0002(CYLINDER ARC - SECTION 3)\n"));
        assert!(program.ends_with("M30\n%\n"));
        assert!(program.lines().all(|line| line.len() < 80));
    }
}
