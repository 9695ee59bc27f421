//! What we send and what we interpret, judged by LinuxCNC's interpreter.
//!
//! `rs274` does not know `G68`; there the rotation is given to the work offset
//! (`G10 L2 P R`), which turns about the offset's origin, and a `G52` puts the centre
//! right. The offset goes through as it was sent.

use std::path::{Path, PathBuf};

use umi_core::brain::{Brain, Output};
use umi_core::units::{Micros, Point};
use umi_protocol::job::Job;
use umi_tests::referee::{Before, Referee};
use umi_virtual::nc::{Control, ControlFamily, ControlSettings, DecimalPoint, Recorder};

const TMP: &str = env!("CARGO_TARGET_TMPDIR");
/// Both interpreters must agree within this; the referee prints steps of 0.0001.
const TOLERANCE_MM: f64 = 1e-4;
/// Where the referee prints steps of 0.0001 inch.
const INCH_TOLERANCE_MM: f64 = 25.4 * TOLERANCE_MM;

fn folder(test: &str) -> PathBuf {
    PathBuf::from(TMP).join("referee").join(test)
}

/// The correction programs of the reference session: four clampings of the plate,
/// -2 to +1 degrees and up to 48 mm (the thesis' table 4.2).
fn corrections() -> Vec<String> {
    let mut job: Job = toml::from_str(include_str!("../../../examples/three-spheres.toml"))
        .expect("the example job is good");
    // The part beside the offset's origin, so that the rotation's centre matters.
    if let Some(correction) = &mut job.correction {
        correction.part_min_mm = [10.0, -80.0, 18.4];
        correction.part_max_mm = [60.8, -9.8, 25.4];
    }
    let mut brain = Brain::new(job).expect("the example job is good");
    let mut programs = Vec::new();
    let mut take = |output: Output<'_>| {
        if let Output::Verdict(verdict) = output
            && let Some(correction) = &verdict.correction
        {
            programs.push(correction.text.to_string());
        }
    };
    let session = include_bytes!("../../reference/sessions/session_a.txt");
    brain.bytes(Micros(1), session, &mut take);
    brain.input_ended(Micros(2), &mut take);
    programs
}

/// The value of a word, as `X` in `G68 X1.5 Y2.`.
fn word(block: &str, letter: char) -> f64 {
    block
        .split_whitespace()
        .find_map(|word| word.strip_prefix(letter))
        .and_then(|value| value.parse().ok())
        .unwrap_or_else(|| panic!("no {letter} in {block}"))
}

/// The beginning of the finishing path of the cylinder-arc workpiece (Sawula 2013,
/// appendix E), as a part program writes it after its header: an arc of 109 mm radius
/// in lines along X, 0.53 mm apart.
fn finishing_path() -> String {
    let mut text = String::new();
    for line in 0..134 {
        let y = 35.004 - 0.525 * f64::from(line);
        let z = (109.0f64.powi(2) - y * y).sqrt() - 109.0 + 24.265;
        text.push_str(&format!(
            "G0 X-25.399 Y{y:.3} Z50.0\nG0 Z{:.3}\nG1 Z{z:.3} F1000.0\nG1 X25.391\nG0 Z50.0\n",
            z + 5.0
        ));
    }
    text
}

/// A correction in the words that `rs274` knows.
fn translated(correction: &str) -> String {
    let mut text = String::new();
    for line in correction.lines() {
        if line.starts_with("G68 ") {
            let (x, y, angle) = (word(line, 'X'), word(line, 'Y'), word(line, 'R'));
            let (sin, cos) = angle.to_radians().sin_cos();
            // Turned by R, (c + g) must come to c.
            text.push_str(&format!(
                "G10 L2 P2 R{angle:.3}\nG52 X{:.6} Y{:.6}\n",
                x * cos + y * sin - x,
                -x * sin + y * cos - y
            ));
        } else if !["%", "O", "G69", "M99"]
            .iter()
            .any(|word| line.starts_with(word))
        {
            text.push_str(line);
            text.push('\n');
        }
    }
    text
}

/// Compares two lists of end points; a motion of no length does not count.
fn compare(ours: &[[f64; 3]], theirs: &[[f64; 3]], tolerance_mm: f64) -> Result<(), String> {
    let distance = |a: &[f64; 3], b: &[f64; 3]| {
        let squares = a.iter().zip(b).map(|(a, b)| (a - b).powi(2));
        squares.sum::<f64>().sqrt()
    };
    let moved = |points: &[[f64; 3]]| {
        let mut kept: Vec<[f64; 3]> = Vec::new();
        for point in points {
            if kept
                .last()
                .is_none_or(|last| distance(last, point) > 2.0 * tolerance_mm)
            {
                kept.push(*point);
            }
        }
        kept
    };
    let (ours, theirs) = (moved(ours), moved(theirs));
    for (number, (a, b)) in ours.iter().zip(&theirs).enumerate() {
        if distance(a, b) > tolerance_mm {
            return Err(format!("motion {number}: {a:?}, the referee {b:?}"));
        }
    }
    if ours.len() == theirs.len() {
        Ok(())
    } else {
        Err(format!("{ours:?}\nthe referee {theirs:?}"))
    }
}

/// The referee carries the finishing path to where the plan of the correction says:
/// `machine(p) = O' + c + Rz (p - c)`.
#[test]
fn corrections_do_what_they_say() {
    let Some(referee) = Referee::find(TMP) else {
        return;
    };
    let corrections = corrections();
    assert_eq!(corrections.len(), 4);
    let path = finishing_path();
    let folder = folder("corrections");
    let plain = referee
        .end_points(&folder, &Before::default(), &format!("G21 G90\n{path}M2\n"))
        .unwrap();
    for correction in corrections {
        let block = |start: &str| {
            let found = correction.lines().find(|line| line.starts_with(start));
            found.unwrap_or_else(|| panic!("no {start} in {correction}"))
        };
        let (offset, turn) = (block("G10 L2 P2 "), block("G68 "));
        let (sin, cos) = word(turn, 'R').to_radians().sin_cos();
        let (cx, cy) = (word(turn, 'X'), word(turn, 'Y'));
        let wanted: Vec<[f64; 3]> = plain
            .iter()
            .map(|[x, y, z]| {
                [
                    word(offset, 'X') + cx + cos * (x - cx) - sin * (y - cy),
                    word(offset, 'Y') + cy + sin * (x - cx) + cos * (y - cy),
                    word(offset, 'Z') + z,
                ]
            })
            .collect();
        let program = format!("{}{path}M2\n", translated(&correction));
        let judged = referee
            .end_points(&folder, &Before::default(), &program)
            .unwrap();
        // The first motion starts where no machine stands: its Z is not programmed.
        compare(&wanted[1..], &judged[1..], TOLERANCE_MM)
            .unwrap_or_else(|why| panic!("{correction}: {why}"));
    }
}

/// Where the motions of a program end by our interpreter. The last text is the main
/// program.
fn ours(dialect: ControlFamily, before: &Before, texts: &[&str]) -> Result<Vec<[f64; 3]>, String> {
    let settings = ControlSettings {
        // Numbers in the programs mean the same to both, and nothing is rounded.
        decimal_point: DecimalPoint::Calculator,
        increment_mm: 1e-7,
        second_reference_mm: Some(before.second_reference_mm),
        ..ControlSettings::of(dialect)
    };
    let mut control = Control::new(settings);
    let mut main = 0;
    for text in texts {
        let loaded = control.load(text).map_err(|alarm| alarm.to_string())?;
        main = loaded.first().copied().unwrap_or(main);
    }
    control.select(main).map_err(|alarm| alarm.to_string())?;
    let reference_point = Point::from_array_mm(before.reference_point_mm);
    let mut axes = Recorder::new(Point::from_mm(0.0, 0.0, 0.0), reference_point);
    control.run(&mut axes).map_err(|alarm| alarm.to_string())?;
    let ends = axes.motions.iter();
    Ok(ends.map(|(_, motion)| motion.to.to_array_mm()).collect())
}

/// The finishing path under each correction as it was sent, run as the shop would run it:
/// both interpreters end every motion in the same place.
#[test]
fn corrected_path_is_the_referees() {
    let Some(referee) = Referee::find(TMP) else {
        return;
    };
    let folder = folder("corrected_path");
    let before = Before::default();
    let path = finishing_path();
    for correction in corrections() {
        let program = format!("{}{path}M2\n", translated(&correction));
        let theirs = referee.end_points(&folder, &before, &program).unwrap();
        let main = format!("%\nO0001\nG21 G90\nM98 P9010\n{path}M30\n%\n");
        let ours = ours(ControlFamily::Fanuc, &before, &[&correction, &main]).unwrap();
        assert!(ours.len() > 600);
        compare(&ours, &theirs, TOLERANCE_MM).unwrap_or_else(|why| panic!("{correction}: {why}"));
    }
}

const BOTH: &[ControlFamily] = &[ControlFamily::Fanuc, ControlFamily::LinuxCnc];

/// Ordinary programs in words that both know, and the dialects that have these words.
const PROGRAMS: [(&str, &[ControlFamily], &str); 19] = [
    (
        "arcs in three planes, I J K",
        BOTH,
        "G21 G90 G17\nG0 X5 Y5 Z5\nG2 X15 Y5 I5 J0 F100\nG3 X15 Y15 I0 J5\n\
         G18 G2 X25 Z5 I5 K0\nG3 X25 Z15 I0 K5\nG19 G2 Y25 Z15 J5 K0\nG3 Y25 Z25 J0 K5\n",
    ),
    (
        "arcs in three planes, R short and long",
        BOTH,
        "G21 G90 G17\nG0 X0 Y0 Z0\nG2 X10 Y10 R10 F100\nG3 X20 Y0 R-12\nG18 G2 X30 Z8 R20\n\
         G3 X20 Z0 R-9\nG19 G3 Y10 Z10 R10\nG2 Y0 Z0 R-14\n",
    ),
    (
        "full circles and helices",
        BOTH,
        "G21 G90 G17\nG0 X10 Y0 Z0\nG2 I-10 J0 F100\nG3 X10 Y0 I-10 J0 Z-4\nG2 X0 Y10 I-10 J0 Z2\n\
         G18 G3 X0 Z2 I5 K0 Y20\nG19 G2 Y30 Z2 J5 K0 X7.5\n",
    ),
    (
        "increments",
        BOTH,
        "G21 G91 G17\nG0 X1.5 Y-2.25\nX1.5 Z3\nG1 Z-1 F200\nG2 X4 Y4 I4 J0\nG3 X-4 Y4 R4\n\
         G90 G0 X0 Y0\nG91 Z0.125\nG90 Z1\n",
    ),
    (
        "inches and back",
        BOTH,
        "G20 G90 G17\nG0 X1 Y0.5 Z0.25\nG1 X-0.125 F10\nG2 X0.875 Y0.5 I0.5 J0\nG21\n\
         G0 X10 Y10 Z10\nG91 X2.5\nG20 X1\nG90 G0 Z0\n",
    ),
    (
        "work offsets in absolute and incremental mode",
        BOTH,
        "G21 G90\nG10 L2 P1 X10 Y20 Z30\nG10 L2 P3 X-5 Y2.5 Z-1.25\nG54 G0 X1 Y1 Z1\nG56 X1 Y1 Z1\n\
         G91 X1\nG90 G54 X1\nG10 L2 P1 X11\nX1\n",
    ),
    (
        "work offsets given in inches",
        BOTH,
        "G20 G90\nG10 L2 P2 X1 Y-2 Z0.5\nG55 G0 X0 Y0 Z0\nG21 X25.4 Y0\n",
    ),
    (
        "G53",
        BOTH,
        "G21 G90\nG10 L2 P1 X10 Y20 Z30\nG54 G0 X1 Y2 Z3\nG53 G0 Z100\nG53 G0 X0 Y0\nX5\nG1 Z2 F100\n",
    ),
    (
        "G92 and what it takes back",
        &[ControlFamily::LinuxCnc],
        "G21 G90\nG10 L2 P1 X10 Y20 Z30\nG54 G0 X5 Y5 Z5\nG92 X0 Y1 Z2\nG0 X1 Y1 Z1\nG55 X0 Y0 Z0\n\
         G54 X3\nG92.1\nX3 Y3 Z3\n",
    ),
    (
        "G52",
        &[ControlFamily::Fanuc],
        "G21 G90\nG10 L2 P1 X10 Y20 Z30\nG54 G0 X5 Y5 Z5\nG52 X1 Y2 Z3\nG0 X0 Y0 Z0\nG55 X0 Y0 Z0\n\
         G54 G52 X0 Y0 Z0\nX0 Y0 Z0\n",
    ),
    (
        "tool length",
        BOTH,
        "G21 G90\nG0 Z100\nG43 H1\nG0 X1 Y1 Z10\nG1 Z-2 F100\nG49\nG0 Z200\n",
    ),
    (
        "reference points",
        BOTH,
        "G21 G90\nG10 L2 P1 X10 Y20 Z30\nG54 G0 X5 Y5 Z5\nG28 Z50\nG28 X6 Y7\nG0 X1 Y2 Z3\nG91 G28 Z0\n\
         G90 G30 X2 Y2 Z60\n",
    ),
    (
        "drilling: G81, G82, back to R and to the start",
        BOTH,
        "G21 G90 G17\nG0 X0 Y0 Z20\nG99 G81 X10 Y10 Z-5 R2 F100\nX20\nY20\nG80\nG0 Z25\n\
         G98 G81 X30 Y10 Z-5 R2\nX35 Y5\nG80\n\
         G0 X0 Y0 Z20\nG98 G82 X5 Y5 Z-3 R1 P0.5 F50\nX6\nG80\nG0 Z30\n",
    ),
    (
        "deep drilling: G83",
        &[ControlFamily::LinuxCnc],
        "G21 G90 G17\nG0 X0 Y0 Z20\nG98 G83 X10 Y10 Z-10 R2 Q3 F100\nX20\nG80\nG0 Z25\n",
    ),
    (
        "drilling that begins below R",
        &[ControlFamily::LinuxCnc],
        "G21 G90 G17\nG0 X0 Y0 Z2\nG98 G81 X10 Y0 R5 Z-10 F100\nX20\nG80\nG0 X0 Z1\n\
         G99 G82 X30 Y10 R3 Z-2 P0.1\nX35\nG80\nG0 Z1\nG91 G98 G81 X5 R4 Z-3 L3\nG80\n\
         G90 G0 Z0\nG98 G83 X1 Y1 R0.5 Z-1 Q0.3\nX2\nG80\nG0 Z9\n",
    ),
    (
        "expressions and variables",
        BOTH,
        "G21 G90\n#1=12.5\n#2=[#1*2-SQRT[9]]\n#3=[ATAN[1]/[1]+SIN[30]*COS[60]]\n\
         G0 X#1 Y#2 Z#3\n#4=[ROUND[#3]+FIX[2.5]+FUP[2.1]+ABS[-1.5]]\n\
         G0 X[#4/8] Y[12 MOD 5] Z-#1\n#[3+4]=6\nG0 X#7\n",
    ),
    (
        "what LinuxCNC calculates in its own way",
        &[ControlFamily::LinuxCnc],
        "G21 G90\n#1=12.5\nG0 X[FIX[-2.5]] Y[#1 MOD 5] Z[FUP[-2.5]]\nG0 X[2**3] Y[#1 GT 12] Z[EXISTS[#<a>]]\n\
         #<a>=4.25 G0 X0\nG0 X#<a> Y[ROUND[-1.5]] Z[ACOS[0]/ASIN[1]]\n\
         G0 X[EXP[1]] Y[LN[7.5]] Z[-12.5 MOD 5]\n",
    ),
    (
        "O words",
        &[ControlFamily::LinuxCnc],
        "G21 G90\no<step> sub\nG91 G0 X#1 Y#2\nG90\no10 if [#1 GT 1]\nG0 Z#1\no10 elseif [#1 EQ 1]\nG0 Z-1\n\
         o10 else\nG0 Z-2\no10 endif\no<step> endsub [#1 * 3]\n\
         #5=0\no20 while [#5 LT 4]\no<step> call [#5] [1.5]\nG0 Y#<_value>\n#5=[#5+1]\no20 endwhile\n\
         o30 repeat [3]\nG91 G1 X0.5 F100\no30 endrepeat\no40 do\nG90 G0 Z#5\n#5=[#5-1]\no40 while [#5 GT 1]\n\
         o50 while [1]\n#5=[#5+1]\no60 if [#5 GT 6]\no50 break\no60 endif\nG0 X#5\no50 endwhile\n",
    ),
    (
        "a rotated work offset, and one set from the position",
        &[ControlFamily::LinuxCnc],
        "G21 G90\nG10 L2 P2 X10 Y20 Z30 R30\nG55 G0 X10 Y0 Z1\nG2 X20 Y10 I10 J0 F100\nG91 G1 X1\n\
         G90 G10 L20 P2 X0 Y0\nG0 X5 Y-5\nG10 L2 P2 R0\nG0 X1 Y1\nG53 G0 X0 Y0 Z0\n",
    ),
];

/// Both interpreters make the same end points of every program, in the words of Fanuc and
/// in those of LinuxCNC.
#[test]
fn ordinary_programs_end_where_the_referee_says() {
    let Some(referee) = Referee::find(TMP) else {
        return;
    };
    let before = Before {
        reference_point_mm: [1.0, 2.0, 300.0],
        second_reference_mm: [-4.0, -5.0, 250.0],
        tool_length_mm: 50.5,
    };
    let mut failures = Vec::new();
    for (name, dialects, body) in PROGRAMS {
        let program = format!("{body}M2\n");
        let theirs = referee
            .end_points(&folder("ordinary"), &before, &program)
            .unwrap_or_else(|why| panic!("{name}: {why}"));
        assert!(theirs.len() > 1, "{name}");
        let tolerance_mm = if body.contains("G20") {
            INCH_TOLERANCE_MM
        } else {
            TOLERANCE_MM
        };
        for dialect in dialects {
            let main = match dialect {
                ControlFamily::LinuxCnc => format!("G21\nG10 L1 P1 Z50.5\n{program}"),
                _ => format!("%\nO0001\nG21\nG10 L10 P1 R50.5\n{program}%\n"),
            };
            let same = ours(*dialect, &before, &[&main])
                .and_then(|ours| compare(&ours, &theirs, tolerance_mm));
            if let Err(why) = same {
                failures.push(format!("{name}, {dialect:?}: {why}"));
            }
        }
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

/// LinuxCNC itself calculates with our macros for it: what its interpreter prints of a hit
/// is a line that the receiver takes, with every digit as it went in.
#[test]
fn linuxcnc_prints_checked_lines() {
    let Some(referee) = Referee::find(TMP) else {
        return;
    };
    let points = [
        [-135.019, 42.618, -7.3],
        [0.0, -0.001, 99_999.999],
        [1e-5, -499.9996, 12.0004],
    ];
    let mut program = String::from("G21 G40 G90\nO<UMI_START> CALL\n");
    for (number, [x, y, z]) in (1..).zip(points) {
        program.push_str(&format!(
            "O<UMI_LINE> CALL [{number}] [2] [1] [50] [{x}] [{y}] [{z}]\n"
        ));
    }
    program.push_str("M2\n");
    let macros = concat!(env!("CARGO_MANIFEST_DIR"), "/../hw/control/linuxcnc");
    let lines = referee
        .logged(&folder("linuxcnc"), Path::new(macros), &program)
        .unwrap();
    // First come the active work offset, what else moves coordinates, and what shifts them.
    assert_eq!(lines.len(), 3 + points.len());

    let job = "name = \"LINE\"\nreference = \"taught\"\nplate_timeout_s = 9\ncompensation = \"in_macro\"\n\
        [receiver]\ncoding = \"auto\"\nidle_timeout_s = 9\npatterns = [{ checked = {} }]\n\
        [[features]]\nname = \"F\"\nid = 1\nkind = \"line\"\nhits = 2\n\
        [limits]\nradius_error_mm = 1.0\nrms_mm = 1.0\ndistance_error_mm = 1.0\n\
        registration_rms_mm = 1.0\nrotation_deg = 9.0\ntilt_deg = 9.0\nshift_mm = [9.0, 9.0, 9.0]\n";
    let mut brain = Brain::new(toml::from_str(job).unwrap()).unwrap();
    let mut hits = Vec::new();
    brain.bytes(
        Micros(1),
        (lines.join("\n") + "\n").as_bytes(),
        &mut |output| {
            if let Output::Hit(hit) = output {
                hits.push(hit.position_mm);
            }
        },
    );
    let rounded = points.map(|point| point.map(|mm: f64| (mm * 1000.0).round() / 1000.0));
    assert_eq!(hits, rounded, "{lines:?}");

    // It looks as well, and aborts by itself.
    let looks = |name: &str, change: &str| {
        let program = format!(
            "G21 G40 G90 G54\nO<UMI_START> CALL\nG0 X10 Z5\n{change}\nO<UMI_LOOK> CALL\nM2\n"
        );
        referee.logged(&folder(name), Path::new(macros), &program)
    };
    assert_eq!(looks("look", "").unwrap().len(), 3);
    for (number, (change, said)) in [
        ("G52 X1", "G52 OR G92 CHANGED"),
        ("G92 Z1", "G52 OR G92 CHANGED"),
        ("G10 L2 P1 Y0.3", "WORK OFFSET CHANGED"),
        ("G10 L2 P1 R1", "WORK OFFSET CHANGED"),
        ("G55", "OTHER WORK OFFSET NOW"),
        ("G43.1 Z0.3", "TOOL LENGTH CHANGED"),
        ("G43.1 X0.3", "TOOL LENGTH CHANGED"),
    ]
    .into_iter()
    .enumerate()
    {
        let error = looks(&format!("look{number}"), change).unwrap_err();
        assert!(error.contains(said), "{change}: {error}");
    }
}
