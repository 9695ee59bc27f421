//! What moves the coordinates of a run, on each family's control with the macros that ship:
//! named by the board or by the macro, never corrected.

use umi_core::brain::{Brain, Output};
use umi_core::units::Micros;
use umi_protocol::job::Job;
use umi_protocol::verdict::Verdict;

use crate::macros::bench::*;

/// Four balls, and where they are touched from: on no grid, as on no machine.
const BALLS_MM: [[f64; 2]; 4] = [
    [-100.013, -80.027],
    [100.041, -75.004],
    [-95.037, 85.019],
    [105.008, 80.033],
];

/// The clampings of one session: taught where it stands, then moved.
const TAUGHT: [f64; 2] = [0.0, 0.0];
const MOVED: [f64; 2] = [1.5, -2.0];

fn scene([x, y]: [f64; 2]) -> String {
    let ball = |(number, [at_x, at_y]): (u8, &[f64; 2])| {
        format!(
            "[[body]]\nname = \"BALL{number}\"\nshape = {{ sphere = {{ radius_mm = 10.0 }} }}\n\
             position_mm = [{}, {}, {}]\n",
            at_x + x,
            at_y + y,
            60.0 + 5.013 * f64::from(number)
        )
    };
    (1..).zip(&BALLS_MM).map(ball).collect()
}

/// A job that corrects, with every guard on.
fn guarded() -> Job {
    let features: Vec<_> = (1..=4).map(|id| (id, "sphere", 5, Some(10.0))).collect();
    let text = format!(
        "teach = \"asked\"\n{}\n[guards]\nrun_variable = 531\nframe = true\n\
         [correction]\ndialect = \"g10-g68\"\nprobed_in = \"G54\"\nprobed_origin_mm = [0.0, 0.0, 0.0]\n\
         write_to = \"G55\"\nprogram_number = 9010\nends_with = \"M99\"\n\
         part_min_mm = [-50.0, -50.0, 0.0]\npart_max_mm = [50.0, 50.0, 20.0]\nleftover_mm = 0.05\n\
         send = \"on_request\"\n",
        job(Tip::OnBoard, &features)
            .replace("[limits]\n", "[limits]\napproach_deg = 0.2\n")
            .replace(
                "hits = 5\n",
                "hits = 5\napproach = [\"-z\", \"-x\", \"+x\", \"-y\", \"+y\"]\n"
            )
    );
    toml::from_str(&text).unwrap()
}

/// A part program's body: `at` holds blocks before O8811, behind it, and before each further ball.
fn body(family: Family, run: u32, start: &str, at: [&str; 5]) -> String {
    let is_linuxcnc = family == Family::LinuxCnc;
    let count = if is_linuxcnc { 4531 } else { 531 };
    let start = match (family, start) {
        (Family::LinuxCnc, "") => "O<UMI_START> CALL".into(),
        (Family::LinuxCnc, word) => format!("O<UMI_START> CALL [{word}]"),
        (_, "") => "G65 P8811".into(),
        (_, word) => format!("G65 P8811 T{word}."),
    };
    let mut text = format!(
        "#{count}={}\nG21 G17 G40 G49 G80 G90 G94 G54\nG0 X-100. Y-80.\nG0 Z100.\n{}\n{start}\n",
        run - 1,
        at[0]
    );
    for (number, ([x, y], before)) in (1..).zip(BALLS_MM.iter().zip(&at[1..])) {
        let call = if is_linuxcnc {
            format!("O<UMI_SPHERE> CALL [20] [{number}] [60]")
        } else {
            format!("G65 P8820 D20. B{number}. Q60.")
        };
        // Where a shift is active, a ball is near enough to be found all the same.
        text += &format!("G0 Z100.\nG0 X{x:?} Y{y:?}\n{before}\n{call}\n");
    }
    text
}

/// What the board says of a clean teaching and of a second run with these blocks, and the
/// alarm that ends that one.
fn second_run(family: Family, at: [&str; 5]) -> (Vec<Verdict>, Option<String>) {
    let taught = run_text(family, &scene(TAUGHT), &body(family, 1, "1", [""; 5]));
    assert_eq!(taught.alarm, None, "{family:?}");
    let ran = run_text(family, &scene(MOVED), &body(family, 2, "", at));
    let verdicts = judged(&[&taught, &ran]);
    let said = |message: &str| {
        let own = message.split_once("the program says: ");
        own.map_or(message, |(_, own)| own).to_uppercase()
    };
    (verdicts, ran.alarm.map(|alarm| said(&alarm.message)))
}

fn judged(runs: &[&Ran]) -> Vec<Verdict> {
    let mut brain = Brain::new(guarded()).unwrap();
    let mut verdicts = Vec::new();
    for (number, ran) in (1u64..).zip(runs) {
        brain.bytes(Micros(number), ran.bytes(), &mut |output| {
            if let Output::Verdict(verdict) = output {
                verdicts.push(verdict.clone());
            }
        });
    }
    verdicts
}

fn codes(verdict: &Verdict) -> Vec<&'static str> {
    verdict.reasons.iter().map(|r| r.reason.code()).collect()
}

/// Without any of it the second run is corrected, by what the scene says.
#[test]
fn a_clean_run_is_corrected() {
    for family in FAMILIES {
        let (verdicts, alarm) = second_run(family, [""; 5]);
        assert_eq!(alarm, None, "{family:?}");
        let [taught, corrected] = &verdicts[..] else {
            panic!("{family:?}: {verdicts:?}");
        };
        assert!(taught.ok && corrected.ok, "{family:?}: {corrected:?}");
        assert!(corrected.correction.is_some());
        let moved = corrected.registration.as_ref().unwrap().translation_mm;
        assert!((moved[0] - MOVED[0]).abs() < 0.005, "{family:?} {moved:?}");
        assert!((moved[1] - MOVED[1]).abs() < 0.005, "{family:?} {moved:?}");
    }
}

/// Whatever shifts the coordinates when a run begins is told by the board, and where no variable
/// holds it the macro stops by itself.
#[test]
fn what_is_active_before_a_run_is_named() {
    // What is done, by whom it is seen on Fanuc and Mitsubishi, on Haas, on LinuxCNC.
    let cases = [
        ("G52 X1.", ["alarm", "external_offset", "external_offset"]),
        (
            "G52 Z-0.05",
            ["alarm", "external_offset", "external_offset"],
        ),
        ("G92 X-99.", ["alarm", "alarm", "external_offset"]),
        ("G92 Z100.02", ["alarm", "alarm", "external_offset"]),
        ("G10 L2 P1 X0.5", ["offset_changed"; 3]),
        ("G55", ["other_offset"; 3]),
        (
            "G10 L2 P0 Y0.3",
            ["external_offset", "external_offset", "offset_changed"],
        ),
    ];
    for family in FAMILIES {
        for (what, seen) in cases {
            let seen = match family {
                Family::Fanuc | Family::MitsubishiMazak => seen[0],
                Family::Haas => seen[1],
                Family::LinuxCnc => seen[2],
            };
            let (verdicts, alarm) = second_run(family, [what, "", "", "", ""]);
            let ok: Vec<bool> = verdicts.iter().map(|verdict| verdict.ok).collect();
            if seen == "alarm" {
                assert_eq!(
                    alarm.as_deref(),
                    Some("G52 OR G92 IS ACTIVE"),
                    "{family:?} {what}"
                );
                assert_eq!(ok, [true], "{family:?} {what}");
            } else {
                assert_eq!(alarm, None, "{family:?} {what}");
                assert_eq!(ok, [true, false], "{family:?} {what}");
                assert_eq!(codes(&verdicts[1]), [seen], "{family:?} {what}");
            }
        }
    }
}

/// Scaling and mirror show in no position. Where a variable has them the macro stops by itself,
/// before anything is printed; a program of others, where it looks.
#[test]
fn scaling_and_mirror_are_an_alarm() {
    for family in [Family::Fanuc, Family::MitsubishiMazak, Family::Haas] {
        for what in ["G51 X0 Y0 Z0 P2.", "G51 X0 Y0 I1. J1. K1.", "G51.1 X0"] {
            if family == Family::Haas && what.starts_with("G51.1") {
                // Its mirror is G101, in no variable.
                continue;
            }
            let said = Some("SCALING OR MIRROR ACTIVE");
            let (verdicts, alarm) = second_run(family, [what, "", "", "", ""]);
            assert_eq!(alarm.as_deref(), said, "{family:?} {what}");
            assert_eq!(verdicts.len(), 1, "{family:?} {what}: the taught one");
            let text = format!("G21 G90 G54\nG0 X1. Y2. Z100.\nG65 P8811\n{what}\nG65 P8819\n");
            let ran = run_text(family, &scene(TAUGHT), &text);
            ran.refused("SCALING OR MIRROR ACTIVE");
            // And off again.
            let off = if what.starts_with("G51.1") {
                "G50.1 X0"
            } else {
                "G50"
            };
            let (verdicts, alarm) = second_run(family, [&format!("{what}\n{off}"), "", "", "", ""]);
            assert_eq!(alarm, None, "{family:?} {what}");
            assert!(verdicts.iter().all(|of| of.ok), "{family:?} {what}");
        }
    }
}

/// Inches against a job in millimetres: an alarm before anything is printed or moves, and where
/// a program of others looks.
#[test]
fn inches_are_an_alarm() {
    for family in FAMILIES {
        let (start, look) = match family {
            Family::LinuxCnc => ("O<UMI_START> CALL", "O<UMI_LOOK> CALL"),
            _ => ("G65 P8811", "G65 P8819"),
        };
        let (verdicts, alarm) = second_run(family, ["G20", "", "", "", ""]);
        assert_eq!(alarm.as_deref(), Some("SET G21"), "{family:?}");
        assert_eq!(verdicts.len(), 1, "{family:?}: the taught one");
        let text = format!("G21 G90 G54\nG0 X1. Y2. Z100.\n{start}\nG20\n{look}\n");
        run_text(family, &scene(TAUGHT), &text).refused("SET G21");
        // And off again.
        let (verdicts, alarm) = second_run(family, ["G20\nG21", "", "", "", ""]);
        assert_eq!(alarm, None, "{family:?}");
        assert!(verdicts.iter().all(|of| of.ok), "{family:?}");
    }
}

/// A rotation: the board names that of a work offset, and the hits refuse G68; none of its runs
/// is corrected.
#[test]
fn a_rotation_is_refused() {
    for family in FAMILIES {
        let what = match family {
            Family::LinuxCnc => "G10 L2 P1 R0.5",
            _ => "G68 X0 Y0 R0.5",
        };
        for place in [0, 1, 3] {
            let mut at = [""; 5];
            at[place] = what;
            let (verdicts, alarm) = second_run(family, at);
            if (family, place) == (Family::LinuxCnc, 0) {
                assert_eq!(codes(&verdicts[1]), ["rotation_active"]);
            } else {
                assert!(alarm.is_some(), "{family:?} at {place}");
                assert_eq!(verdicts.len(), 1, "{family:?} at {place}: the taught one");
            }
        }
    }
}

/// The gauging feed is another one than when it was taught: set once and forgotten.
#[test]
fn another_feed_is_named() {
    for family in FAMILIES {
        let what = match family {
            Family::LinuxCnc => "#<_UMI_SLOW>=100",
            _ => "#113=100.",
        };
        for (place, balls) in [(1, 4), (4, 1)] {
            let mut at = [""; 5];
            at[place] = what;
            let (verdicts, alarm) = second_run(family, at);
            assert_eq!(alarm, None, "{family:?}");
            let named = vec!["feed_changed"; balls];
            assert_eq!(codes(&verdicts[1]), named, "{family:?} at {place}");
        }
    }
}

/// Where the operator's override stands plays no part in a gauging touch, nor in what is printed; it
/// acts on all other moves before and behind one, also where the program holds the feed hold off.
#[test]
fn an_override_changes_no_gauging_touch() {
    for family in FAMILIES {
        let held_off = match family {
            Family::LinuxCnc => "",
            _ => "#3004=1",
        };
        let text = body(family, 2, "", ["", held_off, "", "", ""]);
        let errors = "[control]\nskip_delay_ms = [4.0, 4.0]\n";
        let scene = scene(TAUGHT) + errors;
        let due = run_text(family, &scene, &text);
        let feeds = |ran: &Ran| -> Vec<f64> {
            let hits = ran.machine.hits().iter();
            hits.map(|hit| hit.feed_mm_per_min).collect()
        };
        for percent in [20.0, 150.0] {
            let ran = run_overridden(family, &scene, &text, percent);
            assert!(ran.alarm.is_none(), "{family:?}: {:?}", ran.alarm);
            assert_eq!(feeds(&ran).len(), feeds(&due).len(), "{family:?}");
            for (is, due) in feeds(&ran).iter().zip(feeds(&due)) {
                let expected = match due {
                    50.0 => 50.0,
                    fast => fast * percent / 100.0,
                };
                assert!((is - expected).abs() < 1e-9, "{family:?}: {is} {expected}");
            }
            let printed = |ran: &Ran| String::from_utf8_lossy(ran.bytes()).into_owned();
            assert_eq!(printed(&ran), printed(&due), "{family:?}");
        }
    }
}

/// A shift that was active when the part was taught stops that run too: nothing is taught.
#[test]
fn nothing_is_taught_under_a_shift() {
    for family in FAMILIES {
        for what in ["G52 X1.", "G92 Y-79."] {
            let text = body(family, 1, "1", [what, "", "", "", ""]);
            let taught = run_text(family, &scene(TAUGHT), &text);
            let clean = run_text(family, &scene(MOVED), &body(family, 2, "", [""; 5]));
            let verdicts = judged(&[&taught, &clean]);
            assert!(
                verdicts.iter().all(|of| !of.ok),
                "{family:?} {what}: {verdicts:?}"
            );
            let last = codes(verdicts.last().unwrap());
            assert!(last.contains(&"no_reference"), "{family:?}: {last:?}");
        }
    }
}

/// Whatever changes behind O8811 is an alarm before the next hit, and no verdict follows: also
/// where each ball is found all the same.
#[test]
fn what_changes_while_it_is_probed_is_an_alarm() {
    let cases = [
        ("G52 X0.4", "G52 OR G92 CHANGED"),
        ("G52 Z0.01", "G52 OR G92 CHANGED"),
        ("G92 X[#5041+0.5]", "G52 OR G92 CHANGED"),
        ("G10 L2 P1 Y1.3", "WORK OFFSET CHANGED"),
        ("#5221=0.002", "WORK OFFSET CHANGED"),
        ("#5201=-0.4", "EXTERNAL OFFSET CHANGED"),
        ("G55", "OTHER WORK OFFSET NOW"),
        // The same coordinates by two changes.
        ("#5201=0.5\n#5221=-0.5", "WORK OFFSET CHANGED"),
        ("G10 L10 P1 R0.3\nG43 H1", "TOOL LENGTH CHANGED"),
    ];
    for family in FAMILIES {
        for (number, (what, said)) in cases.iter().enumerate() {
            let mut what = (*what).to_owned();
            let mut said = *said;
            match family {
                Family::LinuxCnc if what.contains("#5201") => continue,
                Family::LinuxCnc => {
                    what = what
                        .replace("#5041", "#5420")
                        .replace("L10 P1 R", "L1 P1 Z")
                        .replace("G43 H1", "G43.1 Z0.3");
                }
                // G52 is the external offset there.
                Family::Haas if what.starts_with("G52") => said = "EXTERNAL OFFSET CHANGED",
                _ => {}
            }
            // Behind O8811, or before the second, the third, the last ball.
            let place = 1 + number % 4;
            for place in [1, place] {
                let mut at = [""; 5];
                at[place] = &what;
                let (verdicts, alarm) = second_run(family, at);
                assert_eq!(alarm.as_deref(), Some(said), "{family:?} {what} at {place}");
                assert_eq!(verdicts.len(), 1, "{family:?} {what} at {place}");
                assert!(verdicts[0].ok, "the taught one");
            }
        }
    }
}

/// Whoever prints blocks of points with macros of their own may look as well.
#[test]
fn others_may_look_as_well() {
    for family in FAMILIES {
        let (start, look) = match family {
            Family::LinuxCnc => ("O<UMI_START> CALL", "O<UMI_LOOK> CALL"),
            _ => ("G65 P8811", "G65 P8819"),
        };
        let begin = "G21 G90 G54\nG0 X1. Y2. Z100.\n";
        let before = run_text(family, &scene(TAUGHT), &format!("{begin}{look}\n"));
        before.refused("COMES FIRST");
        let text = format!("{begin}{start}\n{look}\nG0 X20.\n{look}\nG92 X20.1\n");
        let ran = run_text(family, &scene(TAUGHT), &text);
        assert_eq!(ran.alarm, None, "{family:?}");
        let ran = run_text(family, &scene(TAUGHT), &format!("{text}{look}\n"));
        ran.refused("G52 OR G92 CHANGED");
    }
}

/// Offsets that are no whole steps of the control, and a long probe, are no shift.
#[test]
fn rounding_is_no_shift() {
    for family in FAMILIES {
        for (x, z, length) in [(0.0005, -0.1234, 81.5), (-217.6543, 0.0004, 120.0567)] {
            let (lengths, start) = match family {
                Family::LinuxCnc => (format!("G43.1 Z{length}"), "O<UMI_START> CALL"),
                _ => (format!("G10 L10 P1 R{length}\nG43 H1"), "G65 P8811"),
            };
            let call = match family {
                Family::LinuxCnc => "O<UMI_SPHERE> CALL [20] [1] [60]",
                _ => "G65 P8820 D20. B1. Q60.",
            };
            let text = format!(
                "G21 G90 G54 G94\n{lengths}\nG10 L2 P1 X{x} Y0.0003 Z{z}\n{start}\nG0 Z[100-[{z}]]\n\
                 G0 X[-100-[{x}]] Y-80.\n{call}\n"
            );
            let scene = format!("[probe]\nlength_mm = {length}\n{}", scene(TAUGHT));
            let ran = run_text(family, &scene, &text);
            assert_eq!(ran.alarm, None, "{family:?} {x} {z}");
        }
    }
}
