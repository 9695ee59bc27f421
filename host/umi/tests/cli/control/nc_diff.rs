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
