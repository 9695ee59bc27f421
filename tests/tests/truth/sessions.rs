//! The reference sessions as bytes, in every dress that controls give them and
//! with every kind of damage, through receiver and job.
//!
//! Two things are shown: dress changes nothing (the same verdicts and the same
//! bits of every figure), and damage is named and never corrected through.

use umi_core::brain::{Brain, Output};
use umi_core::units::Micros;
use umi_protocol::fault::Fault;
use umi_protocol::feature::FeatureResult;
use umi_protocol::verdict::Verdict;

const SESSION_A: &str = include_str!("../../reference/sessions/session_a.txt");
const SESSION_B: &str = include_str!("../../reference/sessions/session_b.txt");

#[derive(Default)]
struct Seen {
    features: Vec<FeatureResult>,
    verdicts: Vec<Verdict>,
    faults: Vec<Fault>,
}

/// A whole capture through the brain with the example job.
fn run(bytes: &[u8]) -> Seen {
    let job = toml::from_str(include_str!("../../../examples/three-spheres.toml"))
        .expect("the example job is good");
    let mut brain = Brain::new(job).expect("the example job is good");
    let mut seen = Seen::default();
    let mut take = |output: Output<'_>| match output {
        Output::Feature(feature) => seen.features.push(feature.clone()),
        Output::Verdict(verdict) => seen.verdicts.push(verdict.clone()),
        Output::Fault(fault) => seen.faults.push(fault.clone()),
        Output::Line(_) | Output::Request(_) | Output::Hit(_) | Output::Taught(_) => {}
    };
    brain.bytes(Micros(1), bytes, &mut take);
    brain.input_ended(Micros(2), &mut take);
    for verdict in &seen.verdicts {
        assert_eq!(verdict.ok, verdict.reasons.is_empty());
        assert!(verdict.ok || verdict.correction.is_none(), "{verdict:?}");
    }
    seen
}

impl Seen {
    /// The latest verdict on each setup: "OK" or its reasons.
    fn last_verdicts(&self) -> Vec<String> {
        let setups = self
            .verdicts
            .iter()
            .map(|v| v.setup)
            .max()
            .map_or(0, |p| p + 1);
        let latest = |setup| self.verdicts.iter().rfind(|v| v.setup == setup);
        (0..setups)
            .map(|setup| match latest(setup) {
                Some(verdict) if verdict.ok => "OK".to_owned(),
                Some(verdict) => {
                    let codes = verdict.reasons.iter().map(|r| r.reason.code());
                    codes.collect::<Vec<_>>().join(" ")
                }
                None => "none".to_owned(),
            })
            .collect()
    }

    fn fault_codes(&self) -> Vec<&'static str> {
        let mut codes: Vec<_> = self.faults.iter().map(|f| f.code().as_str()).collect();
        codes.sort_unstable();
        codes.dedup();
        codes
    }
}

const FIVE_OK: [&str; 5] = ["OK"; 5];

// --- dress

fn even_parity(text: &str) -> Vec<u8> {
    text.bytes()
        .map(|b| if b.count_ones() % 2 == 1 { b | 0x80 } else { b })
        .collect()
}

/// EIA RS-244, from the tables of letters and digits; LF becomes EOB.
fn eia(text: &str) -> Vec<u8> {
    const DIGITS: [u8; 10] = [0x20, 0x01, 0x02, 0x13, 0x04, 0x15, 0x16, 0x07, 0x08, 0x19];
    let letter = |c: u8| match c {
        b'S' => 0x32,
        b'P' => 0x57,
        b'H' => 0x68,
        b'E' => 0x75,
        b'R' => 0x49,
        _ => panic!("not in these sessions: {c}"),
    };
    text.bytes()
        .filter(|b| *b != b'\r')
        .map(|b| match b {
            b'0'..=b'9' => DIGITS[usize::from(b - b'0')],
            b' ' => 0x10,
            b'.' => 0x6b,
            b'-' => 0x40,
            b'\n' => 0x80,
            other => letter(other),
        })
        .collect()
}

fn lines_end_in(text: &str, end: &str) -> String {
    text.replace("\r\n", "\n").replace('\n', end)
}

/// Every dress of a session, by name.
fn dresses(text: &str) -> Vec<(&'static str, Vec<u8>)> {
    let plain = lines_end_in(text, "\n");
    let spaced = plain.replace('*', " ");
    let mut dresses = vec![
        ("LF", plain.clone().into_bytes()),
        ("CR LF", lines_end_in(text, "\r\n").into_bytes()),
        ("CR", lines_end_in(text, "\r").into_bytes()),
        ("LF CR", lines_end_in(text, "\n\r").into_bytes()),
        ("LF CR CR", lines_end_in(text, "\n\r\r").into_bytes()),
        ("asterisks as blanks", spaced.clone().into_bytes()),
        (
            "ISO even parity",
            even_parity(&lines_end_in(text, "\n\r\r")),
        ),
        ("ISO even parity, blanks", even_parity(&spaced)),
        ("EIA", eia(&spaced)),
        ("no separators", {
            let kept = spaced.lines().filter(|l| !l.trim().is_empty());
            kept.map(|l| format!("{l}\n"))
                .collect::<String>()
                .into_bytes()
        }),
        ("integer part padded behind the sign", {
            plain.replace("*-", "*-   ").into_bytes()
        }),
    ];
    // DC2 and DC4 around every block, as POPEN and PCLOS send them.
    let sessions = plain.replace("SPHERE", "\u{14}\u{12}SPHERE") + "\u{14}";
    dresses.push(("DC codes", sessions.into_bytes()));
    let mut leader = b"\x12\0\0\0\0\0\0%\n".to_vec();
    leader.extend_from_slice(plain.as_bytes());
    leader.extend_from_slice(b"%\n\0\0\0\0\x14");
    dresses.push(("NUL leader and percent lines", leader));
    let flow: Vec<u8> = plain
        .bytes()
        .enumerate()
        .flat_map(|(at, b)| {
            if at % 37 == 5 {
                vec![b, 0x13, 0x11]
            } else {
                vec![b]
            }
        })
        .collect();
    dresses.push(("XOFF and XON inside lines", flow));
    dresses
}

/// Code, parity, line ends, padding, DC codes and flow control change nothing:
/// the same verdicts, and every figure the same to the last bit.
#[test]
fn dress_changes_nothing() {
    for text in [SESSION_A, SESSION_B] {
        let plain = run(text.as_bytes());
        assert_eq!(plain.last_verdicts(), FIVE_OK, "{:?}", plain.faults);
        for (name, bytes) in dresses(text) {
            let seen = run(&bytes);
            assert_eq!(seen.last_verdicts(), FIVE_OK, "{name}: {:?}", seen.faults);
            assert_eq!(seen.features, plain.features, "{name}");
            assert_eq!(seen.verdicts, plain.verdicts, "{name}");
        }
    }
}

/// The clean sessions have nothing to complain of.
#[test]
fn clean_sessions_have_no_faults() {
    for text in [SESSION_A, SESSION_B] {
        assert_eq!(run(text.as_bytes()).faults, []);
    }
}

// --- damage

/// The lines of session A; nine to a block, three blocks to a clamping.
fn lines() -> Vec<String> {
    SESSION_A.lines().map(str::to_owned).collect()
}

const LINES_PER_BLOCK: usize = 9;

/// Session A with lines changed.
fn damaged(change: impl FnOnce(&mut Vec<String>)) -> Seen {
    let mut lines = lines();
    change(&mut lines);
    run(lines
        .iter()
        .map(|l| format!("{l}\n"))
        .collect::<String>()
        .as_bytes())
}

/// Row of a point (from 0) of a block (from 0).
fn row(block: usize, point: usize) -> usize {
    block * LINES_PER_BLOCK + 3 + point
}

/// Asserts that only clamping `setup` is NG, for a reason with this code.
fn only(seen: &Seen, setup: usize, code: &str) {
    let verdicts = seen.last_verdicts();
    assert_eq!(verdicts.len(), 5, "{verdicts:?} {:?}", seen.faults);
    for (at, verdict) in verdicts.iter().enumerate() {
        if at == setup {
            assert!(verdict.contains(code), "{code} in {verdicts:?}");
        } else {
            assert_eq!(verdict, "OK", "{verdicts:?}");
        }
    }
}

/// Any one line lost: header, count or point. Separators may go.
#[test]
fn a_lost_line() {
    for block in 3..15 {
        for line in 0..LINES_PER_BLOCK {
            let seen = damaged(|lines| {
                lines.remove(block * LINES_PER_BLOCK + line);
            });
            match line {
                1 | 8 => assert_eq!(seen.last_verdicts(), FIVE_OK),
                0 => only(&seen, block / 3, "missing_feature"),
                2 => only(&seen, block / 3, "damaged_line"),
                _ => only(&seen, block / 3, "missing_points"),
            }
        }
    }
}

/// Any one character of any point line of a block overwritten with a letter.
#[test]
fn an_overwritten_character() {
    for point in 0..5 {
        for at in 0..lines()[row(7, point)].len() {
            let seen = damaged(|lines| lines[row(7, point)].replace_range(at..=at, "Q"));
            only(&seen, 2, "damaged_line");
            assert!(!seen.faults.is_empty());
        }
    }
}

/// Any one character of any point line of a block lost. A lost separator
/// before a sign or a lost sign can still be read: then other limits decide.
#[test]
fn a_lost_character() {
    for point in 0..5 {
        let line = lines()[row(7, point)].clone();
        for (at, lost) in line.char_indices() {
            let seen = damaged(|lines| {
                lines[row(7, point)].remove(at);
            });
            let verdict = &seen.last_verdicts()[2];
            // A digit that is lost without a trace and by luck stays within
            // all limits must be a digit that means next to nothing.
            if verdict == "OK" {
                assert_eq!(lost, '*', "lost {lost:?} at {at} of {line}");
            }
        }
    }
}

/// Any one digit of any coordinate of a block changed into any other: either
/// the setup is NG, or the change is below what the job's limits promise.
#[test]
fn a_wrong_digit() {
    let mut through = 0;
    for point in 0..5 {
        let line = lines()[row(7, point)].clone();
        for (at, old) in line.char_indices().filter(|(_, c)| c.is_ascii_digit()) {
            for new in ('0'..='9').filter(|c| *c != old) {
                let seen = damaged(|lines| {
                    lines[row(7, point)].replace_range(at..=at, &new.to_string());
                });
                if seen.last_verdicts()[2] != "OK" {
                    continue;
                }
                let decimals = line.len() - at;
                let field_end = line[at..].find('*').map_or(line.len(), |p| at + p);
                let place = field_end - at; // 1 is the last decimal
                let change_mm = f64::from((i32::from(old as u8) - i32::from(new as u8)).abs())
                    * 10f64.powi(i32::try_from(place).unwrap() - 5);
                assert!(
                    change_mm <= 0.05,
                    "{change_mm} mm passed: {line} at {at} ({decimals}) -> {new}"
                );
                through += 1;
            }
        }
    }
    // Micrometres do pass: that is measuring.
    assert!(through > 0);
}

/// Bytes with wrong parity are named, and their lines never used.
#[test]
fn bad_parity() {
    let clean = even_parity(&lines_end_in(SESSION_A, "\n"));
    let start: usize = lines()[..row(7, 1)].iter().map(|l| l.len() + 1).sum();
    for at in start..start + lines()[row(7, 1)].len() {
        let mut bytes = clean.clone();
        bytes[at] ^= 0x01;
        let seen = run(&bytes);
        only(&seen, 2, "damaged_line");
        assert!(
            seen.fault_codes().contains(&"bad_parity"),
            "{:?}",
            seen.faults
        );
    }
}

/// A capture that breaks off anywhere ends NG, or with the setups it had.
#[test]
fn a_capture_that_breaks_off() {
    let whole = SESSION_A.len();
    let per_setup = whole / 5;
    for cut in (0..whole).step_by(61) {
        let verdicts = run(&SESSION_A.as_bytes()[..cut]).last_verdicts();
        assert!(verdicts.len() <= 5);
        let ok = verdicts.iter().filter(|v| *v == "OK").count();
        assert!(ok <= cut / (per_setup - 40) + 1, "{cut}: {verdicts:?}");
        assert!(verdicts.iter().rev().skip(1).all(|v| v == "OK"));
    }
}

/// Points printed twice, exchanged, null, glued; counts that are wrong.
#[test]
fn damage_by_name() {
    let zero = "*0.0000*0.0000*0.0000";
    only(&damaged(|l| l[row(7, 2)] = zero.into()), 2, "null_point");
    let minus = "*-0.0000*0.0000*-0.0000";
    only(&damaged(|l| l[row(7, 2)] = minus.into()), 2, "null_point");
    only(
        &damaged(|l| l[row(7, 2)] = l[row(7, 1)].clone()),
        2,
        "duplicate_point",
    );
    only(
        &damaged(|l| {
            let again = l[row(7, 1)].clone();
            l.insert(row(7, 1), again);
        }),
        2,
        "duplicate_point",
    );
    only(
        &damaged(|l| l.swap(row(7, 1), row(7, 2))),
        2,
        "approach_angle",
    );
    only(
        &damaged(|l| {
            let next = l.remove(row(7, 2));
            l[row(7, 1)].push_str(&next);
        }),
        2,
        "damaged_line",
    );
    only(
        &damaged(|l| l[row(7, 0) - 1] = "4".into()),
        2,
        "wrong_count",
    );
    only(
        &damaged(|l| l[row(7, 0) - 1] = "6".into()),
        2,
        "wrong_count",
    );
    only(
        &damaged(|l| l[row(7, 0) - 1] = "S".into()),
        2,
        "damaged_line",
    );
    only(
        &damaged(|l| l[row(7, 0) - 3] = "SPHRE2".into()),
        2,
        "missing_feature",
    );
    only(
        &damaged(|l| l[row(7, 3)] = l[row(7, 3)].replacen("*", "*1", 1)),
        2,
        "outside_travel",
    );
}

/// A whole block, a whole clamping, or everything printed twice (a program
/// restart prints again what it printed before) moves nothing anywhere.
#[test]
fn printed_again() {
    for block in 0..15 {
        let seen = damaged(|l| {
            let from = block * LINES_PER_BLOCK;
            let again: Vec<_> = l[from..from + LINES_PER_BLOCK].to_vec();
            let at = from + LINES_PER_BLOCK;
            l.splice(at..at, again);
        });
        assert_eq!(seen.last_verdicts(), FIVE_OK, "{block}");
        assert_eq!(seen.features.len(), 15);
    }
    let twice = SESSION_A.repeat(2);
    let seen = run(twice.as_bytes());
    assert_eq!(seen.last_verdicts(), ["OK"; 10]);
}

/// A part program punched on the same port, with text in it that looks like
/// points, is recognised and gives none.
#[test]
fn a_punched_program_is_no_measurement() {
    let plain = "%\nO1050(PROBES 1)\nG31 Y[#2] F#32 (PROBE)\nDPRNT[SPHERE1]\n5\n\
                 *-135.0190*-136.6200*148.6090\nM30\n%\n";
    let with = |program: &str, at: usize| {
        damaged(|lines| {
            let at = at * LINES_PER_BLOCK;
            lines.splice(at..at, program.lines().map(str::to_owned));
        })
    };
    for at in [0, 3, 7, 15] {
        let seen = with(plain, at);
        assert_eq!(seen.last_verdicts(), FIVE_OK, "{at}: {:?}", seen.faults);
        assert_eq!(seen.fault_codes(), ["program_received"]);
    }
    // A block's header ends what seemed a program: that is named, and costs at most the setup
    // that was under way.
    let header = plain.replace("\n5\n", "\nSPHERE1\n5\n");
    let named = ["block_incomplete", "not_understood", "program_unterminated"];
    for (at, least) in [(0, 5), (3, 5), (7, 4), (15, 5)] {
        let seen = with(&header, at);
        let verdicts = seen.last_verdicts();
        let good = verdicts.iter().filter(|said| **said == "OK").count();
        assert!(good >= least, "{at}: {verdicts:?}, {:?}", seen.faults);
        assert_eq!(seen.fault_codes(), named, "{at}");
    }
}

/// Noise between the blocks is named and does no harm.
#[test]
fn noise_between_blocks() {
    let seen = damaged(|lines| {
        lines.insert(6 * LINES_PER_BLOCK, "PART-ABC OP10".into());
        lines.insert(2 * LINES_PER_BLOCK, "CYCLETIME-7200".into());
    });
    assert_eq!(seen.last_verdicts(), FIVE_OK);
    assert_eq!(seen.fault_codes(), ["not_understood"]);
    assert_eq!(seen.faults.len(), 2);
}
