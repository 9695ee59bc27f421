//! Custom Macro B, statement by statement.

use super::mock::{Mock, alarm, fanuc, run, run_with};
use crate::nc::{Control, OffsetSystem, ProgramState};

/// Loops, jumps, computed jumps and conditions.
#[test]
fn flow() {
    let (control, _) = run("#100=0\n#1=1\nWHILE[#1LE10]DO1\n#100=#100+#1\n#1=#1+1\nEND1");
    assert_eq!(control.variable(100), Some(55.0));
    let (control, _) =
        run("#100=0\nN10#100=#100+1\nIF[#100LT5]GOTO10\n#2=30\nGOTO#2\n#100=99\nN30");
    assert_eq!(control.variable(100), Some(5.0));
    let (control, _) = run("IF[1EQ1]THEN#101=7\nIF[1EQ2]THEN#102=7");
    assert_eq!(
        (control.variable(101), control.variable(102)),
        (Some(7.0), None)
    );
    let (control, _) = run(
        "#1=0\nDO1\n#2=0\nWHILE[#2LT3]DO2\n#2=#2+1\n#1=#1+1\nIF[#1GE7]GOTO9\nEND2\nEND1\nN9#103=#1",
    );
    assert_eq!(control.variable(103), Some(7.0));
    assert_eq!(alarm("GOTO77").number, Some(128));
    assert_eq!(alarm("WHILE[1EQ1]DO4").number, Some(126));
    assert_eq!(alarm("WHILE[1EQ1]DO1").number, Some(124));
    assert_eq!(alarm("END2").number, Some(124));
    assert!(
        alarm("GOTO5\nDO1\nN5\nEND1")
            .message
            .contains("inside a loop")
    );
}

/// A program that never ends is stopped by the limits.
#[test]
fn endless() {
    let mut settings = fanuc();
    settings.limits.loops = 1000;
    settings.limits.blocks = 5000;
    for text in [
        "O1\nN1GOTO1\n",
        "O1\nDO1\nEND1\n",
        "O1\nM99\n",
        "O1\nM98P1\n",
    ] {
        let (_, end) = run_with(settings.clone(), &mut Mock::default(), text);
        assert!(end.is_err(), "{text}");
    }
}

/// Arguments of both forms, levels of local variables, repetitions, M98 with its caller's.
#[test]
fn calls() {
    let text = "O1\n#1=5\n#26=6\nG65P2A1.5Z-3.B#0L2\n#110=#1\nM98P3\nM98P20003\nM30\n\
                O2\n#100=#1\n#101=#26\n#102=#2\n#103=#[103]+1\n#1=77\nM99\n\
                O3\n#1=#1+1\n#111=#1\nM99\n";
    let (control, end) = run_with(fanuc(), &mut Mock::default(), text);
    assert_eq!(end.map(|step| step.state), Ok(ProgramState::Ended));
    let values = [100, 101, 102, 103, 110, 111].map(|n| control.variable(n));
    assert_eq!(
        values,
        [Some(1.5), Some(-3.0), None, Some(2.0), Some(5.0), Some(8.0)]
    );
    // Second form: I J K in groups.
    let text = "O1\nG65P2A1.I2.J3.K4.I5.K6.J7.\nM30\nO2\n#100=#4\n#101=#6\n#102=#7\n#103=#9\n#104=#11\nM99";
    let (control, _) = run_with(fanuc(), &mut Mock::default(), text);
    let values = [100, 101, 102, 103, 104].map(|n| control.variable(n));
    assert_eq!(values, [2.0, 4.0, 5.0, 6.0, 7.0].map(Some));
    assert_eq!(alarm("G65P99").number, Some(76));
    assert_eq!(alarm("M98P1").number, Some(77));
    assert_eq!(alarm("G65P1G1").number, Some(129));
    assert!(alarm("M198P1").message.contains("no external device"));
}

/// M99 P goes back to another block.
#[test]
fn return_to_a_block() {
    let text = "O1\nM98P2\n#100=1\nN20#101=1\nM30\nO2\nM99P20";
    let (control, _) = run_with(fanuc(), &mut Mock::default(), text);
    assert_eq!(
        (control.variable(100), control.variable(101)),
        (None, Some(1.0))
    );
}

/// A modal call follows each motion, not those of the macro itself.
#[test]
fn modal_call() {
    let text = "O1\nG66P2A1.\nG0X1.\nX2.\nM8\nG67\nX3.\nM30\nO2\n#100=#100+#1\nG0Y1.\nM99";
    let mut mock = Mock::default();
    let (control, end) = run_with(fanuc(), &mut mock, text);
    assert!(end.is_ok());
    assert_eq!(control.variable(100), Some(2.0));
    assert_eq!(mock.moves.len(), 5);
}

/// Words, modal state, increments without a point, words with a null left out.
#[test]
fn motion() {
    let (_, mock) = run("G0X10.Y5.\nG1Z-2.F100.\nX#1Y7.\nX2000\nG91X1.5\nG90X.5F50");
    assert_eq!(
        mock.ends(),
        [
            [10.0, 5.0, 0.0, 0.0],
            [10.0, 5.0, -2.0, 100.0],
            [10.0, 7.0, -2.0, 100.0],
            [2.0, 7.0, -2.0, 100.0],
            [3.5, 7.0, -2.0, 100.0],
            [0.5, 7.0, -2.0, 50.0],
        ]
    );
    assert_eq!(alarm("G1X1.").number, Some(11));
    assert_eq!(alarm("G12.3X1.").number, Some(10));
    assert_eq!(alarm("G0A1.").number, Some(9));
    assert_eq!(alarm("G0X").number, Some(5));
    assert!(alarm("G0X1.X2.").message.contains("twice"));
    assert!(alarm("G0X1.R2.").message.contains("R has no meaning"));
    assert!(alarm("G1G0X1.").message.contains("one block"));
    assert!(alarm("G41X1.").message.contains("not interpreted"));
    assert!(alarm("M66").message.contains("no such function"));
}

/// Offsets: external, G54.., G54.1, G52, G92, length; G10 with G90 and G91; inches.
#[test]
fn offsets() {
    let text = "G10L2P0X1.\nG10L2P2X100.Y50.Z-20.\nG91G10L2P2X5.\nG90G55G0X10.Y0Z0\n\
                G10L20P3X-1.\nG54.1P3X0\nG54P3X1.\n#7042=4.\nY0\nG52Y1.\nY0\nG52Y0";
    let (control, mock) = run(text);
    let x: Vec<f64> = mock.ends().iter().map(|end| end[0]).collect();
    let y: Vec<f64> = mock.ends().iter().map(|end| end[1]).collect();
    assert_eq!(x, [116.0, 0.0, 1.0, 1.0, 1.0]);
    assert_eq!(y, [50.0, 50.0, 50.0, 4.0, 5.0]);
    assert_eq!(
        control.offset(OffsetSystem::Standard(2)),
        [105.0, 50.0, -20.0]
    );
    assert_eq!(control.variable(5241), Some(105.0));
    let (control, mock) = run(
        "G10L10P1R80.\nG43Z10.H1\n#100=#5003\n#101=#5043\n#102=#5083\n#103=#5023\nG49Z10.\nG92Z0\nZ1.",
    );
    let z: Vec<f64> = mock.ends().iter().map(|end| end[2]).collect();
    assert_eq!(z, [90.0, 10.0, 11.0]);
    let values = [100, 101, 102, 103].map(|n| control.variable(n));
    assert_eq!(values, [10.0, 90.0, 80.0, 90.0].map(Some));
    let (control, mock) = run("G20G1X1.F10.\n#100=#5001\n#101=#5221\nG21\n#102=#5001");
    assert_eq!(mock.ends(), [[25.4, 0.0, 0.0, 254.0]]);
    assert_eq!(control.variable(100), Some(1.0));
    assert_eq!(control.variable(102), Some(25.4));
}

/// The sets of G54.4 by their variables: #26010 to #26015 are set 1, rounded to the
/// control's increments; set 0 cannot be written.
#[test]
fn setting_errors_by_variables() {
    let (control, mock) = run(
        "#26020=1.00049\n#26021=2.\n#26022=3.\n#26025=90.\n#100=#26020\n#101=#26010\n\
         G54.4P2\nG0X10.Y0Z0",
    );
    assert_eq!(
        control.offsets().setting_error(2),
        [1.0, 2.0, 3.0, 0.0, 0.0, 90.0]
    );
    assert_eq!(mock.ends()[0], [1.0, 12.0, 3.0, 0.0]);
    assert_eq!(
        [100, 101].map(|n| control.variable(n)),
        [Some(1.0), Some(0.0)]
    );
    let (control, _) = run("G20\n#26010=1.\n#100=#26010\nG21");
    assert_eq!(control.offsets().setting_error(1)[0], 25.4);
    assert_eq!(control.variable(100), Some(1.0));
    for text in ["#26000=1.", "#26016=1.", "#26080=1.", "#26010=1e9"] {
        assert!(!alarm(text).message.is_empty(), "{text}");
    }
}

/// G68 in the plane and in space, G54.4, and where the variables of position stand.
#[test]
fn rotations() {
    let (control, mock) =
        run("G54\n#5221=100.\nG68X10.Y0R90.\nG0X20.Y0\n#100=#5001\n#101=#5002\nG69\nX0Y0");
    assert_eq!(mock.ends()[0], [110.0, 10.0, 0.0, 0.0]);
    assert_eq!(mock.ends()[1], [100.0, 0.0, 0.0, 0.0]);
    assert_eq!(control.variable(100), Some(10.0));
    assert_eq!(control.variable(101), Some(10.0));
    let (_, mock) = run("G68X10.Y0Z0I0J0K1.R90.\nG0X1.Y0Z0");
    assert_eq!(mock.ends()[0], [10.0, 1.0, 0.0, 0.0]);
    assert_eq!(alarm("G68X0Y0Z0I1.J0R5.").number, Some(5044));
    assert_eq!(alarm("G68X0Y0Z0I0J0K0R5.").number, Some(5044));
    assert!(
        alarm("G68X0Y0R5.\nG28X0")
            .message
            .contains("between G68 and G69")
    );
    assert!(
        alarm("G68X0Y0R5.\nG55")
            .message
            .contains("between G68 and G69")
    );

    let mut control = Control::new(fanuc());
    control
        .offsets_mut()
        .set_setting_error(2, [1.0, 2.0, 3.0, 0.0, 0.0, 90.0]);
    control
        .load("O1\nG54.4P2\nG0X10.Y0Z0\nG54.4P0\nX0\nM30")
        .expect("loads");
    control.select(1).expect("there");
    let mut mock = Mock::default();
    control.run(&mut mock).expect("runs");
    assert_eq!(mock.ends()[0], [1.0, 12.0, 3.0, 0.0]);
    assert_eq!(mock.ends()[1], [0.0, 12.0, 3.0, 0.0]);
}

/// Arcs: centre and radius, planes, a full circle, a helix; what disagrees is refused.
#[test]
fn arcs() {
    let (_, mock) = run("G0X10.\nG3X0Y10.I-10.F100.");
    assert_eq!(mock.arc(), ([0.0; 3], [0.0, 0.0, 1.0], 90.0));
    let (_, mock) = run("G0X10.\nG2X0Y-10.R10.F100.");
    assert_eq!(mock.arc(), ([0.0; 3], [0.0, 0.0, 1.0], -90.0));
    let (_, mock) = run("G0X10.\nG2I-10.F100.");
    assert_eq!(mock.arc(), ([0.0; 3], [0.0, 0.0, 1.0], -360.0));
    let (_, mock) = run("G18G0Z10.\nG3X10.Z0Y5.K-10.F100.");
    assert_eq!(mock.arc(), ([0.0; 3], [0.0, 1.0, 0.0], 90.0));
    assert_eq!(mock.ends()[1], [10.0, 5.0, 0.0, 100.0]);
    let (_, mock) = run("G19G0Y10.\nG3Y-10.R10.F100.");
    assert_eq!(mock.arc(), ([0.0; 3], [1.0, 0.0, 0.0], 180.0));
    let (_, mock) = run("G68X0Y0R90.\nG0X10.Y0\nG3X0Y10.I-10.F100.");
    assert_eq!(mock.arc(), ([0.0; 3], [0.0, 0.0, 1.0], 90.0));
    assert_eq!(mock.ends()[1], [-10.0, 0.0, 0.0, 100.0]);
    assert_eq!(alarm("G2X10.I4.F100.").number, Some(20));
    assert_eq!(alarm("G2X10.F100.").number, Some(22));
    assert_eq!(alarm("G2X10.R4.F100.").number, Some(20));
    assert_eq!(alarm("G2X10.R5.").number, Some(11));
}

/// G31 stores the position in the work system, rounded; the axes stand further on.
#[test]
fn skip() {
    let mut mock = Mock {
        wall: Some((0, 150.123_46)),
        overrun: 0.5,
        ..Mock::default()
    };
    let text = "O1\n#5221=100.\nG54G31X80.F50.\n#100=#5061\n#101=#5041\n#102=#5062\nG31X90.\n#103=#5061\nM30";
    let (control, end) = run_with(fanuc(), &mut mock, text);
    assert!(end.is_ok());
    let values = [100, 101, 102, 103].map(|n| control.variable(n));
    assert_eq!(values, [50.123, 50.623, 0.0, 90.0].map(Some));
    assert_eq!(alarm("G31X1.").number, Some(11));
}

/// G28, G30, G53, dwell, tool change, spindle.
#[test]
fn machine_functions() {
    let (_, mock) =
        run("#5221=10.\nG0X1.Y2.Z3.\nG91G28Z0\nG90G53X5.\nT3M6\nG4P500\nG4X1.5\nS100M3");
    assert_eq!(
        mock.ends(),
        [
            [11.0, 2.0, 3.0, 0.0],
            [11.0, 2.0, 3.0, 0.0],
            [11.0, 2.0, 500.0, 0.0],
            [5.0, 2.0, 500.0, 0.0]
        ]
    );
    assert_eq!((mock.tool, mock.dwelt), (3, 2.0));
    assert_eq!(mock.codes, [3, 30]);
    assert!(alarm("G30X0").message.contains("second_reference_mm"));
}

/// Canned cycles with both returns, pecks and repeats.
#[test]
fn cycles() {
    let (_, mock) = run("G0Z50.\nG99G81X1.R5.Z-3.F100.\nX2.\nG98G82X3.P500\nG80X4.");
    let z: Vec<f64> = mock.ends().iter().map(|end| end[2]).collect();
    assert_eq!(
        z,
        [
            50.0, 50.0, 5.0, -3.0, 5.0, 5.0, 5.0, -3.0, 5.0, 5.0, 5.0, -3.0, 50.0, 50.0
        ]
    );
    assert_eq!(mock.dwelt, 0.5);
    let (_, mock) = run("G0Z50.\nG83X1.R5.Z-5.Q4.F100.");
    let z: Vec<f64> = mock.ends().iter().map(|end| end[2]).collect();
    assert_eq!(
        z,
        [50.0, 50.0, 5.0, 1.0, 5.0, 2.0, -3.0, 5.0, -2.0, -5.0, 50.0]
    );
    let (_, mock) = run("G0Z50.\nG91G81X10.R-45.Z-8.K3F100.");
    let x: Vec<f64> = mock.ends().iter().map(|end| end[0]).collect();
    assert_eq!(
        x,
        [
            0.0, 10.0, 10.0, 10.0, 10.0, 20.0, 20.0, 20.0, 20.0, 30.0, 30.0, 30.0, 30.0
        ]
    );
    assert_eq!(alarm("G83X1.R5.Z-5.F1.").number, Some(45));
}

/// Inputs, outputs, timers, the date, modal information; what cannot be written.
#[test]
fn system_variables() {
    let mut mock = Mock::default();
    mock.inputs.insert(1003);
    let text = "O7\n#100=#1003+#1002\n#101=#1032\n#1105=1\n#1132=3\n#102=#1101\n#103=#3011\n\
                #104=#3001\n#105=#4001\n#106=#4003\n#107=#4115\n#108=#4014\n#3001=0\n#109=#3001\nM30";
    let (control, end) = run_with(fanuc(), &mut mock, text);
    assert!(end.is_ok(), "{end:?}");
    let values = [100, 101, 102, 103, 104, 105, 106, 107, 108, 109].map(|n| control.variable(n));
    assert_eq!(
        values,
        [
            1.0,
            8.0,
            1.0,
            20_130_101.0,
            12_500.0,
            0.0,
            90.0,
            7.0,
            54.0,
            0.0
        ]
        .map(Some)
    );
    assert_eq!(mock.outputs.into_iter().collect::<Vec<_>>(), [1100, 1101]);
    assert_eq!(alarm("#5061=1").number, Some(116));
    assert_eq!(alarm("#0=1").number, Some(116));
    assert_eq!(alarm("#5064=1").number, Some(115));
    assert_eq!(alarm("#1=#400").number, Some(115));
}

/// Alarms and stops of a program, M0 and M1, block skip.
#[test]
fn stops() {
    let said = alarm("N5#3000=12(NO CONTACT)");
    assert_eq!((said.number, said.line), (Some(3012), 2));
    assert!(said.message.contains("NO CONTACT"));
    let mut control = Control::new(fanuc());
    control
        .load("O1\n#3006=1(LOOK)\nM1\nM0\n/#100=1\nM30\n")
        .expect("loads");
    control.select(1).expect("there");
    control.set_block_skip(true);
    let mut mock = Mock::default();
    let stop = control.run(&mut mock).expect("stops");
    assert_eq!(
        (stop.state, stop.message.as_deref()),
        (ProgramState::Stopped, Some("LOOK"))
    );
    assert_eq!(control.run(&mut mock).expect("stops").text, "M0");
    assert_eq!(
        control.run(&mut mock).expect("ends").state,
        ProgramState::Ended
    );
    assert_eq!(control.variable(100), None);
    assert_eq!(
        control.step(&mut mock).expect("still").state,
        ProgramState::Ended
    );
}

/// A text that arrives later replaces the program of its number; what runs stays.
#[test]
fn correction_arrives() {
    let mut control = Control::new(fanuc());
    control
        .load("O1\nM98P9\nM98P9\nM30\nO9\n#100=1\nM99")
        .expect("loads");
    control.select(1).expect("there");
    let mut mock = Mock::default();
    control.step(&mut mock).expect("O1");
    control.step(&mut mock).expect("M98");
    assert_eq!(
        control.load("%\nO9(NEW)\n#101=2\nM99\n%").expect("loads"),
        [9]
    );
    control.run(&mut mock).expect("runs");
    assert_eq!(
        (control.variable(100), control.variable(101)),
        (Some(1.0), Some(2.0))
    );
    assert!(control.select(8).is_err());
    assert!(control.load("%\n%").is_err());
    assert!(control.load("O1\nM30\nO1\nM30").is_err());
}

/// An alarm says where and stays until a program is selected; no M30 is an alarm.
#[test]
fn alarms() {
    let mut control = Control::new(fanuc());
    control.load("%\nO12\nG0X1.\nG1 X2.\n%").expect("loads");
    control.select(12).expect("there");
    let mut mock = Mock::default();
    let alarm = control.run(&mut mock).expect_err("no feed");
    assert_eq!(
        alarm.to_string(),
        "O0012 line 4 `G1 X2.`: alarm 11: no feed: give F in this block or before it"
    );
    assert_eq!(control.step(&mut mock), Err(alarm));
    assert!(control.status().alarm.is_some());
    control.select(12).expect("clears");
    assert_eq!(control.status().line, 2);
    assert_eq!(control.status().alarm, None);
}

/// Printing: DC codes at POPEN and PCLOS once each; closed it is an alarm.
#[test]
fn printing() {
    let mut mock = Mock::default();
    let mut settings = fanuc();
    settings.dc_codes = true;
    let text = "O1\nPOPEN\nPOPEN\n#1=1.5\nDPRNT[A*#1[33]]\nPCLOS\nPCLOS\nM30";
    run_with(settings, &mut mock, text).1.expect("runs");
    assert_eq!(mock.text(), "\x12A 1.500\n\x14");
    assert!(alarm("DPRNT[A]").message.contains("POPEN"));
}
