//! A program for one run begins with the comparison of it.

use std::string::String;
use std::vec::Vec;

use umi_protocol::job::Dialect;

use super::{level, rewritten, settings, turned};
use crate::correction::RunCheck;
use crate::registration::RigidTransform;
use crate::rewrite::{
    MAX_AT_ONCE, MAX_LINE, ProgramIdentity, RewriteRefusal, RewriteSettings, Rewriter,
};

fn of_run(transform: RigidTransform, dialect: Dialect) -> RewriteSettings {
    RewriteSettings {
        run: RunCheck::of(dialect, 531, 17),
        ..settings(transform)
    }
}

const PROGRAM: &str = "%\nO1234(PART)\n(A)\nG90 G21 G0 X1.\nG1 Y2. F100.\nM30\n%\n";
const MOVED: &str = "G90 G21 G0 X2.\nG1 Y2. F100.\nM30\n%\n";
const THEN: &str = "IF[#531NE17]THEN#3000=2(UMI PROGRAM OF RUN 17)\n";

/// Behind the program's number and before anything else, once.
#[test]
fn it_begins_with_the_run() {
    let shift = level(0.0, [1.0, 0.0, 0.0]);
    let goto = "IF[#531EQ17]GOTO7\n#3000=2(UMI PROGRAM OF RUN 17)\nN7\n";
    let linuxcnc = "o531 if [#531 NE 17]\n(ABORT, UMI PROGRAM OF RUN 17)\no531 endif\n";
    for (dialect, check) in [
        (Dialect::G10G68, THEN),
        (Dialect::G68ThreeD, THEN),
        (Dialect::FanucSettingError, THEN),
        (Dialect::Variables, THEN),
        (Dialect::Haas, THEN),
        (Dialect::MazakSettingError, goto),
        (Dialect::MitsubishiSettingError, goto),
        (Dialect::LinuxCnc, linuxcnc),
    ] {
        // The header stands where it stood; its lines are taken out here.
        let (text, _) = rewritten(&of_run(shift, dialect), PROGRAM).unwrap();
        assert_eq!(text, ["%\nO1234(PART)\n(A)\n", check, MOVED].concat());
    }
    for dialect in Dialect::ALL {
        let compares = crate::correction::dialect::programs_compare_runs(dialect);
        assert_eq!(RunCheck::of(dialect, 531, 17).is_some(), compares);
    }
    // The part that was taught moves by nothing, and belongs to its run as well.
    let (text, _) = rewritten(&of_run(level(0.0, [0.0; 3]), Dialect::Haas), PROGRAM).unwrap();
    let still = PROGRAM.replace("(A)\n", &["(A)\n", THEN].concat());
    assert_eq!(text, still);
    // Without a run nothing is compared.
    let (text, _) = rewritten(&settings(shift), PROGRAM).unwrap();
    assert_eq!(text, ["%\nO1234(PART)\n(A)\n", MOVED].concat());
}

/// Line ends are the program's own.
#[test]
fn its_lines_end_as_the_others() {
    let program = PROGRAM.replace('\n', "\r\n");
    let (text, _) = rewritten(
        &of_run(level(0.0, [1.0, 0.0, 0.0]), Dialect::Haas),
        &program,
    )
    .unwrap();
    assert!(text.contains(&THEN.replace('\n', "\r\n")), "{text}");
    assert_eq!(text.matches('\n').count(), text.matches("\r\n").count());
}

/// Whichever program of the file the control begins with: one that another calls needs none.
#[test]
fn each_program_that_nobody_has_called_begins_with_it() {
    let program = "%\nO1\nG90 G0 X1. Y1. Z1.\nM98 P2\nG90 G0 X1. Y1. Z1.\nM30\n\
                   O2\nG91 G0 X1.\nX-1.\nG90\nM99\nO3\nG90 G0 X1.\nM30\n%\n";
    let (text, _) =
        rewritten(&of_run(level(0.0, [1.0, 0.0, 0.0]), Dialect::Haas), program).unwrap();
    assert_eq!(text.matches(THEN).count(), 2, "{text}");
    assert!(
        text.starts_with(&["%\nO1\n", THEN, "G90"].concat()),
        "{text}"
    );
    assert!(text.contains(&["O3\n", THEN, "G90"].concat()), "{text}");
}

/// Before the number the comparison would be the number of another program: `N7` on tape.
#[test]
fn a_number_that_shares_its_block_is_refused() {
    let shift = level(0.0, [1.0, 0.0, 0.0]);
    let program = "%\nO1 G90 G21\nG0 X1.\nM30\n%\n";
    let refused = rewritten(&of_run(shift, Dialect::Haas), program).unwrap_err();
    assert_eq!((refused.line, refused.column), (2, 1));
    assert_eq!(refused.reason, RewriteRefusal::NumberShares);
    assert!(rewritten(&settings(shift), program).is_ok());
}

/// What comes out at once has room where it is kept: header, comparison, the longest line.
#[test]
fn the_most_at_once_is_what_it_says() {
    for dialect in [Dialect::Haas, Dialect::MazakSettingError, Dialect::LinuxCnc] {
        let how = RewriteSettings {
            run: RunCheck::of(dialect, 99_999, u32::MAX),
            original: Some(ProgramIdentity {
                crc32: u32::MAX,
                bytes: u64::from(u32::MAX),
            }),
            source: "A".repeat(96).parse().unwrap(),
            ..settings(turned([-0.1, -0.2, -170.0], [-9999.9, -9999.9, -9999.9]))
        };
        let line: String = ["G90G0X1Y1Z1M3", "(", &"A".repeat(MAX_LINE - 15), ")"].concat();
        assert_eq!(line.len(), MAX_LINE);
        let mut most = 0;
        let mut rewriter = Rewriter::new(&how).unwrap();
        let program: Vec<u8> = ["O1\r\n", &line, "\r\nM30\r\n"].concat().into_bytes();
        let mut rest = program.as_slice();
        while !rest.is_empty() {
            let mut came = 0;
            let progress = rewriter
                .push_line(rest, &mut |bytes| came += bytes.len())
                .unwrap();
            rest = &rest[progress.taken..];
            most = most.max(came);
        }
        assert!(most <= MAX_AT_ONCE, "{dialect:?}: {most}");
    }
}

/// What was rewritten for a run and is rewritten again: the comparison stays, or that of the new
/// run takes its place.
#[test]
fn again_it_stays_or_is_renewed() {
    let shift = level(0.0, [1.0, 0.0, 0.0]);
    for dialect in [Dialect::Haas, Dialect::MazakSettingError, Dialect::LinuxCnc] {
        let header = RewriteSettings {
            original: Some(ProgramIdentity { crc32: 7, bytes: 9 }),
            again: true,
            ..of_run(shift, dialect)
        };
        for eol in ["\n", "\r\n"] {
            let program = PROGRAM.replace('\n', eol);
            let again = |settings: &RewriteSettings, text: &str| {
                let mut out = Vec::new();
                let mut sink = |bytes: &[u8]| out.extend_from_slice(bytes);
                let mut rewriter = Rewriter::new(settings).unwrap();
                rewriter.push(text.as_bytes(), &mut sink).unwrap();
                let summary = rewriter.finish(&mut sink).unwrap();
                (String::from_utf8(out).unwrap(), summary)
            };
            let (once, first) = again(&header, &program);
            assert_eq!(first.earlier_run, None);
            let kept = RewriteSettings {
                run: None,
                ..header.clone()
            };
            let (twice, second) = again(&kept, &once);
            assert_eq!(second.earlier_run, Some(17));
            assert_eq!(RunCheck::in_text(&twice), header.run, "{twice}");
            assert!(twice.contains("X3."), "{twice}");
            let renewed = RewriteSettings {
                run: RunCheck::of(dialect, 531, 18),
                ..header.clone()
            };
            let (twice, second) = again(&renewed, &once);
            assert_eq!(second.earlier_run, Some(17));
            assert_eq!(twice.matches("UMI PROGRAM OF RUN").count(), 1, "{twice}");
            assert_eq!(RunCheck::in_text(&twice), renewed.run, "{twice}");
            assert_eq!(twice.matches("(RUN COMPARED ANEW)").count(), 1, "{twice}");
            let labels = twice.lines().filter(|line| line.trim() == "N7").count();
            assert_eq!(labels, usize::from(dialect == Dialect::MazakSettingError));
        }
    }
}
