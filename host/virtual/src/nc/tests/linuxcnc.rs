//! LinuxCNC and GRBL.

use super::mock::{Mock, run_in, run_with};
use crate::nc::{ControlFamily, ControlSettings, OffsetSystem};

/// All constructs of the O words, with named parameters and values returned.
#[test]
fn o_words() {
    let text = "\
o<twice> sub
  #<local> = [#1 * 2]
  o10 if [#1 GT 100]
    o<twice> return [0]
  o10 endif
o<twice> endsub [#<local> + #2]
#<_sum> = 0
#<i> = 0
o100 while [#<i> LT 10]
  #<i> = [#<i> + 1]
  o101 if [#<i> EQ 3]
    o100 continue
  o101 elseif [#<i> EQ 6]
    o100 break
  o101 else
    #<_sum> = [#<_sum> + #<i>]
  o101 endif
o100 endwhile
#<_repeats> = 0
o102 repeat [4]
  #<_repeats> = [#<_repeats> + 1]
o102 endrepeat
#<_do> = 0
o103 do
  #<_do> = [#<_do> + 1]
o103 while [#<_do> LT 3]
o<twice> call [21] [0.5]
#<_got> = #<_value>
o<twice> call [101]
#<_none> = #<_value>
M2
";
    let (control, _) = run_in(ControlFamily::LinuxCnc, text);
    let values = ["_sum", "_repeats", "_do", "_got", "_none"].map(|name| control.named(name));
    // 1 + 2 + 4 + 5
    assert_eq!(values, [12.0, 4.0, 3.0, 42.5, 0.0].map(Some));
}

/// G90.1: a centre by its coordinates, both of them.
#[test]
fn absolute_centres() {
    let text = "G90.1 G0 X10 Y5\nG3 X5 Y10 I5 J5 F100\nM2\n";
    let (_, mock) = run_in(ControlFamily::LinuxCnc, text);
    assert_eq!(mock.arc(), ([5.0, 5.0, 0.0], [0.0, 0.0, 1.0], 90.0));
    let text = "G90.1 G0 X10 Y5\nG91.1\nG3 X5 Y10 I-5 F100\nM2\n";
    let (_, mock) = run_in(ControlFamily::LinuxCnc, text);
    assert_eq!(mock.arc(), ([5.0, 5.0, 0.0], [0.0, 0.0, 1.0], 90.0));
    let mut mock = Mock::default();
    let text = "G90.1 G0 X10 Y5\nG3 X5 Y10 I5 F100\nM2\n";
    let (_, end) = run_with(
        ControlSettings::of(ControlFamily::LinuxCnc),
        &mut mock,
        text,
    );
    assert!(end.is_err());
}

/// G93: F is one over the minutes of its block, lines and arcs alike, and of no other.
#[test]
fn inverse_time() {
    let text = "G0 X10 Y0\nG93 G1 X20 F6\nG3 X10 Y10 I-10 F3\nG94 G1 X0 F50\nM2\n";
    let (_, mock) = run_in(ControlFamily::LinuxCnc, text);
    let feeds: Vec<f64> = mock.ends().iter().map(|[.., feed]| *feed).collect();
    let quarter = core::f64::consts::PI * 5.0;
    assert_eq!(feeds, [0.0, 60.0, quarter * 3.0, 50.0]);
    for text in [
        "G93 G1 X20 F6\nX30\nM2\n",
        "F50\nG93 G1 X20\nM2\n",
        "G93 G1 X20 F6\nG94 X30\nM2\n",
        "G93 G81 X1 Z-1 R1 F6\nM2\n",
    ] {
        let (_, end) = run_with(
            ControlSettings::of(ControlFamily::LinuxCnc),
            &mut Mock::default(),
            text,
        );
        assert!(end.is_err(), "{text}");
    }
}

/// Endless constructs end at the limits; what is not closed is an alarm.
#[test]
fn refused() {
    for text in [
        "o1 while [1]\no1 endwhile\n",
        "o1 do\no1 while [1]\n",
        "o1 repeat [1e9]\no1 endrepeat\n",
        "o<a> sub\no<a> call\no<a> endsub\no<a> call\n",
        "o1 if [1]\n",
        "o<b> call\n",
        "G1 X1 F1 Q3\n",
        "G68 X0 Y0 R1\n",
        "#1 = #<nothing>\n",
        "#<_x> = 1\n",
        "G38.2 X1 F10\n",
    ] {
        let mut settings = ControlSettings::of(ControlFamily::LinuxCnc);
        settings.limits.loops = 500;
        settings.limits.blocks = 2000;
        let (_, end) = run_with(settings, &mut Mock::default(), text);
        assert!(end.is_err(), "{text}");
    }
}

/// Probing: result, the log of PROBEOPEN without repetitions, #5070.
#[test]
fn probing() {
    let mut mock = Mock {
        wall: Some((2, -3.0)),
        ..Mock::default()
    };
    let text = "(PROBEOPEN hits.txt)\nG10 L2 P1 X1 Z-1\nG54 G90\nF100\nG38.2 Z-10\n\
                #<_pz> = #5063\n#<_hit> = #5070\nG0 Z5\nG38.3 Z-10\nG0 Z1\nG38.3 Z2\n(PROBECLOSE)\nG38.3 X9\nM2\n";
    let (control, end) = run_with(
        ControlSettings::of(ControlFamily::LinuxCnc),
        &mut mock,
        text,
    );
    assert!(end.is_ok(), "{end:?}");
    assert_eq!(control.named("_pz"), Some(-2.0));
    assert_eq!(
        mock.text(),
        "-1.000000 0.000000 -2.000000 0.000000 0.000000 0.000000 0.000000 0.000000 0.000000\n\
         -1.000000 0.000000 2.000000 0.000000 0.000000 0.000000 0.000000 0.000000 0.000000\n"
    );
}

/// Comments that print, in the formats of the manual; ABORT is an alarm.
#[test]
fn comments() {
    let (_, mock) = run_in(
        ControlFamily::LinuxCnc,
        "#1 = 1.23456789\n#<a b> = -2.5\n(PRINT,X #1 and %d#1 %f#1 %.2f#<ab>%%)\n\
         (LOG,lost)\n(LOGOPEN,file.txt)\n(LOG,kept #<ab>)\n(LOGCLOSE)\n(MSG,Hello)\n(no print, #1)\nM2",
    );
    assert_eq!(
        mock.text(),
        "X 1.234568 and 1 1.2346 -2.50%%\nkept -2.500000\nHello\n"
    );
    let (_, end) = run_with(
        ControlSettings::of(ControlFamily::LinuxCnc),
        &mut Mock::default(),
        "(ABORT,no contact)\n",
    );
    assert!(end.is_err_and(|alarm| alarm.message.contains("no contact")));
}

/// A work coordinate system that is turned.
#[test]
fn turned_offset() {
    let (control, mock) = run_in(
        ControlFamily::LinuxCnc,
        "G10 L2 P2 X10 Y0 R90\nG55\nG0 X5 Y1\n#<_x1> = #5420\nG10 L20 P2 X0 Y0\n#<_x2> = #5420\nM2",
    );
    assert_eq!(mock.ends()[0], [9.0, 5.0, 0.0, 0.0]);
    assert_eq!(control.named("_x1"), Some(5.0));
    assert_eq!(control.named("_x2"), Some(0.0));
    assert_eq!(control.offsets().turn(OffsetSystem::Standard(2)), 90.0);
}

/// GRBL reports probing and has neither variables nor macros.
#[test]
fn grbl() {
    let mut mock = Mock {
        wall: Some((2, -3.00049)),
        ..Mock::default()
    };
    let settings = ControlSettings::of(ControlFamily::Grbl);
    let text = "G21G90\nG38.2 Z-10 F50\nG0Z1\nG38.3X5\nM30";
    let (_, end) = run_with(settings.clone(), &mut mock, text);
    assert!(end.is_ok(), "{end:?}");
    assert_eq!(
        mock.text(),
        "[PRB:0.000,0.000,-3.000:1]\r\n[PRB:5.000,0.000,1.000:0]\r\n"
    );
    let number = |text| {
        let (_, end) = run_with(settings.clone(), &mut Mock::default(), text);
        end.expect_err(text).number
    };
    assert_eq!(number("G31X1F1\n"), Some(20));
    assert_eq!(number("G1X1\n"), Some(22));
    assert_eq!(number("G38.2X1F1\n"), Some(5));
    for text in [
        "#1=2\n",
        "G0X#1\n",
        "G65P1\n",
        "M98P1\n",
        "o1 sub\n",
        "G31X1F1\n",
    ] {
        let (_, end) = run_with(settings.clone(), &mut Mock::default(), text);
        assert!(end.is_err(), "{text}");
    }
}

/// `G52` is what `G92` is there, in #5211; on a Haas it is #5201, also for `G10 L2 P0`; on a Fanuc
/// no variable has it, and machine less work position shows it. `G43.1` has its length in Z, and
/// #5403 is the loaded tool's all the same.
#[test]
fn local_shifts() {
    let text = "G52 X1.5\nG0 X0\n#100=#5210\n#101=#5211\nG52 X0\nG43.1 Z20\nG0 Z5\n#102=#5403\n#103=[#<_abs_z>-#5422]\nM2\n";
    let (control, mock) = run_in(ControlFamily::LinuxCnc, text);
    let ends: Vec<[f64; 2]> = mock.ends().iter().map(|end| [end[0], end[2]]).collect();
    assert_eq!(ends, [[1.5, 0.0], [1.5, 25.0]]);
    let values = [100, 101, 102, 103].map(|n| control.variable(n));
    assert_eq!(values, [1.0, 1.5, 0.0, 20.0].map(Some));
    let text = "%\nO1\nG52X1.5\nG0X0\n#100=#5201\nG10L2P0X2.5\nG0X0\n#5202=4.\nG0Y0\n\
                #101=#5021-#5041-#5201\nM30\n%\n";
    let (control, mock) = run_in(ControlFamily::Haas, text);
    let ends: Vec<[f64; 2]> = mock.ends().iter().map(|end| [end[0], end[1]]).collect();
    assert_eq!(ends, [[1.5, 0.0], [2.5, 0.0], [2.5, 4.0]]);
    let values = [100, 101].map(|n| control.variable(n));
    assert_eq!(values, [1.5, 0.0].map(Some));
    let text =
        "%\nO1\nG52X1.5\nG0X0\n#100=#5201\n#101=#5021-#5041\nG92X1.\n#102=#5021-#5041\nM30\n%\n";
    let (control, _) = run_in(ControlFamily::Fanuc, text);
    let values = [100, 101, 102].map(|n| control.variable(n));
    assert_eq!(values, [0.0, 1.5, 0.5].map(Some));
}
