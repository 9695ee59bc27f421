//! A path as a program for a control.
//!
//! Two ways of saying it: `rotary` has the machine's axis values, a block for each row, so that any control drives it;
//! `rtcp` has the middle ray's point on the part and leaves the linear axes to the control. Feeds are the inverse of a
//! block's time (G93) where the control knows that, since a feed in mm/min means something else on every control as soon
//! as rotary axes move. An `rtcp` program has more rows than the plan, so that it drives what was proved.
//!
//! A program comes from the top of the machine's Z and goes back there, straight up: this way is
//! proved, whatever the machine's zero and its reference point are.
//!
//! No language has a word for the laser: comments tell it. It begins dark; `LASER ON` stands behind the block that goes to a pass's first
//! pose, `LASER OFF` behind the block that goes to its last one. Where a sensor is switched by the program, its user puts
//! the machine's M function in these places.

mod between;
mod carried;
mod words;

use std::fmt::Write as _;

use nalgebra::Vector3;

use super::drive::links::clear_above;
use super::drive::price::{RAPID_MM_PER_S, seconds};
use super::drive::touch::Scenery;
use super::proof::row::PathRow;
use super::spec::ScanSpec;
use crate::ScanError;
use crate::surface::Mesh;

pub use between::APART_MM;
pub use carried::off_the_spindle;

/// Whose language it is in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PathDialect {
    /// Fanuc, and who reads its blocks.
    Fanuc,
    /// Sinumerik.
    Siemens,
    /// TNC, plain language.
    Heidenhain,
    /// RS274NGC.
    LinuxCnc,
}

/// What the words mean.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ProgramMode {
    /// Every word is an axis value.
    Rotary,
    /// X Y Z are the middle ray's point on the part; the control carries them through its rotary axes.
    Rtcp,
}

/// How a program is written.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ProgramStyle {
    /// Whose language.
    pub dialect: PathDialect,
    /// What X Y Z mean.
    pub mode: ProgramMode,
    /// With the laser on, mm/min on the part.
    pub feed_mm_per_min: f64,
    /// The program's number: `O` of a Fanuc, a part of the name in plain language.
    pub number: u16,
}

/// A program and what its rounding does.
#[derive(Debug, Clone, PartialEq)]
pub struct PathProgram {
    /// All blocks.
    pub text: String,
    /// By how much words of three decimals move the middle ray's point on the part, at most.
    pub rounding_mm: f64,
    /// What its user must know and set up.
    pub warnings: Vec<String>,
}

/// Decimals of every axis word.
const DECIMALS: usize = 3;

fn word(value: f64) -> f64 {
    // Adding zero takes the sign from a rounded zero.
    (value * 1000.0).round() / 1000.0 + 0.0
}

/// The first row is come down to from this far above, by feed.
const DESCENT_MM: f64 = 5.0;

/// The pass of the place over the first row, which is no row of the path.
const ABOVE: i32 = -2;

/// What a user must set up for such a program; whether there can be one at all is known before a path is.
///
/// # Errors
/// `machine_spec` where the language has no word for a rotary axis, `nc_mode` where the control has no `rtcp` that this
/// could be said in, or no rotary axis for it.
pub fn ready(
    spec: &ScanSpec,
    dialect: PathDialect,
    mode: ProgramMode,
) -> Result<Vec<String>, ScanError> {
    words::check(&spec.machine, dialect)?;
    match (mode, dialect) {
        (ProgramMode::Rotary, PathDialect::LinuxCnc) => {
            Ok(words::linear(&spec.machine).into_iter().collect())
        }
        (ProgramMode::Rotary, _) => Ok(Vec::new()),
        (ProgramMode::Rtcp, PathDialect::LinuxCnc) => Err(ScanError::refused(
            "nc_mode",
            "LinuxCNC has no word that switches to the tool's point for every machine: take --nc-mode rotary.",
        )),
        (ProgramMode::Rtcp, _) if spec.machine.limits().len() == 3 => Err(ScanError::refused(
            "nc_mode",
            "The machine has no rotary axis, and a control without one does not know the word for rtcp: take --nc-mode rotary.",
        )),
        (ProgramMode::Rtcp, _) => carried::carried(spec, dialect),
    }
}

/// Writes a program.
///
/// # Errors
/// Those of [`ready`], and `nc_approach` where the straight way down from
/// the top of Z to the first row, or up from the last, touches something.
pub fn program(
    spec: &ScanSpec,
    meshes: Vec<&Mesh>,
    rows: &[PathRow],
    style: ProgramStyle,
) -> Result<PathProgram, ScanError> {
    let mut warnings = ready(spec, style.dialect, style.mode)?;
    let (Some(first), Some(last)) = (rows.first(), rows.last()) else {
        return Err(ScanError::refused("nc_approach", "The path has no row."));
    };
    let scenery = Scenery::new(spec, meshes);
    for end in [first, last] {
        if !clear_above(&spec.machine, &scenery, &end.axes) {
            return Err(ScanError::refused(
                "nc_approach",
                "The way straight up from the path's end touches something, so the program could not come from safety: stand the part otherwise.",
            ));
        }
    }
    let above = above(spec, first);
    let turned = match (style.dialect, style.mode) {
        (PathDialect::Fanuc, ProgramMode::Rtcp) if !spec.machine.table.is_empty() => {
            turned_from_zero(spec, &scenery, &above, &mut warnings)?
        }
        _ => Vec::new(),
    };
    let between = match style.mode {
        ProgramMode::Rotary => Vec::new(),
        ProgramMode::Rtcp => between::with_rows_between(spec, rows),
    };
    let rows = if between.is_empty() { rows } else { &between };
    let mut rounding_mm: f64 = 0.0;
    for row in rows {
        let axes: Vec<f64> = row.axes.iter().map(|v| word(*v)).collect();
        let pose = spec.machine.forward(&axes);
        let moved = pose.origin_mm + pose.beam * spec.sensor.reference_mm - tip(spec, row);
        rounding_mm = rounding_mm.max(moved.norm());
    }
    let mut writer = Writer {
        spec,
        style,
        text: String::new(),
    };
    writer.head(rows, rounding_mm);
    for warning in &warnings {
        writer.comment(&warning.to_ascii_uppercase());
    }
    writer.comment("START: LASER OFF");
    writer.approach(&above, &turned);
    let mut before = Some(&above);
    for row in rows {
        writer.row(before, row);
        before = Some(row);
    }
    if last.laser {
        writer.comment("END: LASER OFF");
    }
    writer.leave();
    Ok(PathProgram {
        text: writer.text,
        rounding_mm,
        warnings,
    })
}

/// Over a row, in the machine's Z: no block of a program is without a way, which `G93` would be at odds with.
fn above(spec: &ScanSpec, row: &PathRow) -> PathRow {
    let mut axes = row.axes.clone();
    axes[2] = (axes[2] + DESCENT_MM)
        .min(spec.machine.travel_mm[2][1])
        .max(axes[2]);
    PathRow {
        pass: ABOVE,
        laser: false,
        pose: spec.machine.forward(&axes),
        axes,
    }
}

/// The way from the table's zero to the angles of the first row, at the top of Z over it.
///
/// A control glues the frame of X Y Z to the table as it stands at `G43.4`, or as it stands at zero (Fanuc 15i,
/// B-63783EN-1 p. 1116; 30i, A-79348E p. 19; Mitsubishi M700 p. 477, WKP). With the table at zero then, both are one; it is
/// turned behind. Empty where its limits leave zero out: that is a warning.
fn turned_from_zero(
    spec: &ScanSpec,
    scenery: &Scenery<'_>,
    above: &PathRow,
    warnings: &mut Vec<String>,
) -> Result<Vec<PathRow>, ScanError> {
    let table = &spec.machine.table;
    if let Some(axis) = table
        .iter()
        .find(|a| !(a.limits_deg[0] <= 0.0 && a.limits_deg[1] >= 0.0))
    {
        warnings.push(format!(
            "X Y Z are those of the table at zero, where {} cannot stand: the control must take them so whatever the table's angles at G43.4 are.",
            axis.name
        ));
        return Ok(Vec::new());
    }
    let top = spec.machine.travel_mm[2][1].max(above.axes[2]);
    let row = |z: f64, turned: bool| {
        let mut axes = above.axes.clone();
        axes[2] = z;
        if !turned {
            axes[3..3 + table.len()].fill(0.0);
        }
        PathRow {
            pass: -1,
            laser: false,
            pose: spec.machine.forward(&axes),
            axes,
        }
    };
    // A little below the top: at the very end of its travel hardly anything may be carried.
    let under = (top - DESCENT_MM).max(above.axes[2]);
    let mut way = vec![row(top, false), row(under, false), row(under, true)];
    way.dedup_by(|a, b| a.axes == b.axes);
    if way
        .windows(2)
        .any(|w| scenery.touches_between(&spec.machine, &w[0].axes, &w[1].axes))
    {
        return Err(ScanError::refused(
            "nc_approach",
            "The table's way from zero to the first row's angles touches the sensor at the top of Z: stand the part lower, or take --nc-mode rotary.",
        ));
    }
    Ok(between::with_rows_between(spec, &way))
}

fn tip(spec: &ScanSpec, row: &PathRow) -> Vector3<f64> {
    row.pose.origin_mm + row.pose.beam * spec.sensor.reference_mm
}

struct Writer<'a> {
    spec: &'a ScanSpec,
    style: ProgramStyle,
    text: String,
}

impl Writer<'_> {
    fn line(&mut self, line: &str) {
        self.text.push_str(line);
        self.text.push('\n');
    }

    fn comment(&mut self, words: &str) {
        let line = match self.style.dialect {
            PathDialect::Siemens | PathDialect::Heidenhain => format!("; {words}"),
            // Brackets inside a bracketed comment end it.
            _ => format!("({})", words.replace(['(', ')'], " ")),
        };
        self.line(&line);
    }

    fn heidenhain(&self) -> bool {
        self.style.dialect == PathDialect::Heidenhain
    }

    fn head(&mut self, rows: &[PathRow], rounding_mm: f64) {
        match self.style.dialect {
            PathDialect::Fanuc => self.line(&format!("%\nO{:04}", self.style.number)),
            PathDialect::LinuxCnc => self.line("%"),
            PathDialect::Heidenhain => {
                self.line(&format!("BEGIN PGM SCAN{} MM", self.style.number))
            }
            PathDialect::Siemens => {}
        }
        let scanning = rows.iter().filter(|r| r.laser).count();
        self.comment(&format!(
            "SCAN PATH: {} ROWS, {scanning} OF THEM SCANNING",
            rows.len()
        ));
        match self.style.mode {
            ProgramMode::Rotary => {
                self.comment("AXIS VALUES OF THE MACHINE: THE WORK OFFSET MUST BE ZERO IN EVERY AXIS, NO TOOL LENGTH");
            }
            ProgramMode::Rtcp => {
                self.comment("X Y Z ARE THE POINT OF THE MIDDLE RAY IN THE PART FRAME: SET THE OFFSET AND THE TOOL TO SENSOR AND PART");
                if self.style.dialect == PathDialect::Fanuc {
                    self.comment("G43.4 STANDS WHERE THE TABLE IS AT ZERO: ITS FRAME IS THE SAME ON EVERY CONTROL");
                }
                self.comment(&format!(
                    "ROWS BETWEEN THOSE OF THE PLAN KEEP THE WAY WITHIN {APART_MM} MM OF THE PROVED ONE"
                ));
            }
        }
        let mut names = self.words_of_axes();
        if self.spec.machine.orient_deg.is_some() {
            let word = &self.spec.machine.orient_word;
            names.push(format!("{word} TURNS THE SPINDLE"));
        }
        let names = if names.is_empty() {
            "NONE".to_owned()
        } else {
            names.join(", ")
        };
        self.comment(&format!("ROTARY WORDS: {names}"));
        self.comment(&format!(
            "SAFETY IS Z{} OF THE MACHINE, THE TOP OF ITS TRAVEL",
            word(self.top_mm())
        ));
        self.comment(&format!(
            "WORDS ARE ROUNDED TO 0.001: THE POINT ON THE PART MOVES BY {rounding_mm:.4} MM AT MOST"
        ));
    }

    /// Where nothing is in the way: from there [`program`] has proved the way to the first row and
    /// from the last.
    fn top_mm(&self) -> f64 {
        self.spec.machine.travel_mm[2][1]
    }

    /// The way to safety, along Z alone and in the machine's coordinates: offsets and a reference
    /// point that stands elsewhere play no part.
    fn go_to_safety(&mut self) {
        let z = self.words(&[("Z".to_owned(), self.top_mm())]);
        let line = match self.style.dialect {
            PathDialect::Fanuc | PathDialect::LinuxCnc => format!("G90 G53 G0{z}"),
            PathDialect::Siemens => format!("SUPA G0{z} D0"),
            PathDialect::Heidenhain => format!("L{z} R0 FMAX M91"),
        };
        self.line(&line);
    }

    /// The words of table and head, as the program writes them.
    fn words_of_axes(&self) -> Vec<String> {
        let machine = &self.spec.machine;
        machine
            .table
            .iter()
            .chain(&machine.head)
            .map(|a| a.name.clone())
            .collect()
    }

    fn rotary_words(&self, row: &PathRow) -> Vec<(String, f64)> {
        let mut names = self.words_of_axes();
        if self.spec.machine.orient_deg.is_some() {
            names.push(self.spec.machine.orient_word.clone());
        }
        names
            .into_iter()
            .zip(row.axes[3..].iter().copied())
            .collect()
    }

    fn linear_words(&self, row: &PathRow) -> Vec<(String, f64)> {
        let place = match self.style.mode {
            ProgramMode::Rotary => [row.axes[0], row.axes[1], row.axes[2]],
            ProgramMode::Rtcp => tip(self.spec, row).into(),
        };
        ["X", "Y", "Z"]
            .iter()
            .map(|n| (*n).to_string())
            .zip(place)
            .collect()
    }

    fn words(&self, words: &[(String, f64)]) -> String {
        let mut text = String::new();
        for (name, value) in words {
            let value = word(*value);
            let _ = match self.style.dialect {
                // A sign always stands in plain language.
                PathDialect::Heidenhain => write!(text, " {name}{value:+.DECIMALS$}"),
                // A name of several letters takes an equals sign.
                PathDialect::Siemens if name.len() > 1 => {
                    write!(text, " {name}={value:.DECIMALS$}")
                }
                _ => write!(text, " {name}{value:.DECIMALS$}"),
            };
        }
        text
    }

    fn approach(&mut self, first: &PathRow, turned: &[PathRow]) {
        let turns = self.words(&self.rotary_words(turned.first().unwrap_or(first)));
        let linear = self.linear_words(first);
        let over = [("X", first.axes[0]), ("Y", first.axes[1])];
        let over = self.words(&over.map(|(name, value)| (name.to_owned(), value)));
        let (xy, z) = (self.words(&linear[..2]), self.words(&linear[2..]));
        match self.style.dialect {
            PathDialect::Fanuc => {
                self.line("G21 G17 G40 G49 G80 G94");
                self.go_to_safety();
                self.line("G54");
                if !turns.is_empty() {
                    self.line(&format!("G0{turns}"));
                }
                if self.style.mode == ProgramMode::Rtcp {
                    // Over the first row by its axes, then straight down: on a turned table a way
                    // along X and Y of the part would not stay at the top.
                    self.line(&format!("G53 G0{over}"));
                    self.line("G43.4 H1");
                    if !turned.is_empty() {
                        self.line("G93");
                    }
                    for pair in turned.windows(2) {
                        self.row(Some(&pair[0]), &pair[1]);
                    }
                    self.line(&format!("G0{xy}{z}"));
                } else {
                    self.line(&format!("G0{xy}\nG0{z}"));
                }
                if turned.is_empty() {
                    self.line("G93");
                }
            }
            PathDialect::LinuxCnc => {
                self.line("G21 G17 G40 G49 G80 G94 G64 P0.001");
                self.go_to_safety();
                self.line("G54");
                if !turns.is_empty() {
                    self.line(&format!("G0{turns}"));
                }
                self.line(&format!("G0{xy}\nG0{z}"));
                self.line("G93");
            }
            PathDialect::Siemens => {
                self.line("G71 G17 G40 G90 G94");
                self.go_to_safety();
                self.line("G54");
                if !turns.is_empty() {
                    self.line(&format!("G0{turns}"));
                }
                if self.style.mode == ProgramMode::Rtcp {
                    self.line(&format!("SUPA G0{over} D0"));
                    // D0 holds on: the control would carry the spindle's nose.
                    self.line("D1\nTRAORI");
                    self.line(&format!("G0{xy}{z}"));
                } else {
                    self.line(&format!("G0{xy}\nG0{z}"));
                }
                self.line("G93");
            }
            PathDialect::Heidenhain => {
                self.go_to_safety();
                if !turns.is_empty() {
                    self.line(&format!("L{turns} R0 FMAX"));
                }
                if self.style.mode == ProgramMode::Rtcp {
                    self.line(&format!("L{over} R0 FMAX M91"));
                    self.line("M128");
                    self.line(&format!("L{xy}{z} R0 FMAX"));
                } else {
                    self.line(&format!("L{xy} R0 FMAX\nL{z} R0 FMAX"));
                }
            }
        }
    }

    fn row(&mut self, before: Option<&PathRow>, row: &PathRow) {
        let scanning = before.is_some_and(|b| b.laser && row.laser && b.pass == row.pass);
        if before.is_some_and(|b| b.laser) && !scanning {
            self.comment("LINK: LASER OFF");
        }
        // A pass and the way down to the path's beginning are by feed; links are not.
        let by_feed = scanning || before.is_some_and(|b| b.pass == ABOVE);
        let time = before.map_or(1.0, |b| {
            let at_rapid = seconds(&b.axes, &row.axes, RAPID_MM_PER_S);
            if by_feed {
                let way = (tip(self.spec, row) - tip(self.spec, b)).norm();
                at_rapid.max(way / (self.style.feed_mm_per_min / 60.0))
            } else {
                at_rapid
            }
        });
        let mut words = self.linear_words(row);
        words.extend(self.rotary_words(row));
        let words = self.words(&words);
        let line = if self.heidenhain() {
            // Its feed is along X Y Z, or in degrees a minute where these stand still.
            let way = before.map_or(0.0, |b| {
                let linear = match self.style.mode {
                    // The control holds the feed at the point that it carries.
                    ProgramMode::Rtcp => (tip(self.spec, row) - tip(self.spec, b)).norm(),
                    ProgramMode::Rotary => (0..3)
                        .map(|k| (row.axes[k] - b.axes[k]).powi(2))
                        .sum::<f64>()
                        .sqrt(),
                };
                let turn = row.axes[3..]
                    .iter()
                    .zip(&b.axes[3..])
                    .map(|(x, y)| (x - y).abs())
                    .fold(0.0, f64::max);
                if linear > 1e-3 { linear } else { turn }
            });
            let feed = (way / time.max(1e-3) * 60.0).clamp(1.0, 99_999.0);
            format!("L{words} R0 F{feed:.0}")
        } else {
            format!("G1{words} F{:.3}", 60.0 / time.clamp(1e-3, 6e4))
        };
        self.line(&line);
        // Not before the sensor stands at the pass's first pose.
        if row.laser && !scanning {
            self.comment(&format!("PASS {}: LASER ON", row.pass));
        }
    }

    fn leave(&mut self) {
        match self.style.dialect {
            PathDialect::Fanuc => {
                self.line("G94");
                if self.style.mode == ProgramMode::Rtcp {
                    self.line("G49");
                }
                self.go_to_safety();
                self.line("M30\n%");
            }
            PathDialect::LinuxCnc => {
                self.line("G94");
                self.go_to_safety();
                self.line("M2\n%");
            }
            PathDialect::Siemens => {
                self.line("G94");
                if self.style.mode == ProgramMode::Rtcp {
                    self.line("TRAFOOF");
                }
                self.go_to_safety();
                self.line("M30");
            }
            PathDialect::Heidenhain => {
                if self.style.mode == ProgramMode::Rtcp {
                    self.line("M129");
                }
                self.go_to_safety();
                self.line("M30");
                self.line(&format!("END PGM SCAN{} MM", self.style.number));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::proof::row::PathRow;
    use super::super::tests::spec;
    use super::between::tests::TABLES;
    use super::{PathDialect, ProgramMode, ProgramStyle, program, ready};
    use nalgebra::Vector3;

    /// Whether a control glues the frame to the table as it stands at `G43.4` or at zero, the program goes the same way: from
    /// the table's zero to the first row's angles with X and Y over it.
    #[test]
    fn a_fanuc_carries_the_point_from_the_tables_zero_on() {
        let with = |from: &str, to: &str| spec(&TABLES.replace(from, to)).unwrap();
        let plain = with("", "");
        let row = |axes: [f64; 5]| PathRow {
            pass: 0,
            laser: true,
            pose: plain.machine.forward(&axes),
            axes: axes.to_vec(),
        };
        let rows = [
            row([40.0, 10.0, 80.0, 30.0, 200.0]),
            row([41.0, 10.0, 80.0, 30.0, 200.0]),
        ];
        let style = ProgramStyle {
            dialect: PathDialect::Fanuc,
            mode: ProgramMode::Rtcp,
            feed_mm_per_min: 600.0,
            number: 1,
        };
        let written = program(&plain, Vec::new(), &rows, style).unwrap();
        let (before, after) = written.text.split_once("G43.4 H1\n").unwrap();
        assert!(before.contains("\nG0 A0.000 C0.000\n"), "{before}");
        assert_eq!(written.warnings, [""; 0]);
        let value = |line: &str, word: char| -> f64 {
            let mut words = line.split(' ').filter_map(|w| w.strip_prefix(word));
            words.next().unwrap().parse().unwrap()
        };
        let (mut blocks, mut turned) = (0, [0.0; 2]);
        for line in after.lines().filter(|l| l.starts_with("G1")) {
            let here = ['A', 'C'].map(|word| value(line, word));
            let tip = Vector3::from(['X', 'Y', 'Z'].map(|word| value(line, word)));
            let origin = tip - plain.machine.pointing(&here).0 * 60.0;
            let at = plain.machine.carriage(&origin, &here);
            assert!(
                (at.x - 40.0).abs() < 0.03 && (at.y - 10.0).abs() < 0.03,
                "{line}: {at}"
            );
            (blocks, turned) = (blocks + 1, here);
            if at.z < 100.0 {
                break;
            }
        }
        assert_eq!(turned, [30.0, 200.0]);
        assert!((20..400).contains(&blocks), "{blocks}");
        // A table that cannot stand at zero: the program says what it asks of the control.
        let beyond = with("limits_deg = [-95, 95]", "limits_deg = [10, 95]");
        let written = program(&beyond, Vec::new(), &rows, style).unwrap();
        assert!(
            written.warnings[0].contains("table at zero"),
            "{:?}",
            written.warnings
        );
        assert!(written.text.contains("TABLE AT ZERO"));
    }

    #[test]
    fn a_word_that_linuxcnc_reads_as_a_length_is_a_warning() {
        let with = |to: &str| spec(&TABLES.replace("name = \"C\"", to)).unwrap();
        let told = |to: &str, dialect| ready(&with(to), dialect, ProgramMode::Rotary).unwrap();
        let said = told("name = \"W\"", PathDialect::LinuxCnc);
        assert!(
            said[0].contains("W as a linear axis") && said[0].contains("B is free"),
            "{said:?}"
        );
        assert_eq!(told("name = \"C\"", PathDialect::LinuxCnc), [""; 0]);
        assert_eq!(told("name = \"W\"", PathDialect::Fanuc), [""; 0]);
    }
}
