//! The NC program of a planned calibration.

use std::fmt::Write as _;

use super::plan::{PlanQuestion, SensorPlan};

/// What a control reads, and how it says where its axes stand.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ProgramLanguage {
    /// Custom Macro B: `DPRNT`.
    MacroB,
    /// The same with a dwell in `P`, as Haas has it.
    Haas,
    /// LinuxCNC: a file that the program writes.
    LinuxCnc,
    /// GRBL says nothing by itself: it stops at each place (`M0`), whose numbers stand in the program.
    Grbl,
}

/// The file that LinuxCNC writes.
pub const LINUXCNC_FILE: &str = "umi-calibration.csv";

/// The program of a plan, machine coordinates: it stands still at each place and says where the axes are.
#[must_use]
pub fn program(question: &PlanQuestion, plan: &SensorPlan, language: ProgramLanguage) -> String {
    let (first, dwell, open, close) = match language {
        ProgramLanguage::MacroB => ("O8844", "G4 X0.5", "POPEN\n", "PCLOS\n"),
        ProgramLanguage::Haas => ("O8844", "G4 P0.5", "POPEN\n", "PCLOS\n"),
        ProgramLanguage::LinuxCnc => ("", "G4 P0.5", "", "(LOGCLOSE)\n"),
        ProgramLanguage::Grbl => ("", "G4 P0.5", "", ""),
    };
    // GRBL knows no mark of a program's ends.
    let mark = match language {
        ProgramLanguage::Grbl => "",
        _ => "%\n",
    };
    let mut text = format!("{mark}{first}(CALIBRATION OF A POINT SENSOR)\n");
    let [x, y, z] = question.center_mm;
    // Writing to a string cannot fail.
    let _ = writeln!(
        text,
        "(BALL X{x:.3} Y{y:.3} Z{z:.3} R{:.3})",
        question.radius_mm
    );
    let [x, y, z] = plan.u_point_mm;
    let _ = writeln!(text, "(EXPECTED U OF A POINT {x:.5} {y:.5} {z:.5})");
    text.push_str(match language {
        // GRBL has neither; it knows no canned cycle but G80.
        ProgramLanguage::Grbl => "G90 G21 G17 G40 G49 G80 G94\n",
        _ => "G90 G21 G17 G40 G49 G80\n",
    });
    let _ = writeln!(text, "G53 G0 Z{:.3}", question.safe_z_mm);
    text.push_str(open);
    if language == ProgramLanguage::LinuxCnc {
        let _ = writeln!(text, "(LOGOPEN,{LINUXCNC_FILE})\n(LOG,x,y,z)");
    }
    for (number, place) in (1..).zip(&plan.places) {
        let [x, y, z] = place.axes_mm;
        if number == 1 {
            let _ = writeln!(text, "G53 G0 X{x:.3} Y{y:.3}");
        }
        let _ = writeln!(text, "G53 G0 X{x:.3} Y{y:.3} Z{z:.3}");
        let _ = writeln!(text, "{dwell}");
        let _ = match language {
            ProgramLanguage::MacroB | ProgramLanguage::Haas => {
                writeln!(text, "DPRNT[N{number}*X#5021[43]*Y#5022[43]*Z#5023[43]]")
            }
            ProgramLanguage::LinuxCnc => {
                writeln!(text, "(LOG,%.3f#<_abs_x>,%.3f#<_abs_y>,%.3f#<_abs_z>)")
            }
            ProgramLanguage::Grbl => writeln!(text, "(N{number} X{x:.3} Y{y:.3} Z{z:.3})\nM0"),
        };
    }
    text.push_str(close);
    let _ = writeln!(text, "G53 G0 Z{:.3}", question.safe_z_mm);
    text.push_str("M30\n");
    text.push_str(mark);
    text
}
