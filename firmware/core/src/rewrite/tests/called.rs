//! What a program leaves to those that call it or begin it again: offsets, also those that are
//! not in force, modes, G98 and G99. One that would move otherwise the second time is refused.

use std::format;

use super::super::refusal::RewriteRefusal;
use super::super::{RewriteDialect, RewriteSettings, StartModes};
use super::{level, rewritten, settings, turned};

fn two_origins(degrees: f64, shift_mm: [f64; 3]) -> RewriteSettings {
    let mut origins_mm = [None; 6];
    origins_mm[0] = Some([0.0; 3]);
    origins_mm[1] = Some([100.0, 0.0, 0.0]);
    RewriteSettings {
        origins_mm,
        dialect: Some(RewriteDialect::Fanuc),
        ..settings(level(degrees, shift_mm))
    }
}

/// A work offset that is not in force is in force later: an optional block, and a subprogram,
/// leave it as it is.
#[test]
fn offsets_not_in_force_stay() {
    let settings = two_origins(30.0, [3.0, 4.0, 0.1]);
    let reason = |program: &str| {
        rewritten(&settings, program)
            .map(|_| ())
            .map_err(|refused| (refused.line, refused.reason))
    };
    let main = "O1\nG21 G90 G17 G54\nG0 X0. Y0. Z50.\n";
    let optional = format!("{main}/G10 L2 P2 X300. Y0. Z0.\nG55 G0 X10. Y0. Z50.\nM30\n");
    assert_eq!(reason(&optional), Err((4, RewriteRefusal::OptionalMode)));
    // What it already is may be said.
    assert_eq!(reason(&optional.replace("X300.", "X100.")), Ok(()));
    let called = |before: &str, after: &str, sub: &str| {
        format!("{main}{before}M98 P100\n{after}G90 G55 G0 X10. Y0. Z50.\nM30\nO100\n{sub}M99\n")
    };
    assert_eq!(
        reason(&called("", "", "G10 L2 P2 X300.\n")),
        Err((9, RewriteRefusal::SubprogramModes))
    );
    assert_eq!(
        reason(&called("", "", "G91 G10 L2 P2 X50.\nG90\n").replace("P100", "P100 L3")),
        Err((10, RewriteRefusal::SubprogramModes))
    );
    assert_eq!(reason(&called("", "", "G10 L2 P2 X100.\n")), Ok(()));
    // Called before the main program sets an offset that it chooses.
    let chooses = "G55 G0 X10. Y0. Z5.\nG54\n";
    assert_eq!(
        reason(&called("G10 L2 P2 X150.\n", "G10 L2 P2 X300.\n", chooses)),
        Err((10, RewriteRefusal::SubprogramModes))
    );
    assert_eq!(reason(&called("G10 L2 P2 X150.\n", "", chooses)), Ok(()));
    assert_eq!(
        reason(&called("", "G52 X5.\nG52 X0.\n", "G54 G0 X10. Y0. Z5.\n")),
        Ok(())
    );
    // Called again when it is set, before the text comes and behind it.
    let twice = "G10 L2 P2 X300.\nM98 P100\n";
    assert_eq!(
        reason(&called("", twice, chooses)),
        Err((10, RewriteRefusal::SubprogramModes))
    );
    let first = format!("O100\nG90 G21 G17\n{chooses}M99\nO1\n");
    assert_eq!(
        reason(&format!("{first}G21 G90 G54\nM98 P100\n{twice}M30\n")),
        Err((10, RewriteRefusal::SubprogramModes))
    );
    // The frame is settled by what the main program does behind the call.
    let frame = "O1\nG21 G90 G55\nM98 P100\nG54 G0 X0. Y0. Z0.\nM30\nO100\nG0 X1. Y0. Z0.\nM99\n";
    assert_eq!(reason(frame), Err((6, RewriteRefusal::SubprogramModes)));
    assert_eq!(reason(&frame.replace("G54 G0", "G0")), Ok(()));
}

/// M99 of a main program begins it again: with what it began with, or what it says itself.
#[test]
fn a_main_program_begins_again_as_it_began() {
    let turn = two_origins(30.0, [3.0, 4.0, 0.1]);
    let refused = |settings: &RewriteSettings, program: &str| {
        rewritten(settings, program)
            .err()
            .map(|refused| refused.reason)
    };
    let main = "O1\nG21 G90 G17 G54\nG0 X0. Y0. Z50.\nG1 Z-1. F100.\nG0 Z50.\n";
    for (end, is_refused) in [
        ("M99\n", false),
        ("G91 G28 Z0.\nM99\n", false),
        ("G55 G0 X1. Y0.\nG18\nM99\n", false),
        ("G43 H1 Z5.\nM99\n", false),
        ("G52 X50.\nG0 X0. Y0. Z5.\nG52 X0.\nM99\n", false),
        ("G91 G10 L2 P1 X50.\nG90\nM99\n", true),
        ("G91 G10 L2 P1 X50.\nG90\n/M99\nM30\n", true),
        ("G91 G10 L2 P1 X50.\nG90\nM30\n", false),
        ("G10 L2 P2 X50.\nM99\n", true),
        ("G52 X50.\nM99\n", true),
        ("G92 X50.\nM99\n", true),
        ("G95\nM99\n", true),
        ("G41 D1\nM99\n", true),
        ("G81 X1. Y1. Z-1. R1.\nM99\n", false),
        ("G81 X1. Y1. Z-1. R1.\nG99 G80\nM99\n", true),
    ] {
        for number in ["O1\n", ""] {
            let program = format!("{main}{end}").replacen("O1\n", number, 1);
            assert_eq!(
                refused(&turn, &program),
                is_refused.then_some(RewriteRefusal::SubprogramModes),
                "{program}"
            );
        }
    }
    // Set at the beginning, an offset is the same each time; not if it is a step.
    let set = "O1\nG21 G90 G10 L2 P2 X50.\nG54 G0 X0. Y0. Z50.\nM99\n";
    assert_eq!(refused(&turn, set), None);
    assert_eq!(
        refused(
            &turn,
            &set.replace("G90 G10 L2 P2 X50.", "G91 G10 L2 P2 X50.\nG90")
        ),
        Some(RewriteRefusal::SubprogramModes)
    );
    // Not said at the beginning.
    let plane = "O1\nG21 G90 G54\nG0 X0. Y0. Z0.\nG2 X10. R6. F100.\nG18\nM99\n";
    assert_eq!(refused(&turn, plane), Some(RewriteRefusal::SubprogramModes));
    assert_eq!(refused(&turn, &plane.replace("G18\n", "")), None);
    let mut stated = turn.clone();
    stated.start = StartModes::default()
        .with(900)
        .and_then(|modes| modes.with(0))
        .unwrap();
    let distance = "O1\nG21 G17 G54\nG0 X0. Y0. Z50.\nG91 G28 Z0.\nM99\n";
    assert_eq!(
        refused(&stated, distance),
        Some(RewriteRefusal::SubprogramModes)
    );
    assert_eq!(refused(&stated, &distance.replace("G17", "G90")), None);
    let motion = "O1\nG21 G90 G54\nX0. Y0. Z50.\nG1 Z0. F9.\nM99\n";
    assert_eq!(
        refused(&stated, motion),
        Some(RewriteRefusal::SubprogramModes)
    );
    assert_eq!(refused(&stated, &motion.replace("X0.", "G0 X0.")), None);
}

/// What the first program of the file takes for granted, it leaves, and its callers have.
#[test]
fn a_first_subprogram_leaves_what_it_took_for_granted() {
    let turn = two_origins(30.0, [3.0, 4.0, 0.1]);
    let program = "O100\nG90 G21 G0 X0. Y0. Z0.\nG2 X10. I5. J0. F100.\nG18 G0 X0. Y0. Z10.\n\
                   M99\nO1\nG90 G21 G18 G54\nM98 P100\nG0 Z50.\nG17\nM30\n";
    let refused = rewritten(&turn, program).unwrap_err();
    assert_eq!(
        (refused.line, refused.reason),
        (5, RewriteRefusal::SubprogramModes)
    );
    // An offset that it sets is not yet set where the main program begins.
    let sets = "O100\nG90 G21 G17 G10 L2 P2 X300.\nG54 G0 X0. Y0. Z0.\nM99\n\
                O1\nG90 G21 G17 G55 G0 X0. Y0. Z0.\nM98 P100\nM30\n";
    let refused = rewritten(&turn, sets).unwrap_err();
    assert_eq!(
        (refused.line, refused.reason),
        (5, RewriteRefusal::SubprogramModes)
    );
}

/// Under G98 and under G99 a hole ends elsewhere: a subprogram that drills is called under one of
/// them, or says it itself. One that does not drill may be called under both.
#[test]
fn holes_end_where_the_caller_says() {
    let leaning = settings(turned([0.3, 0.0, 0.0], [0.0; 3]));
    let reason = |program: &str| {
        rewritten(&leaning, program)
            .map(|_| ())
            .map_err(|refused| (refused.line, refused.reason))
    };
    let modes = RewriteRefusal::SubprogramModes;
    let program = |first: &str, second: &str, sub: &str| {
        format!(
            "O1\nG21 G90 G17 G54\nG0 X0. Y0. Z50.\n{first}\nM98 P100\n{second}\n\
             G0 X0. Y0. Z50.\nM98 P100\nM30\nO100\n{sub}\nM99\n"
        )
    };
    let drills = "G0 X0. Y0. Z20.\nG81 X5. Y0. R2. Z-5. F100.\nG80";
    for (first, second, sub, wanted) in [
        ("G98", "G98", drills, Ok(())),
        ("G98", "G99", "G0 X0. Y0. Z20.", Ok(())),
        ("G98", "G99", drills, Err((12, modes))),
        ("G99", "G98", drills, Err((12, modes))),
        // It leaves another than it found.
        ("G98", "G98", "G99", Err((12, modes))),
        ("G98", "G98", "G99\nG98", Ok(())),
        ("G98", "G99", "G99", Err((11, modes))),
        // What it calls may drill.
        ("G98", "G99", "M98 P200", Err((11, modes))),
    ] {
        let program = program(first, second, sub) + "O200\nM99\n";
        assert_eq!(reason(&program), wanted, "{program}");
    }
    // The same where its text comes first: it names its own places.
    let first = |says: &str, call: &str| {
        format!(
            "O100\nG21 G90 G17 {says}\n{drills}\nM99\nO1\nG21 G90 G17 G54 {call}\n\
             G0 X0. Y0. Z50.\nM98 P100\nG0 X0. Y0. Z50.\nM30\n"
        )
    };
    for (says, call, wanted) in [
        ("G98", "G98", Ok(())),
        ("G98", "G99", Err((10, modes))),
        ("G99", "G99", Ok(())),
        // Nobody has said it where the holes are written.
        ("", "G98", Err((4, RewriteRefusal::NoReturn))),
        ("G99", "G98", Err((10, modes))),
    ] {
        let program = first(says, call);
        assert_eq!(reason(&program), wanted, "{program}");
    }
    // A cycle that goes on behind the return.
    let goes_on = first("G98", "").replace("G80\nM99", "M99");
    assert_eq!(reason(&goes_on), Err((9, modes)));
}
