//! What a control would complain about, found without running.

use super::mock::fanuc;
use crate::nc::{Alarm, ControlFamily, ControlSettings, Severity, check};

fn found(text: &str) -> Vec<Alarm> {
    check(&format!("%\nO1\n{text}\nM30\n%\n"), &fanuc())
}

/// One complaint: its severity, its line, a part of what it says.
fn only(text: &str, severity: Severity, line: u32, part: &str) {
    let found = found(text);
    assert_eq!(found.len(), 1, "{text}: {found:?}");
    assert_eq!(
        (found[0].severity, found[0].line),
        (severity, line),
        "{text}"
    );
    assert!(found[0].message.contains(part), "{text}: {}", found[0]);
}

/// A program without fault.
#[test]
fn nothing() {
    let text = "G21G17G40G49G80G90\nN10#1=[#2+SIN[30]]*3\nIF[#1EQ#0]GOTO10\nG65P2A1.\nG0X#1\n\
                WHILE[#1LT3]DO1\nEND1\nG31Z-1.F50\nPOPEN\nDPRNT[X#1[53]]\nPCLOS\nM30\nO2\nM99";
    assert_eq!(found(text), []);
}

/// Each kind of alarm.
#[test]
fn alarms() {
    use Severity::Alarm;
    only("G12.3", Alarm, 3, "G12.3 is not a code");
    only("GOTO99", Alarm, 3, "no block N99");
    only("WHILE[#1EQ1]DO1", Alarm, 3, "no END1");
    only("END2", Alarm, 3, "END2");
    only("GOTO5\nDO1\nN5\nEND1", Alarm, 3, "inside a loop");
    only("#1=[2+3", Alarm, 3, "`]` expected");
    only("IF[#1]GOTO1\nN1", Alarm, 3, "a condition compares");
    only("DPRNT[X#1[55]]", Alarm, 3, "eight places");
    only("G0E1.", Alarm, 3, "no address E");
    only("G0X1.X2.", Alarm, 3, "twice");
    only("G41X1.", Alarm, 3, "not interpreted");
    only("G65A1.", Alarm, 3, "need P");
    only("G0 X1. (OPEN", Alarm, 3, "not closed");
    only("#1=2 G0", Alarm, 3, "stands alone");
    only("G1G0X1.", Alarm, 3, "one block");
    for two in [
        "G90X1.G91Y2.",
        "G20G21",
        "G17G19",
        "G98G99",
        "G93G94",
        "G54G55",
        "G81G80X1.Z1.R1.",
    ] {
        only(two, Alarm, 3, "in one block");
    }
    only("G0X1.G91", Alarm, 3, "G91 behind a length");
    assert_eq!(check("%\n%\n", &fanuc()).len(), 1);
}

/// Each kind of warning.
#[test]
fn warnings() {
    use Severity::Warning;
    only("M98P20007", Warning, 3, "O0007 is not in this text");
    only("M198P2", Warning, 3, "external device");
    only("G65P7", Warning, 3, "O0007 is not in this text");
    only("POPEN\nDPRNT[X#1[54]]\nPCLOS", Warning, 4, "nine places");
    only("POPEN\nDPRNT[X\nPCLOS", Warning, 4, "not closed");
    only("g0x1.", Warning, 3, "small letters");
    let found = check("O1\nG0X1.\n", &fanuc());
    assert_eq!(found.len(), 1);
    assert!(found[0].message.contains("no M30"));
    let found = check(
        "o<a> call [1]\nM2\n",
        &ControlSettings::of(ControlFamily::LinuxCnc),
    );
    assert_eq!(found.len(), 1, "{found:?}");
    assert_eq!(found[0].severity, Warning);
}

/// What one control has another does not.
#[test]
fn dialects() {
    let of = |dialect, text: &str| check(text, &ControlSettings::of(dialect)).len();
    assert_eq!(of(ControlFamily::Haas, "O1\nG154P2\nG103P1\nM30"), 0);
    assert_eq!(of(ControlFamily::Fanuc, "O1\nG154P2\nG103P1\nM30"), 2);
    assert_eq!(of(ControlFamily::LinuxCnc, "G38.2 Z-1 F10\n#<a>=1\nM2"), 0);
    assert_eq!(of(ControlFamily::Grbl, "G38.2Z-1F10\nG54\nM30"), 0);
    assert_eq!(of(ControlFamily::Grbl, "G81X1R1Z1F1\n#1=2\nM30"), 2);
    assert_eq!(
        of(
            ControlFamily::Mitsubishi,
            "O1\nG68.1X0Y0Z0I0J0K1R5.\nG69.1\nM30"
        ),
        0
    );
}

/// What is wrong with values that the text alone gives.
#[test]
fn values() {
    use Severity::{Alarm, Warning};
    only("G31F50.", Alarm, 3, "G31 needs X, Y or Z");
    only("G10L2P99X1.", Alarm, 3, "from 0 to 6");
    only("G54.1P999", Alarm, 3, "from 1 to 300");
    only("G54.4P8", Alarm, 3, "from 0 to 7");
    only("#1=1/0", Alarm, 3, "division by zero");
    only("#1=#2+SQRT[-1]", Alarm, 3, "SQRT of a negative");
    only("#0=1", Alarm, 3, "#0 is always null");
    only("#5061=1", Alarm, 3, "only be read");
    only("IF[#1EQ0]THEN#5061=1", Alarm, 3, "only be read");
    only("#1=#4999", Alarm, 3, "no variable of this control");
    only("M77", Warning, 3, "M77 is the machine builder's own");
    let long = format!("G1 X1 F{}\nM2\n", "9".repeat(400));
    let found_in_linuxcnc = check(&long, &ControlSettings::of(ControlFamily::LinuxCnc));
    assert_eq!(found_in_linuxcnc.len(), 1, "{found_in_linuxcnc:?}");
    assert!(found_in_linuxcnc[0].message.contains("too large"));
    assert_eq!(
        found("#3000=1(STOP)\n#1100=1\n#5221=1.\nM3S100M8\n#[#1]=2\nG31X#1F9."),
        []
    );
}

/// The line for printing, as the blocks of a main program stand.
#[test]
fn printing() {
    use Severity::Warning;
    only(
        "DPRNT[X]\nDPRNT[Y]\nPOPEN\nPCLOS",
        Warning,
        3,
        "no POPEN before it",
    );
    only("POPEN\nDPRNT[X]", Warning, 3, "no PCLOS behind it");
    // A macro may open and close the line for its caller, a subprogram for neither.
    assert_eq!(found("G65P2\nDPRNT[X]\nG65P2\nM30\nO2\nPOPEN\nM99"), []);
    let haas = check(
        "O1\nDPRNT[X]\nM30",
        &ControlSettings::of(ControlFamily::Haas),
    );
    assert_eq!(haas, []);
}

/// Macros nest four deep, subprograms ten, each for themselves.
#[test]
fn nesting() {
    let chain = |call: &str, count: u32| -> String {
        let rest: String = (2..=count)
            .map(|n| format!("O{n}\n{call}P{}\nM99\n", n + 1))
            .collect();
        format!("{call}P2\nM30\n{rest}O{}\nM99", count + 1)
    };
    assert_eq!(found(&chain("G65", 4)), []);
    only(
        &chain("G65", 5),
        Severity::Warning,
        3,
        "5 macros deep: the control takes 4",
    );
    assert_eq!(found(&chain("M98", 10)), []);
    only(
        &chain("M98", 11),
        Severity::Warning,
        3,
        "11 subprograms deep",
    );
    // A program that calls itself is not followed.
    assert_eq!(found("G65P2\nM30\nO2\nIF[#1EQ1]GOTO1\nG65P2\nN1M99"), []);
}

/// Two programs of one number are an alarm at each of them, and hide nothing else.
#[test]
fn twins() {
    let found = check("O1\nM30\nO1\nG12.3\nM30\n", &fanuc());
    let lines: Vec<_> = found.iter().map(|alarm| alarm.line).collect();
    assert_eq!(lines, [1, 3, 4], "{found:?}");
    assert!(found[0].message.contains("twice"));
}

/// A Fanuc file on a LinuxCNC: what is missing is said.
#[test]
fn fanuc_on_linuxcnc() {
    let found = check("O1040\nM2\n", &ControlSettings::of(ControlFamily::LinuxCnc));
    assert!(
        found[0].message.contains("O1040 has no keyword"),
        "{found:?}"
    );
}
