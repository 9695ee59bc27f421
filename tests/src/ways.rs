//! Ways to a wrong correction, each as it happens on a machine: the probing program and macros
//! that ship, on the virtual machine, through a board, and what the control then has.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::{fs, io};

use umi_core::dprnt::checked::CheckedLine;
use umi_core::units::Micros;
use umi_protocol::job::{Approach, Job, Teach};
use umi_protocol::message::TeachWhat;
use umi_virtual::machine::{VirtualMachine, Wires};
use umi_virtual::nc::{Alarm, Control, ControlFamily, ControlSettings};
use umi_virtual::scene::Scene;

use crate::cases::{DC1, clamping, connect, job, receive, receive_program, until};
use crate::rig::Rig;

/// What happens, one after the other.
#[derive(Clone, Debug)]
enum Step {
    /// Another job, with an empty reference.
    Sets(Box<Job>),
    /// The control prints this.
    Prints(String),
    /// The control prints this, and the macro ends in this alarm.
    Stops(String, String),
    /// The probe touches, and nothing of it comes.
    Touches,
    /// The control reads in this run, and carries out what it gets.
    Reads(u32),
    /// A host asks to teach again.
    Asks,
    /// The board's power goes and comes.
    PowerGoes,
    /// The power goes when the control has read so many characters.
    PowerGoesWhileSending(usize),
}

/// One run of the probing program.
#[derive(Clone, Debug, Default)]
struct Probing {
    run: u32,
    /// Where the plate stands: mm in X and Y, degrees.
    stands: [f64; 3],
    /// By what it is turned about ball 1 besides, degrees.
    turn_deg: [f64; 3],
    /// Words behind `G65 P8811 W54.`
    words: &'static str,
    /// Blocks before it.
    before: &'static str,
    /// Blocks behind it.
    behind: &'static str,
    /// In place of the call of O8822.
    probes: Option<String>,
    /// Blocks between O8822 and the ball on the table.
    between: &'static str,
    /// What the scene has besides: a chip on a ball.
    body: &'static str,
    /// What the whole machine is off by, as seen through a bent stylus.
    bent_mm: f64,
}

struct Serial(Vec<u8>);

impl Wires for Serial {
    fn serial(&mut self, _: Micros, bytes: &[u8]) {
        self.0.extend_from_slice(bytes);
    }
    fn skip(&mut self, _: Micros, _: [i64; 3]) {}
    fn time(&mut self, _: Micros) {}
}

fn project(file: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(file)
}

fn read(file: &str) -> String {
    fs::read_to_string(project(file)).expect("a text of this project")
}

/// A control with the shipped macros.
fn control() -> io::Result<Control> {
    let mut control = Control::new(ControlSettings::of(ControlFamily::Fanuc));
    for entry in fs::read_dir(project("hw/control/fanuc"))? {
        let path = entry?.path();
        if path.extension().is_some_and(|end| end == "nc") {
            control
                .load(&fs::read_to_string(path)?)
                .expect("a shipped macro");
        }
    }
    Ok(control)
}

impl Probing {
    /// What the control prints, and the alarm that ends it.
    fn prints(&self) -> (String, Option<Alarm>) {
        let program = read("examples/probe-four-spheres.nc");
        let start = format!(
            "#531={}\n{}\nG65 P8811 W54. {}\n{}",
            self.run - 1,
            self.before,
            self.words,
            self.behind
        );
        let mut program = program.replace("G65 P8811 W54.", &start);
        if let Some(probes) = &self.probes {
            let call = program.lines().find(|line| line.starts_with("G65 P8822"));
            let call = call.expect("the program probes").to_owned();
            program = program.replace(&call, probes);
        }
        let table = "G0 X0 Y230.\nG0 Z110.\nG65 P8820 D25.4 B8. Q40. H2.\nG53 G0 Z300.\nM30";
        program = program.replace("M30", &format!("{}\n{table}", self.between));
        let [x, y, turn] = self.stands;
        let turns_deg = match self.turn_deg {
            [0.0, 0.0, 0.0] => format!("rotation_deg = [0.0, 0.0, {turn:?}]"),
            turns => format!("rotation_deg = {turns:?}\npivot_mm = [-135.0, -136.6, 135.9]"),
        };
        let scene = read("examples/scenes/four-spheres.toml")
            .replacen(
                "translation_mm = [0.0, 0.0, 0.0]",
                &format!("translation_mm = [{x:?}, {y:?}, 0.0]"),
                1,
            )
            .replacen("rotation_deg = [0.0, 0.0, 0.0]", &turns_deg, 1)
            // On no grid, as on no machine.
            .replace("[-136.7, 136.4, 136.1]", "[-136.692, 136.437, 136.074]")
            .replace("[137.2, 138.1, 121.0]", "[137.213, 138.127, 121.041]")
            .replacen(
                "[machine]\n",
                &format!(
                    "[machine]\nhoming_error_mm = [{:?}, 0.0, 0.0]\n",
                    self.bent_mm
                ),
                1,
            )
            + self.body;
        let scene = Scene::parse(&scene).expect("a scene");
        let mut machine = VirtualMachine::new(scene, 1, Serial(Vec::new()));
        let mut control = control().expect("macros");
        let main = control.load(&program).expect("the shipped program");
        control.select(main[0]).expect("it is there");
        let alarm = control.run(&mut machine).err();
        let text = String::from_utf8_lossy(&machine.wires().0).into_owned();
        (text, alarm)
    }

    fn step(&self) -> Step {
        match self.prints() {
            (text, None) => Step::Prints(text),
            (text, Some(alarm)) => Step::Stops(text, alarm.message),
        }
    }
}

/// The job to begin with, and a ball that stays on the table.
fn guarded() -> Job {
    let mut job: Job = toml::from_str(&read("examples/four-spheres.toml")).expect("a job");
    let mut table = job.features[0].clone();
    (table.name, table.id) = ("TABLE".try_into().expect("a name"), Some(8));
    job.guards.fixed.push(table.name.clone()).expect("room");
    job.guards.fixed_mm = Some(0.007);
    job.features.push(table).expect("room");
    assert_eq!(job.teach, Teach::Asked);
    job
}

/// The lines of a ball whose first touch of the top came early: all but the last, higher.
fn early_once(step: Step, ball: u16, mm: f64) -> Step {
    let Step::Prints(text) = step else {
        return step;
    };
    let ended = text.split(['\r', '\n']).filter(|line| !line.is_empty());
    let mut lines: Vec<String> = ended.map(str::to_owned).collect();
    let mut of_ball: Vec<(usize, CheckedLine)> = (0..)
        .zip(&lines)
        .filter_map(|(at, line)| Some((at, hit_line(line)?)))
        .filter(|(_, line)| line.feature == ball)
        .collect();
    assert_eq!(of_ball.len(), 6, "the top is touched twice");
    of_ball.pop();
    for (at, mut line) in of_ball {
        #[allow(clippy::cast_possible_truncation, reason = "a machine is small")]
        let um = (mm * 1000.0).round() as i32;
        line.point_um[2] += um;
        // Behind the character that switches a punch on.
        let (before, _) = lines[at].split_once("UMI1").expect("it was read");
        lines[at] = format!("{before}{line}");
    }
    Step::Prints(lines.join("\r\n") + "\r\n")
}

/// The part turns about ball 1, by degrees about the axes, when balls 1 to 4 have been probed.
fn turned_about_first(run: u32, turn_deg: [f64; 3]) -> Step {
    let probes = |turn_deg| {
        Probing {
            turn_deg,
            ..Probing {
                run,
                ..Probing::default()
            }
        }
        .prints()
    };
    let ((before, alarm), (after, _)) = (probes([0.0; 3]), probes(turn_deg));
    assert_eq!(alarm, None);
    let lines = before.lines().zip(after.lines()).map(|(before, after)| {
        let of = hit_line(before).map_or(0, |line| line.feature);
        // The one on the table stays where it is.
        if (5..8).contains(&of) { after } else { before }
    });
    Step::Prints(lines.collect::<Vec<_>>().join("\r\n") + "\r\n")
}

/// A hit's checked line from its text.
fn hit_line(text: &str) -> Option<CheckedLine> {
    let value = |letter: char| -> Option<f64> {
        let (_, rest) = text.split_once("UMI1")?.1.split_once(letter)?;
        let end = rest
            .find(|c: char| c.is_ascii_uppercase())
            .unwrap_or(rest.len());
        rest[..end].replace(' ', "").parse().ok()
    };
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "small numbers"
    )]
    let (whole, um) = (|v: f64| v as u32, |v: f64| (v * 1000.0).round() as i32);
    let approach = *[
        Approach::PlusX,
        Approach::MinusX,
        Approach::PlusY,
        Approach::MinusY,
        Approach::PlusZ,
        Approach::MinusZ,
    ]
    .get((whole(value('A')?) as usize).checked_sub(1)?)?;
    Some(CheckedLine {
        run: whole(value('R')?),
        sequence: whole(value('S')?),
        feature: u16::try_from(whole(value('B')?)).ok()?,
        approach: Some(approach),
        touched: value('T')? == 1.0,
        feed_um_per_min: whole(value('F')? * 1000.0),
        point_um: [um(value('X')?), um(value('Y')?), um(value('Z')?)],
    })
}

/// What O8811 prints alone, before a program of another kind prints its blocks.
fn announced(run: u32, words: &str, before: &str) -> String {
    let scene = Scene::parse(&read("examples/scenes/four-spheres.toml")).expect("a scene");
    let mut machine = VirtualMachine::new(scene, 1, Serial(Vec::new()));
    let mut control = control().expect("macros");
    let start = run - 1;
    let program =
        format!("%\nO0001\nG54\n#531={start}\n{before}\nG65 P8811 W54. {words}\nM30\n%\n");
    let main = control.load(&program).expect("a program");
    control.select(main[0]).expect("it is there");
    control.run(&mut machine).expect("no alarm");
    String::from_utf8_lossy(&machine.wires().0).into_owned()
}

/// The session: what is done, and the steps. Runs count on with another job, as a control does.
fn ways() -> Vec<(&'static str, Vec<Step>)> {
    const HERE: [f64; 3] = [4.0, -3.0, 0.5];
    const THERE: [f64; 3] = [-3.0, 2.0, -0.7];
    let clean = |run: u32, stands: [f64; 3]| Probing {
        run,
        stands,
        ..Probing::default()
    };
    let words = |run: u32, stands: [f64; 3], words: &'static str| Probing {
        words,
        ..clean(run, stands)
    };
    // Each clamping is another one: what is printed twice to the last digit is refused for that.
    let before = |run: u32, before: &'static str| Probing {
        before,
        ..clean(run, [f64::from(run), 1.0, 0.2])
    };
    let (first, closing) = ((1, -135.0, -136.6), (5, -135.0, -136.6));
    let (closing4, closing2) = ((6, 137.2, 138.1), (7, 138.0, -134.7));
    let (second, third, fourth) = ((2, 138.0, -134.7), (3, -136.7, 136.4), (4, 137.2, 138.1));
    let between = [first, third, fourth, second, closing, closing4, closing2];
    let outside = [third, first, fourth, closing, second, closing4, closing2];
    let in_turn = |(number, x, y): (u32, f64, f64)| {
        format!("G0 X{x:?} Y{y:?}\nG0 Z165.\nG65 P8820 D25.4 B{number}. Q50. H2.\nG0 Z171.\n")
    };
    let without_third = |text: String| -> String {
        let lines = text.split_inclusive('\n');
        lines
            .filter(|line| !line.replace(' ', "").contains("B3A"))
            .collect()
    };
    let lost = match clean(7, HERE).step() {
        Step::Prints(text) => Step::Prints(without_third(text)),
        other => other,
    };
    let (Step::Prints(taught_again) | Step::Stops(taught_again, _)) =
        words(39, [0.2, 0.0, 0.1], "T2.").step()
    else {
        panic!("it prints");
    };
    let half = |text: &str, percent: usize| text[..text.len() * percent / 100].rfind('\n');
    let cut = |text: &str, percent| text[..half(text, percent).map_or(0, |at| at + 1)].to_owned();
    let rest = |text: &str, percent| text[half(text, percent).map_or(0, |at| at + 1)..].to_owned();
    let turned = |case: usize| -> String {
        let text = clamping(case);
        let (first, rest) = text.split_at(text.find("SPHERE2").expect("three blocks"));
        format!("{rest}{first}")
    };
    vec![
        ("Taught: `G65 P8811 W54. T1.`", vec![Step::Sets(Box::new(guarded())), words(1, [0.0; 3], "T1.").step(), Step::Reads(1)]),
        ("Clamped elsewhere, probed, corrected", vec![clean(2, HERE).step(), Step::Reads(2)]),
        ("Nothing new was measured, and the control reads again", vec![Step::Reads(2)]),
        ("Text lost: nothing of run 3 comes", vec![Step::Reads(3)]),
        ("Text late: run 5 is probed, and what comes is of run 4", vec![clean(4, THERE).step(), Step::Reads(5)]),
        ("Text lost: the lines of a ball", vec![lost, Step::Reads(7)]),
        ("Work offset moved by 1 mm after teaching", vec![before(8, "#5221=1.").step(), Step::Reads(8)]),
        ("External offset moved by 0.05 mm", vec![before(9, "#5202=0.05").step(), Step::Reads(9)]),
        ("Another work offset is active", vec![before(10, "G55").step(), Step::Reads(10)]),
        ("Another order of the balls: 1, 3, 4, 2, closing ones", vec![
            Probing { probes: Some(between.map(in_turn).concat()), ..clean(11, [1.0, 2.0, 0.0]) }.step(),
            Step::Reads(11),
        ]),
        ("Taught again without saying so: T1.", vec![words(12, [0.3, 0.1, 0.0], "T1.").step(), Step::Reads(12)]),
        ("Taught again: T2.", vec![words(13, [0.0, 0.2, 0.0], "T2.").step()]),
        ("Early top: a chip of 30 µm on ball 2, and the sides follow", vec![
            Probing {
                body: "[[body]]\nname = \"CHIP\"\ngroup = \"PLATE\"\nshape = { block = { size_mm = [0.6, 0.6, 0.5] } }\nposition_mm = [138.0, -134.7, 122.93]\n",
                ..clean(14, HERE)
            }.step(),
            Step::Reads(14),
        ]),
        ("Top of ball 2 touched 30 µm early once, and the sides follow: its second touch is where it is", vec![
            early_once(clean(15, HERE).step(), 2, 0.03),
            Step::Reads(15),
        ]),
        ("Bent stylus: all hits off by 30 µm", vec![Probing { bent_mm: 0.03, ..clean(16, HERE) }.step(), Step::Reads(16)]),
        ("`G52 X1.` is active since before O8811", vec![before(17, "G52 X1.").step(), Step::Reads(17)]),
        ("`G92 Y-136.5` was set before O8811", vec![before(18, "G92 Y-136.5").step(), Step::Reads(18)]),
        ("`G52 X0.4` between O8811 and the first hit", vec![
            Probing { behind: "G52 X0.4", ..clean(19, HERE) }.step(),
            Step::Reads(19),
        ]),
        ("Another work offset between O8811 and the first hit", vec![
            Probing { behind: "G55", ..clean(20, HERE) }.step(),
            Step::Reads(20),
        ]),
        ("`G10 L2 P1 X0.5` behind the closing balls, before the one on the table", vec![
            Probing { between: "G10 L2 P1 X0.5", ..clean(21, HERE) }.step(),
            Step::Reads(21),
        ]),
        ("External offset written there", vec![
            Probing { between: "#5203=0.02", ..clean(22, HERE) }.step(),
            Step::Reads(22),
        ]),
        ("`G51 X0 Y0 Z0 P2.` is active", vec![before(23, "G51 X0 Y0 Z0 P2.").step(), Step::Reads(23)]),
        ("As it should be, again", vec![clean(26, THERE).step(), Step::Reads(26)]),
        ("The number of run 26 again, of another clamping: a count that was set back by one", vec![
            clean(26, [1.5, -1.0, 0.4]).step(),
            Step::Reads(26),
        ]),
        ("`T2.` of run 25 comes late, from a buffer that was not flushed", vec![
            words(25, HERE, "T2.").step(),
            Step::Reads(26),
            clean(27, [2.5, 1.5, 0.3]).step(),
            Step::Reads(27),
        ]),
        ("Balls before the one that is probed twice, and behind its second time: 3, 1, 4, closing, 2", vec![
            Probing { probes: Some(outside.map(in_turn).concat()), ..clean(28, [1.0, 2.0, 0.0]) }.step(),
            Step::Reads(28),
        ]),
        ("Another tool length in force than when it was taught, by 0.05 mm", vec![
            before(29, "G10 L10 P1 R0.05\nG43 H1").step(),
            Step::Reads(29),
        ]),
        ("Turned by 0.2 degrees about ball 1 when ball 4 had been probed", vec![
            turned_about_first(30, [0.0, 0.0, 0.2]),
            Step::Reads(30),
        ]),
        ("Rocked by 0.02 degrees over balls 1 and 4 there", vec![
            turned_about_first(31, [0.014, 0.0141, 0.0]),
            Step::Reads(31),
        ]),
        ("`G20` (inches) is active", vec![before(32, "G20").step(), Step::Reads(32)]),
        ("`G68 X0 Y0 R0.5` is active", vec![before(33, "G68 X0 Y0 R0.5").step(), Step::Reads(33)]),
        ("`G51.1 X0` (mirror) is active", vec![before(34, "G51.1 X0").step(), Step::Reads(34)]),
        ("`G54.1 P1` is active", vec![before(35, "G54.1 P1").step(), Step::Reads(35)]),
        ("Gauged at another feed than when it was taught: `#113=100.`", vec![
            Probing { behind: "#113=100.", ..clean(36, HERE) }.step(),
            Step::Reads(36),
        ]),
        ("The power goes when a correction waits", vec![
            clean(37, [2.0, 2.5, 0.1]).step(),
            Step::PowerGoes,
            Step::Reads(37),
        ]),
        ("The power goes while it is sent: what is left of it is not sent, nor all of it again", vec![
            clean(38, [2.1, 2.4, 0.1]).step(),
            Step::PowerGoesWhileSending(200),
            Step::Reads(38),
        ]),
        ("The power goes between `T2.` and the last hit: what was taught before is forgotten, and nothing is taught", vec![
            Step::Prints(cut(&taught_again, 60)),
            Step::PowerGoes,
            Step::Prints(rest(&taught_again, 60)),
            Step::Reads(39),
            clean(40, THERE).step(),
            Step::Reads(40),
        ]),
        ("Taught, the power goes, clamped elsewhere, corrected", vec![
            words(41, [0.1, 0.0, 0.0], "T1.").step(),
            Step::PowerGoes,
            clean(42, HERE).step(),
            Step::Reads(42),
        ]),
        ("`T2.` was left in the program", vec![
            words(43, [0.1, 0.2, 0.0], "T2.").step(),
            Step::Reads(43),
            words(44, HERE, "T2.").step(),
            Step::Reads(44),
            clean(45, THERE).step(),
            Step::Reads(45),
        ]),
        ("Blocks without run numbers in inches: taught, and against what was taught in mm", vec![
            Step::Sets(Box::new(job())),
            Step::Prints(in_inches(&clamping(0))),
            Step::Prints(clamping(0)),
            Step::Prints(in_inches(&clamping(1))),
            Step::Reads(1),
        ]),
        ("Blocks without run numbers, balls in order 2, 3, 1", vec![
            Step::Sets(Box::new(job())),
            Step::Prints(turned(0)),
            Step::Reads(1),
            Step::Prints(turned(1)),
            Step::Reads(2),
        ]),
        ("Blocks without run numbers, taught, corrected; then nothing new was measured, and the control reads again", vec![
            Step::Sets(Box::new(job())),
            Step::Prints(clamping(0)),
            Step::Reads(1),
            Step::Prints(clamping(1)),
            Step::Reads(2),
            Step::Reads(3),
        ]),
        ("The same, a correction that nobody has read; the next setup is touched, and nothing of it comes", vec![
            Step::Prints(clamping(2)),
            Step::Touches,
            Step::Reads(4),
        ]),
        ("Blocks behind the lines of O8811 (`examples/three-spheres-run.toml`): taught, corrected; and the control reads in the next run", vec![
            Step::Sets(Box::new(toml::from_str(&read("examples/three-spheres-run.toml")).expect("a job"))),
            Step::Prints(announced(101, "T1.", "") + &clamping(0)),
            Step::Prints(announced(102, "", "") + &clamping(1)),
            Step::Reads(102),
            Step::Reads(103),
        ]),
        ("The same, text late: run 104 is probed, and what comes is of run 103", vec![
            Step::Prints(announced(103, "", "") + &clamping(2)),
            Step::Reads(104),
        ]),
        ("The same, work offset moved by 1 mm after teaching", vec![
            Step::Prints(announced(105, "", "#5221=1.") + &clamping(3)),
            Step::Reads(105),
        ]),
        ("The same, from a program that does not call O8811", vec![
            Step::Prints(clamping(4)),
            Step::Reads(105),
        ]),
        ("The same, `umi teach --again`, and text of run 106 that was held up comes before that of run 107, which was meant", vec![
            Step::Asks,
            Step::Prints(announced(106, "", "") + &clamping(1)),
            Step::Reads(107),
        ]),
        ("The same, nothing taught, and text of run 201 with `T1.` comes late, before that of run 202, which was meant to teach", vec![
            Step::Sets(Box::new(toml::from_str(&read("examples/three-spheres-run.toml")).expect("a job"))),
            Step::Prints(announced(201, "T1.", "") + &clamping(0)),
            Step::Prints(announced(202, "T1.", "") + &clamping(1)),
            Step::Reads(202),
            Step::Prints(announced(203, "", "") + &clamping(2)),
            Step::Reads(203),
            Step::Prints(announced(204, "T1.", "") + &clamping(0)),
            Step::Prints(announced(205, "", "") + &clamping(1)),
            Step::Reads(205),
        ]),
        ("The same, `umi teach --again`, and text of run 206 that was held up comes before that of run 207, which was meant, both before the control reads", vec![
            Step::Asks,
            Step::Prints(announced(206, "", "") + &clamping(2)),
            Step::Prints(announced(207, "", "") + &clamping(0)),
            Step::Reads(207),
            Step::Prints(announced(208, "", "") + &clamping(1)),
            Step::Reads(208),
            Step::Asks,
            Step::Prints(announced(209, "", "") + &clamping(0)),
            Step::Reads(209),
            Step::Prints(announced(210, "", "") + &clamping(1)),
            Step::Reads(210),
        ]),
        ("The same, `umi teach --again`, text of run 211 without its last line, and text of run 212 with `T1.`, both late, before that of run 213, which was meant", vec![
            Step::Asks,
            Step::Prints(announced(211, "", "") + without_end(&clamping(1))),
            Step::Prints(announced(212, "T1.", "") + &clamping(2)),
            Step::Prints(announced(213, "", "") + &clamping(0)),
            Step::Reads(213),
        ]),
        ("The same, taught anew with `T2.` in run 303, of whose line that asks one digit comes wrong; then in run 305, of which nothing comes", vec![
            Step::Sets(Box::new(toml::from_str(&read("examples/three-spheres-run.toml")).expect("a job"))),
            Step::Prints(announced(301, "T1.", "") + &clamping(0)),
            Step::Prints(announced(302, "", "#530=301") + &clamping(1)),
            Step::Reads(302),
            Step::Prints(announced(303, "T2.", "").replace("A 8", "A 9") + &clamping(2)),
            Step::Prints(announced(304, "", "#530=303") + &clamping(3)),
            Step::Reads(304),
            Step::Prints(announced(306, "", "#530=305") + &clamping(1)),
            Step::Reads(306),
            Step::Prints(announced(307, "T2.", "") + &clamping(0)),
            Step::Prints(announced(308, "", "#530=307") + &clamping(2)),
            Step::Reads(308),
        ]),
    ]
}

/// A text without its last line.
fn without_end(text: &str) -> &str {
    let end = text.trim_end().rfind('\n').expect("lines");
    &text[..=end]
}

/// The blocks of a clamping as a control prints them under G20.
fn in_inches(text: &str) -> String {
    let line = |line: &str| -> String {
        let numbers = line.trim_end().split('*').skip(1);
        let numbers: Option<Vec<f64>> = numbers.map(|number| number.trim().parse().ok()).collect();
        match numbers {
            Some(numbers) if numbers.len() == 3 => {
                let inches = numbers.iter().map(|mm| format!("*{:.4}", mm / 25.4));
                inches.collect::<String>() + "\r\n"
            }
            _ => line.to_owned(),
        }
    };
    text.split_inclusive('\n').map(line).collect()
}

/// What a control does that has read this in a run.
fn carried_out(program: &str, run: u32) -> String {
    let mut control = Control::new(ControlSettings::of(ControlFamily::Fanuc));
    if let Err(alarm) = control.load(program) {
        return format!("cannot read it: {}", alarm.message);
    }
    let main = format!("%\nO0001\n#531={run}\nM98 P9010\nM30\n%\n");
    let main = control.load(&main).expect("a program");
    control.select(main[0]).expect("it is there");
    let scene = Scene::parse(&read("examples/scenes/four-spheres.toml")).expect("a scene");
    let mut machine = VirtualMachine::new(scene, 1, Serial(Vec::new()));
    match control.run(&mut machine) {
        Ok(_) => "is corrected".into(),
        Err(alarm) => format!("stops: {}", alarm.message),
    }
}

/// The session on a board, or the ways of it whose numbers are chosen: a page of what was done, judged, and read. A way
/// goes on from the one before, unless it sets a job.
///
/// # Panics
/// As a test does.
#[must_use]
pub fn page(rig: &mut dyn Rig, chosen: fn(usize) -> bool) -> String {
    let mut client = connect(rig);
    let mut page = String::new();
    let (mut verdicts, mut bytes) = (0, 0);
    for (number, (name, steps)) in (1..).zip(ways()).filter(|(number, _)| chosen(*number)) {
        let _ = writeln!(page, "\n{number}. {name}\n");
        for step in steps {
            if let Step::Stops(_, message) = &step {
                let _ = writeln!(page, "   * The macro stops: {message}.");
            }
            match step {
                Step::Sets(job) => {
                    client.set_job(&job).unwrap().unwrap();
                    // The receiver of a new job counts anew.
                    bytes = 0;
                }
                Step::Prints(text) | Step::Stops(text, _) => {
                    rig.control_sends(text.as_bytes());
                    bytes += text.len() as u64;
                    let status = until(rig, "all of the text", |_| {
                        let status = client.status().unwrap();
                        (status.counters.bytes >= bytes).then_some(status)
                    });
                    if status.verdicts == verdicts {
                        let _ = writeln!(page, "   * No verdict: the setup is not complete.");
                        continue;
                    }
                    verdicts = status.verdicts;
                    let verdict = client.verdict().unwrap().unwrap();
                    let is = if verdict.ok { "OK" } else { "NG" };
                    let _ = writeln!(page, "   * {is}.");
                    for said in verdict.reasons.iter().chain(&verdict.remarks) {
                        let _ = writeln!(page, "     {said}.");
                    }
                }
                Step::Touches => {
                    rig.skip();
                    until(rig, "the touch", |_| {
                        let status = client.status().unwrap();
                        (!status.correction_waiting).then_some(())
                    });
                    let _ = writeln!(page, "   * The probe touches.");
                }
                Step::Asks => {
                    client.teach(TeachWhat::Again).unwrap().unwrap();
                    let _ = writeln!(page, "   * A host asks to teach again.");
                }
                Step::PowerGoes => {
                    drop(client);
                    rig.power_cycle();
                    client = connect(rig);
                    (verdicts, bytes) = (0, 0);
                    let _ = writeln!(page, "   * The board's power goes and comes.");
                }
                Step::PowerGoesWhileSending(characters) => {
                    rig.control_sends(DC1);
                    let _ = receive(rig, characters);
                    drop(client);
                    rig.power_cycle();
                    client = connect(rig);
                    (verdicts, bytes) = (0, 0);
                    let _ = writeln!(
                        page,
                        "   * The control reads, and the power goes behind {characters} characters."
                    );
                }
                Step::Reads(run) => {
                    rig.control_sends(DC1);
                    bytes += 1;
                    let program = receive_program(rig);
                    let does = carried_out(&program, run);
                    let _ = writeln!(page, "   * The control reads in run {run} and {does}.");
                }
            }
        }
    }
    page
}
