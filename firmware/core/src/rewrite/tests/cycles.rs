//! Canned cycles: kept, repeated, written out.

use std::vec::Vec;

use super::super::refusal::RewriteRefusal;
use super::{level, rewritten, settings, text, turned};

/// Holes turn, heights move along.
#[test]
fn cycles_stay_where_the_tool_stays() {
    assert_eq!(
        text(
            level(90.0, [0.0, 0.0, -2.0]),
            "G21 G90 G0 X0. Y0. Z20.\nG98 G81 X10. Y0. Z-5. R2. F100\nX20.\nG80\nG0 X0. Z30.\n"
        ),
        "G21 G90 G0 X0. Y0. Z18.\nG98 G81 X0. Y10. Z-7. R0. F100\nX0. Y20.\nG80\nG0 X0. Y0. Z28.\n"
    );
}

/// A row of holes in increments: each is rounded from the start.
#[test]
fn rows_are_written_hole_by_hole() {
    assert_eq!(
        text(
            level(45.0, [0.0; 3]),
            "G21 G90 G0 X0. Y0. Z20.\nG91 G99 G81 X1. Z-7. R-18. K4 F100\nG80\n"
        ),
        "G21 G90 G0 X0. Y0. Z20.\nG91 G99 G81 X0.707 Y0.707 Z-7. R-18. F100\n\
         X0.707 Y0.707\nX0.707 Y0.707\nX0.707 Y0.707\nG80\n"
    );
}

/// A leaning drill is written out: over the hole, to R, down, back.
#[test]
fn leaning_cycles_are_written_out() {
    let lean = turned([0.0, 0.1, 0.0], [0.0; 3]);
    assert_eq!(
        text(
            lean,
            "G21 G90 G0 X0. Y0. Z100.\nN7 G99 G82 X10. Y0. Z-50. R50. P500 F100 (HOLE)\nG80\n"
        ),
        // sin 0.1 degrees is 0.001745.
        "G21 G90 G0 X0.175 Y0. Z100.\nN7 G99 G0 X10.175 Y0. Z99.982 F100 (HOLE)\n\
         X10.087 Z49.982\nG1 X9.913 Z-50.017\nG4 P500\nG0 X10.087 Z49.982\nG80\n"
    );
    let (made, _) = rewritten(
        &settings(lean),
        "G21 G90 G0 X0. Y0. Z10.\nG98 G83 X1. Z-5. R1. Q4. F50\nX2.\nG80\n",
    )
    .unwrap();
    // Down 4, out, back to 1 above, down the rest.
    assert_eq!(made.matches("G1").count(), 4, "{made}");
    // Tapping needs its spindle.
    let refused = rewritten(
        &settings(lean),
        "G21 G90 G0 X0. Y0. Z10.\nG84 X1. Z-5. R1. F50\n",
    )
    .unwrap_err();
    assert_eq!(
        (refused.line, refused.reason),
        (2, RewriteRefusal::TiltedCycle(840))
    );
}

/// A word of the cycle in a block that names no place: controls differ in what they do.
#[test]
fn words_of_a_cycle_alone_are_refused() {
    for (line, letter) in [("Q3.", 'Q'), ("R5.", 'R'), ("P10", 'P'), ("K2", 'K')] {
        for transform in [level(20.0, [0.0; 3]), turned([0.5, 0.0, 0.0], [0.0; 3])] {
            let program = std::format!(
                "G21 G90 G0 X0. Y0. Z10.\nG99 G83 X1. Z-5. R1. Q4. F50\n{line}\nG80\n"
            );
            let refused = rewritten(&settings(transform), &program).unwrap_err();
            assert_eq!(
                (refused.line, refused.column, refused.reason),
                (3, 1, RewriteRefusal::Meaningless(letter)),
            );
        }
    }
}

/// What one block becomes has an end: pecks count over all its holes.
#[test]
fn pecks_of_many_holes_are_bounded() {
    let lean = settings(turned([0.0, 0.1, 0.0], [0.0; 3]));
    let program = |holes: u32| {
        std::format!("G21 G90 G0 X0. Y0. Z10.\nG91 G83 X1. Z-50. R0. Q0.1 K{holes} F50\nG80\n")
    };
    // 500 pecks each.
    let (made, _) = rewritten(&lean, &program(20)).unwrap();
    assert!(made.lines().count() > 20_000, "{}", made.lines().count());
    let refused = rewritten(&lean, &program(21)).unwrap_err();
    assert_eq!(
        (refused.line, refused.reason),
        (2, RewriteRefusal::CycleDepth)
    );
}

/// Holes that are written out end in G0: what goes on without a code gets its own again.
#[test]
fn a_motion_goes_on_behind_written_out_holes() {
    let made = text(
        turned([0.0, 0.1, 0.0], [0.0; 3]),
        "G21 G90 G0 X0. Y0. Z10.\nG1 X1. F50\nG98 G81 X2. Z-5. R1.\nG80\nX9. Z10.\nX8.\n",
    );
    let behind: Vec<&str> = made.lines().skip_while(|line| *line != "G80").collect();
    assert!(behind[1].starts_with("G1 X9."), "{made}");
    assert!(behind[2].starts_with("X8."), "{made}");
}
