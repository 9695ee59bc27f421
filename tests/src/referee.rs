//! LinuxCNC's interpreter `rs274` as an independent judge of NC programs.
//!
//! It prints what a program asks of a machine as "canonical" commands: positions in the
//! units and the work coordinates in force. [`Referee::end_points`] puts these into machine
//! coordinates, so that they can be compared with what another interpreter makes of the
//! same program. It prints four decimals, so it is right within half of 0.0001 mm (of
//! 0.0001 inch where the program says G20).
//!
//! `cargo xtask set-up` brings it.

use std::f64::consts::PI;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use nalgebra::Vector3;

/// Millimetres of an inch.
const INCH_MM: f64 = 25.4;

/// How long a program may take: one that loops has no end.
const PATIENCE: Duration = Duration::from_secs(20);

/// An installed `rs274`.
#[derive(Clone, Debug)]
pub struct Referee {
    start: PathBuf,
}

/// What stands in the interpreter's files before the program begins. The interpreter
/// takes them in inches; here everything is in mm.
#[derive(Clone, Copy, Debug, Default)]
pub struct Before {
    /// The position of G28, machine coordinates.
    pub reference_point_mm: [f64; 3],
    /// The position of G30, machine coordinates.
    pub second_reference_mm: [f64; 3],
    /// Length of tool 1.
    pub tool_length_mm: f64,
}

/// A motion of a program, machine coordinates, mm.
#[derive(Clone, Copy, Debug)]
pub struct RefereeMove {
    /// Where it ends.
    pub to_mm: [f64; 3],
    /// The N number of its block, if that has one.
    pub block: Option<u32>,
    /// Whether it cuts.
    pub is_feed: bool,
    /// Of an arc the centre, the axis that it turns about, right-handed, and the angle.
    pub arc: Option<([f64; 3], [f64; 3], f64)>,
}

/// What a program asks of a machine.
#[derive(Clone, Debug)]
pub struct RefereeRun {
    /// Its motions.
    pub moves: Vec<RefereeMove>,
    /// The work offset in force at each motion, mm.
    pub origins_mm: Vec<[f64; 3]>,
    /// Whether anything was said in inches: it prints four decimals of those.
    pub has_inches: bool,
}

impl Referee {
    /// The referee beside the build whose folder for temporary files is
    /// `tmp_dir` (`CARGO_TARGET_TMPDIR` of an integration test), if it is there.
    ///
    /// # Panics
    /// Where it is required (`CI` is set) but missing.
    #[must_use]
    pub fn find(tmp_dir: &str) -> Option<Self> {
        let start = Path::new(tmp_dir)
            .parent()?
            .join("xtask")
            .join("referee")
            .join("rs274");
        if start.is_file() {
            return Some(Self { start });
        }
        let in_ci =
            std::env::var_os("CI").is_some_and(|value| !value.is_empty() && value != "false");
        assert!(
            !in_ci,
            "{} is required here; `cargo xtask set-up` brings it",
            start.display()
        );
        // Not `eprintln!`: that is not shown for a test that passes.
        let _ = std::io::Write::write_all(
            &mut std::io::stderr(),
            b"skipped: no referee of NC programs; `cargo xtask set-up` brings it\n",
        );
        None
    }

    /// Runs a program in `folder` and returns where its motions end, in machine
    /// coordinates, mm.
    ///
    /// # Errors
    /// What the interpreter says against the program, or what stands in the way of
    /// running it.
    pub fn end_points(
        &self,
        folder: &Path,
        before: &Before,
        program: &str,
    ) -> Result<Vec<[f64; 3]>, String> {
        let run = self.run(folder, before, program)?;
        Ok(run.moves.iter().map(|moved| moved.to_mm).collect())
    }

    /// Runs a program in `folder` and returns what it asks of a machine.
    ///
    /// # Errors
    /// As [`Self::end_points`].
    pub fn run(&self, folder: &Path, before: &Before, program: &str) -> Result<RefereeRun, String> {
        let said = self.interpret(folder, &[], before, program)?;
        let mut canon = Canon::new();
        for line in said.lines() {
            canon.line(line)?;
        }
        if canon.ended {
            Ok(canon.run)
        } else {
            Err(format!("the program did not end:\n{said}"))
        }
    }

    /// Runs a program in `folder` with the subroutines of another folder and returns the
    /// lines that it logs (`(LOG,…)`).
    ///
    /// # Errors
    /// As [`Self::end_points`].
    pub fn logged(
        &self,
        folder: &Path,
        subroutines: &Path,
        program: &str,
    ) -> Result<Vec<String>, String> {
        fs::create_dir_all(folder).map_err(|error| error.to_string())?;
        let ini = format!(
            "[EMC]\nVERSION = 1.1\n[RS274NGC]\nSUBROUTINE_PATH = {}\n[TRAJ]\nLINEAR_UNITS = mm\n",
            subroutines.display()
        );
        fs::write(folder.join("machine.ini"), ini).map_err(|error| error.to_string())?;
        let said = self.interpret(folder, &["-i", "machine.ini"], &Before::default(), program)?;
        let logged = said
            .lines()
            .filter_map(|line| line.split_once(" LOG(\"")?.1.strip_suffix("\")"));
        Ok(logged.map(str::to_owned).collect())
    }

    /// The canonical commands of a program.
    fn interpret(
        &self,
        folder: &Path,
        options: &[&str],
        before: &Before,
        program: &str,
    ) -> Result<String, String> {
        let write = |name: &str, text: &str| {
            fs::write(folder.join(name), text).map_err(|error| format!("{name}: {error}"))
        };
        fs::create_dir_all(folder).map_err(|error| error.to_string())?;
        write("program.ngc", program)?;
        write(
            "tool.tbl",
            &format!("T1 P1 Z{:+.6}\n", before.tool_length_mm / INCH_MM),
        )?;
        let mut parameters = String::new();
        for (first, point) in [
            (5161, before.reference_point_mm),
            (5181, before.second_reference_mm),
        ] {
            for (number, mm) in (first..).zip(point) {
                parameters.push_str(&format!("{number} {:.6}\n", mm / INCH_MM));
            }
        }
        write("parameters.var", &parameters)?;
        // Into a file: a program without an end prints without end.
        let text = |error: std::io::Error| error.to_string();
        let printed = folder.join("canon.txt");
        let out = fs::File::create(&printed).map_err(text)?;
        let complaints = folder.join("errors.txt");
        let err = fs::File::create(&complaints).map_err(text)?;
        let mut interpreter = Command::new(&self.start)
            .args(options)
            .args([
                "-g",
                "-v",
                "parameters.var",
                "-t",
                "tool.tbl",
                "program.ngc",
            ])
            .current_dir(folder)
            // Where it keeps its tool table while it runs.
            .env("HOME", folder)
            .stdin(Stdio::null())
            .stdout(out)
            .stderr(err)
            .spawn()
            .map_err(|error| format!("{}: {error}", self.start.display()))?;
        let begun = Instant::now();
        let status = loop {
            if let Some(status) = interpreter.try_wait().map_err(text)? {
                break status;
            }
            if begun.elapsed() > PATIENCE {
                interpreter.kill().map_err(text)?;
                interpreter.wait().map_err(text)?;
                fs::write(&printed, "").map_err(text)?;
                return Err(format!("it does not end within {} s", PATIENCE.as_secs()));
            }
            sleep(Duration::from_millis(2));
        };
        let read = |path| fs::read(path).map_err(text);
        let said = String::from_utf8_lossy(&read(&printed)?).into_owned();
        if status.success() {
            Ok(said)
        } else {
            let error = read(&complaints)?;
            Err(format!(
                "{}\n{said}",
                String::from_utf8_lossy(&error).trim()
            ))
        }
    }
}

/// What the canonical commands have set so far.
struct Canon {
    unit_mm: f64,
    plane: Plane,
    /// Offset of the work coordinates (G54 to G59.3), mm.
    work_mm: [f64; 3],
    /// Offset of G92 and G52, mm.
    local_mm: [f64; 3],
    tool_mm: [f64; 3],
    rotation_deg: f64,
    /// The N number of the block.
    block: Option<u32>,
    run: RefereeRun,
    ended: bool,
}

#[derive(Clone, Copy)]
enum Plane {
    Xy,
    Xz,
    Yz,
}

impl Canon {
    fn new() -> Self {
        Self {
            unit_mm: 1.0,
            plane: Plane::Xy,
            work_mm: [0.0; 3],
            local_mm: [0.0; 3],
            tool_mm: [0.0; 3],
            rotation_deg: 0.0,
            block: None,
            run: RefereeRun {
                moves: Vec::new(),
                origins_mm: Vec::new(),
                has_inches: false,
            },
            ended: false,
        }
    }

    /// One line, as `   18 N..... STRAIGHT_TRAVERSE(1.0000, 2.0000, 2.0000, 0.0000, …)`.
    fn line(&mut self, line: &str) -> Result<(), String> {
        let Some((head, rest)) = line.split_once('(') else {
            return Ok(());
        };
        let name = head.split_whitespace().last().unwrap_or_default();
        let mut number = head
            .split_whitespace()
            .filter_map(|word| word.strip_prefix('N'));
        self.block = number.next().and_then(|digits| digits.parse().ok());
        let arguments = rest.trim_end().trim_end_matches(')');
        let numbers: Vec<f64> = arguments
            .split([',', ' '])
            .filter_map(|word| word.trim().parse().ok())
            .collect();
        let triple = |from: usize| match numbers.get(from..from + 3) {
            Some(&[a, b, c]) => Ok([a, b, c]),
            _ => Err(format!("too few numbers: {line}")),
        };
        // What comes after the program's end only resets the interpreter.
        if self.ended {
            return Ok(());
        }
        match name {
            "USE_LENGTH_UNITS" => {
                self.unit_mm = match arguments {
                    "CANON_UNITS_MM" => 1.0,
                    "CANON_UNITS_INCHES" => {
                        self.run.has_inches = true;
                        INCH_MM
                    }
                    _ => return Err(format!("unknown unit: {line}")),
                }
            }
            "SELECT_PLANE" => {
                self.plane = match arguments {
                    "CANON_PLANE_XY" => Plane::Xy,
                    "CANON_PLANE_XZ" => Plane::Xz,
                    "CANON_PLANE_YZ" => Plane::Yz,
                    _ => return Err(format!("unknown plane: {line}")),
                }
            }
            "SET_G5X_OFFSET" => self.work_mm = self.mm(triple(1)?),
            "SET_G92_OFFSET" => self.local_mm = self.mm(triple(0)?),
            "USE_TOOL_LENGTH_OFFSET" => self.tool_mm = self.mm(triple(0)?),
            "SET_XY_ROTATION" => {
                self.rotation_deg = *numbers.first().ok_or_else(|| format!("no angle: {line}"))?;
            }
            "STRAIGHT_TRAVERSE" | "STRAIGHT_FEED" | "STRAIGHT_PROBE" => {
                let to_mm = self.machine(triple(0)?);
                self.moved(to_mm, name != "STRAIGHT_TRAVERSE", None);
            }
            "ARC_FEED" => {
                // End in the plane, centre in the plane, turns, end across the plane.
                let (Ok([first, second, center_first]), Ok([center_second, turns, across])) =
                    (triple(0), triple(3))
                else {
                    return Err(format!("too few numbers: {line}"));
                };
                let in_space = |first: f64, second: f64, across: f64| match self.plane {
                    Plane::Xy => [first, second, across],
                    Plane::Xz => [second, across, first],
                    Plane::Yz => [across, first, second],
                };
                let to_mm = self.machine(in_space(first, second, across));
                let center_mm = self.machine(in_space(center_first, center_second, across));
                let axis = in_space(0.0, 0.0, 1.0);
                let arc = self.arc(to_mm, center_mm, axis, turns);
                self.moved(to_mm, true, Some(arc));
            }
            "PROGRAM_END" => self.ended = true,
            _ => {}
        }
        Ok(())
    }

    fn mm(&self, values: [f64; 3]) -> [f64; 3] {
        values.map(|value| value * self.unit_mm)
    }

    /// Work coordinates to machine coordinates, in LinuxCNC's order: G92, the rotation,
    /// the work offset, the tool.
    fn machine(&self, to: [f64; 3]) -> [f64; 3] {
        let [x, y, z] = self.mm(to);
        let [x, y, z] = [
            x + self.local_mm[0],
            y + self.local_mm[1],
            z + self.local_mm[2],
        ];
        let (sin, cos) = self.rotation_deg.to_radians().sin_cos();
        let turned = [x * cos - y * sin, x * sin + y * cos, z];
        core::array::from_fn(|axis| turned[axis] + self.work_mm[axis] + self.tool_mm[axis])
    }

    /// An arc from where the tool is: the first of its turns ends at `to_mm`, further ones are
    /// whole.
    fn arc(
        &self,
        to_mm: [f64; 3],
        center_mm: [f64; 3],
        axis: [f64; 3],
        turns: f64,
    ) -> ([f64; 3], [f64; 3], f64) {
        let from_mm = self.run.moves.last().map_or([0.0; 3], |last| last.to_mm);
        let axis_of = Vector3::from(axis);
        let arm = |place: [f64; 3]| {
            let arm = Vector3::from(place) - Vector3::from(center_mm);
            arm - axis_of * axis_of.dot(&arm)
        };
        let (start, end) = (arm(from_mm), arm(to_mm));
        let angle = axis_of.dot(&start.cross(&end)).atan2(start.dot(&end));
        // What is printed of a whole circle is a little off.
        let closes = angle.abs() * start.norm() < 0.005;
        let angle = match (turns > 0.0, angle > 0.0) {
            _ if closes => 2.0 * PI * turns.signum(),
            (true, false) => angle + 2.0 * PI,
            (false, true) => angle - 2.0 * PI,
            _ => angle,
        };
        let sweep = angle + 2.0 * PI * (turns.abs() - 1.0) * turns.signum();
        (center_mm, axis, sweep)
    }

    fn moved(&mut self, to_mm: [f64; 3], is_feed: bool, arc: Option<([f64; 3], [f64; 3], f64)>) {
        self.run.origins_mm.push(self.work_mm);
        self.run.moves.push(RefereeMove {
            to_mm,
            block: self.block,
            is_feed,
            arc,
        });
    }
}
