//! `umi nc diff`: ways that end alike and lead elsewhere.

use crate::rig::run::{Folder, umi};

/// A little over a degree about X.
const LEAN: &str = r#"{"rotation": [[1, 0, 0], [0, 0.9999, -0.014141781], [0, 0.014141781, 0.9999]],
    "translation_mm": [1, 2, 3]}"#;

const BEGIN: &str = "G21 G90 G17 G54\nG0 X0. Y0. Z30.\nG1 Z0. F9\n";

/// Two programs whose motions end alike: `umi nc diff` follows them, and has a limit.
#[test]
fn ways_are_compared() {
    let folder = Folder::new();
    let half = "G2 X10. Y0. I5. J0.\n";
    let flat = "G2 X10. Y0. I5. J-0.03\n";
    for (first, second, mm) in [
        (half, half, None),
        (half, "G3 X10. Y0. I5. J0.\n", Some(10.0)),
        (half, "G1 X10. Y0.\n", Some(5.0)),
        (half, flat, Some(0.03)),
        ("G1 X10.\n", "G1 X5. Y1.\nX10. Y0.\n", Some(1.0)),
        ("G0 X10.\n", "G0 X5. Y1.\nX10. Y0.\n", Some(1.0)),
        ("G1 X10.\n", "G1 X10. Y0.03\n", Some(0.03)),
    ] {
        let of = |name: &str, text: &str| folder.file(name, [BEGIN, text, "M30\n"].concat());
        let (a, b) = (of("a.nc", first), of("b.nc", second));
        let run = umi(&["nc", "diff", &a, &b, "--json"]);
        let Some(mm) = mm else {
            assert_eq!(run.exits(0).json()["complete"], true);
            continue;
        };
        let found = run.exits(2).json();
        assert_eq!(
            (&found["complete"], &found["within"]),
            (&false.into(), &false.into())
        );
        let of = |name: &str| found[name]["deviation_mm"].as_f64().unwrap_or(0.0);
        let most = of("largest_way").max(of("largest_rapid"));
        assert!((most - mm).abs() < 0.02 * mm, "{second}: {most} mm");
        let said = umi(&["nc", "diff", &a, &b]).exits(2).out;
        assert!(said.contains("more than 0.025 mm"), "{said}");
        let wider = (mm * 1.05).to_string();
        umi(&["nc", "diff", &a, &b, "--within-mm", &wider]).exits(0);
    }
    let a = folder.file("a.nc", [BEGIN, half, "M30\n"].concat());
    umi(&["nc", "diff", &a, &a, "--within-mm", "0"]).exits(1);
}

/// An arc of several turns and its chords; one turn less is another arc.
#[test]
fn turns_are_compared() {
    let folder = Folder::new();
    let transform = folder.file("t.json", LEAN);
    let out = folder.path("out.nc");
    let with = |turns: u32| {
        let arc = format!("G3 X0. Y0. I5. J0. Z-3. P{turns}\nG1 X3.\nM2\n");
        folder.file(&format!("p{turns}.ngc"), [BEGIN, &arc].concat())
    };
    let (right, fewer) = (with(4), with(3));
    let by = ["--transform", &transform];
    let rewrite = ["nc", "rewrite", &right, "-o", &out, "--dialect", "linuxcnc"];
    umi(&[&rewrite[..], &by].concat()).exits(0);
    let diff = |program: &str| {
        let args = ["nc", "diff", program, &out, "--control", "linuxcnc"];
        umi(&[&args[..], &by].concat())
    };
    diff(&right).exits(0);
    diff(&fewer).exits(2);
}

/// LinuxCNC's pecks retract by 0.010 inch, and are written out so.
#[test]
fn pecks_retract_as_the_control_does() {
    let folder = Folder::new();
    let transform = folder.file("t.json", LEAN);
    let out = folder.path("out.nc");
    for cycle in ["G73", "G83"] {
        let text = format!("{BEGIN}G0 Z30.\nG98 {cycle} X5. Y5. Z-9. R2. Q3. F9\nG80\nM2\n");
        let program = folder.file("p.nc", text);
        for (dialect, control) in [("fanuc", "fanuc"), ("linuxcnc", "linuxcnc")] {
            let by = ["--transform", &transform];
            let rewrite = ["nc", "rewrite", &program, "-o", &out, "--force"];
            let as_ = ["--dialect", dialect];
            umi(&[&rewrite[..], &by, &as_].concat()).exits(0);
            let diff = ["nc", "diff", &program, &out, "--control", control];
            umi(&[&diff[..], &by].concat()).exits(0);
            let one = ["--clearance-mm", "0.5"];
            umi(&[&rewrite[..], &by, &as_, &one].concat()).exits(0);
            umi(&[&diff[..], &by].concat()).exits(2);
        }
    }
}

/// What two programs say between motions that are the same: exchanged, added, left out or at
/// another motion, it is a difference.
#[test]
fn what_stands_between_motions_is_compared() {
    let folder = Folder::new();
    let cuts = "G1 X10. F9\nG1 Y10.\n";
    let between = |what: &str| cuts.replace("\nG1 Y", &format!("\n{what}\nG1 Y"));
    let twice = |a: &str, b: &str| format!("{a}\n{}{b}\nG1 Z1.\n", cuts);
    let (home, here, there) = ("G53 G0 Z0\n", "G0 X5. Y0. Z5.\n", "G0 X5. Y9. Z5.\n");
    let leads = "IF[#500EQ1]GOTO99\n";
    let sub = "IF[#500EQ1]GOTO99\nG1 Y10. F9\nGOTO100\nN99 G1 X5.\nN100\n";
    for (a, b) in [
        (twice("G43 H1", "G43 H2"), twice("G43 H2", "G43 H1")),
        (twice("G43 H1", "G44 H2"), twice("G44 H1", "G43 H2")),
        (between("G49"), format!("{cuts}G49\n")),
        (format!("/{cuts}"), cuts.replace("G1 Y", "/G1 Y")),
        (
            twice("G1 X#500 F9", "G1 X#501"),
            twice("G1 X#501 F9", "G1 X#500"),
        ),
        (
            [home, here, home, there].concat(),
            [home, home, here, there].concat(),
        ),
        (between("T2 M6"), between("")),
        (between("T2 M6"), between("T3 M6")),
        (between("T2 M06"), format!("T2 M6\n{cuts}")),
        (cuts.to_owned(), between("M21")),
        (cuts.to_owned(), format!("{cuts}G10 L2 P2 X1.\n")),
        (cuts.to_owned(), format!("{cuts}G91\n")),
        (format!("G61\n{cuts}"), format!("G64\n{cuts}")),
        (
            format!("{leads}G1 X10. F9\nN99 Y10.\n"),
            format!("{leads}N99 G1 X10. F9\nY10.\n"),
        ),
        (
            sub.to_owned(),
            sub.replace("N99 G1 X5.", "N98\nN99 G1 X5.\nM21"),
        ),
    ] {
        let [a, b] = [("a.nc", &a), ("b.nc", &b)]
            .map(|(name, text)| folder.file(name, [BEGIN, text, "M30\n"].concat()));
        for (first, second) in [(&a, &b), (&b, &a)] {
            let said = umi(&["nc", "diff", first, second]).exits(2).out;
            assert!(!said.contains("same"), "{said}");
        }
        umi(&["nc", "diff", &a, &a]).exits(0);
        umi(&["nc", "diff", &b, &b]).exits(0);
    }
    // What acts on no motion, and what is written otherwise.
    let a = folder.file("a.nc", [BEGIN, &between("T2 M6"), "M30\n"].concat());
    let b = between("N7 M06 T02 (NEW)\nS900 M3\nM8\nG4 P1.");
    let b = folder.file("b.nc", [BEGIN, &b, "M30\n"].concat());
    let said = umi(&["nc", "diff", &a, &b]).exits(0).out;
    assert!(said.contains("same") && said.contains("spindle"), "{said}");
}

/// What a program takes for granted is a difference where the other says it, and so is a number
/// without a point where the other has one.
#[test]
fn what_is_taken_for_granted_is_compared() {
    let folder = Folder::new();
    let body = "G0 X0. Y0. Z5.\nG2 X10. I5. J0. F9\nM30\n";
    let of = |name: &str, head: &str, body: &str| folder.file(name, format!("{head}\n{body}"));
    let all = of("a.nc", "G21 G90 G17 G54 G40", body);
    for (head, what) in [
        ("G90 G17 G54 G40", "G20 or G21"),
        ("G21 G17 G54 G40", "G90 or G91"),
        ("G21 G90 G54 G40", "G17, G18 or G19"),
        ("G21 G90 G17 G40", "G54 or another"),
        ("G21 G90 G17 G54", "G40"),
    ] {
        let less = of("b.nc", head, body);
        let said = umi(&["nc", "diff", &all, &less]).exits(2).out;
        assert!(said.contains(what), "{said}");
        umi(&["nc", "diff", &less, &all]).exits(2);
        umi(&["nc", "diff", &less, &less]).exits(0);
    }
    let head = "G21 G90 G17 G54 G40";
    let steps = of("b.nc", head, &body.replace("X10.", "X10"));
    umi(&["nc", "diff", &all, &steps]).exits(2);
    // LinuxCNC reads both alike.
    umi(&["nc", "diff", &all, &steps, "--control", "linuxcnc"]).exits(0);
}

/// A block that was not run is compared by its text, and not at all where it would have to be moved.
#[test]
fn what_was_not_run_is_compared_by_its_text() {
    let folder = Folder::new();
    let branch = "G1 F9 Y10.\nIF[#500EQ1]GOTO9\nGOTO10\nN9 G1 X5.\nN10 G1 Z1.\nM30\n";
    let block = "G1 F9 Y10.\no100 if [#100 EQ 1]\nG1 X5.\no100 endif\nG1 Z1.\nM2\n";
    let level = r#"{"rotation": [[1,0,0],[0,1,0],[0,0,1]], "translation_mm": [0,0,3]}"#;
    let level = folder.file("t.json", level);
    for (text, control, line) in [(branch, "fanuc", 7), (block, "linuxcnc", 6)] {
        let of = |name: &str, text: &str| folder.file(name, [BEGIN, text].concat());
        let a = of("a.nc", text);
        let b = of("b.nc", &text.replace("X5.", "X55. Z-20."));
        let diff = |a: &str, b: &str, more: &[&str]| {
            umi(&[&["nc", "diff", a, b, "--control", control], more].concat())
        };
        diff(&a, &a, &[]).exits(0);
        let said = diff(&a, &b, &[]).exits(2).out;
        let wanted = format!("not compared: line {line} of the first program was not run");
        assert!(said.contains(&wanted), "{said}");
        let moved = text.replace("Z1.", "Z4.");
        let head = BEGIN.replace("Z30.", "Z33.").replace("Z0.", "Z3.");
        let c = folder.file("c.nc", [&head, &*moved].concat());
        let said = diff(&a, &c, &["--transform", &level]).exits(2).out;
        assert!(said.contains(&wanted), "{said}");
    }
}

/// A block that is not interpreted makes two programs neither equal nor different.
#[test]
fn what_is_not_interpreted_is_no_difference() {
    let folder = Folder::new();
    for block in ["G41 D1 G1 X10.", "G1 X10. ,C1.", "G0 A10."] {
        let a = folder.file("a.nc", [BEGIN, block, "\nM30\n"].concat());
        let run = umi(&["nc", "diff", &a, &a, "--json"]).exits(1);
        let error = run.json()["error"].clone();
        assert_eq!(error["code"], "not_interpreted", "{block}");
        let said = error["message"].as_str().unwrap();
        assert!(said.contains("a.nc: O0000 line 4"), "{said}");
    }
}
