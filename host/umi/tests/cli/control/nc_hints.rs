//! `umi nc`: a refusal's hint, followed, leads to a program; and what `nc diff` interprets.

use crate::rig::run::{Folder, umi};

/// A little over a degree about X.
const LEAN: &str = r#"{"rotation": [[1, 0, 0], [0, 0.9999, -0.014141781], [0, 0.014141781, 0.9999]],
    "translation_mm": [1, 2, 3]}"#;
/// About an axis near X: 1.72 degrees about X, 0.54 about Y.
const ASKEW: &str = r#"{"rotation": [[0.9999592573, 0.0001358091, 0.0090258152],
    [0.0001358091, 0.9995473031, -0.0300860507],
    [-0.0090258152, 0.0300860507, 0.9995065604]],
    "translation_mm": [1, 2, 3]}"#;
const SAME: &str =
    r#"{"rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "translation_mm": [0, 0, 0]}"#;

const BEGIN: &str = "G21 G90 G17 G54\nG0 X0. Y0. Z30.\n";

/// Each hint, tried: the program refused, what it says, and the same program with the hint.
#[test]
fn a_hint_that_is_followed_helps() {
    let folder = Folder::new();
    let transform = folder.file("t.json", LEAN);
    let out = folder.path("out.nc");
    let rewrite = |program: &str, options: &[&str]| {
        let args = [
            "nc",
            "rewrite",
            program,
            "-o",
            &out,
            "--force",
            "--transform",
            &transform,
        ];
        umi(&[&args[..], options].concat())
    };
    for (text, says, better, options) in [
        // Above the part, from where a machine has sent Z.
        (
            "G91 G28 Z0.\nG90 G0 X5. Y5.\nG43 H1 Z30.\nG1 Z-1. F9\n",
            "(--allow-rapids)",
            "G91 G28 Z0.\nG90 G0 X5. Y5.\nG43 H1 Z30.\nG1 Z-1. F9\n",
            &["--allow-rapids"][..],
        ),
        (
            "G91 G28 Z0.\nG90 G0 X5. Y5.\nG1 Z-1. F9\n",
            "name X, Y and Z in one G90 block with G0",
            "G91 G28 Z0.\nG90 G0 X5. Y5. Z30.\nG1 Z-1. F9\n",
            &[],
        ),
        (
            "M6 T2\nG43 H2 Z50.\nG81 X5. Z-5. R2. F9\nG80\n",
            "name X, Y and Z in one G90 block with G0",
            "M6 T2\nG43 H2\nG90 G0 X0. Y0. Z50.\nG98 G81 X5. Z-5. R2. F9\nG80\n",
            &[],
        ),
        (
            "G91 G10 L2 P2 X5.\nG90 G1 X1. F9\n",
            "(--dialect fanuc or linuxcnc)",
            "G91 G10 L2 P2 X5.\nG90 G1 X1. F9\n",
            &["--dialect", "fanuc"],
        ),
        (
            "G91 G10 L2 P2 X5.\nG90 G1 X1. F9\n",
            "write it in G90",
            "G90 G10 L2 P2 X5.\nG90 G1 X1. F9\n",
            &[],
        ),
        (
            "G10 L2 P0 X5.\nG1 X1. F9\n",
            "P1 to P6",
            "G10 L2 P2 X5.\nG1 X1. F9\n",
            &[],
        ),
        (
            "G81 X5. Y5. Z-5. R2. F9\nG80\n",
            "(--start G98 or G99, --dialect fanuc)",
            "G81 X5. Y5. Z-5. R2. F9\nG80\n",
            &["--start", "G99"],
        ),
        (
            "G81 X5. Y5. Z-5. R2. F9\nG80\n",
            "neither G98 nor G99",
            "G81 X5. Y5. Z-5. R2. F9\nG80\n",
            &["--dialect", "fanuc"],
        ),
        (
            "G98 G89 X5. Y5. Z-5. R2. P100 F9\nG80\n",
            "(--dialect fanuc or linuxcnc)",
            "G98 G89 X5. Y5. Z-5. R2. P100 F9\nG80\n",
            &["--dialect", "linuxcnc"],
        ),
        (
            "G98 G89 X5. Y5. Z-5. R2. P100 F9\nG80\n",
            "drill under G99",
            "G99 G89 X5. Y5. Z-5. R2. P100 F9\nG80\n",
            &[],
        ),
        (
            "G81 X5. Y5. Z-5. R40. F9\nG80\n",
            "go to R first",
            "G0 Z40.\nG81 X5. Y5. Z-5. R40. F9\nG80\n",
            &[],
        ),
        (
            "M98 P100 L3\nG0 X0. Y0. Z30.\nM30\nO100\nG91 G1 Y1. F9\nG90\nM99\n",
            "call it once at a time",
            "M98 P100\nG0 X0. Y0. Z30.\nM98 P100\nG0 X0. Y0. Z30.\nM30\nO100\nG91 G1 Y1. F9\nG90\nM99\n",
            &[],
        ),
        (
            "M98 P100\nM30\nO100\nG18\nM99\n",
            "leave them as they were",
            "M98 P100\nM30\nO100\nG18\nG17\nM99\n",
            &[],
        ),
    ] {
        let end = if text.contains("M30") { "" } else { "M30\n" };
        let refused = folder.file("p.nc", [BEGIN, text, end].concat());
        rewrite(&refused, &[]).exits(2).says(says);
        let helped = folder.file("q.nc", [BEGIN, better, end].concat());
        let ran = rewrite(&helped, options);
        assert!(ran.err.is_empty(), "{better}: {}", ran.err);
        ran.exits(0);
    }
}

/// The identity refuses nothing, as it changes nothing: `check` says what others refuse.
#[test]
fn the_identity_is_checked_as_others() {
    let folder = Folder::new();
    let same = folder.file("same.json", SAME);
    let text = [BEGIN, "G68 X0. Y0. R30.\nM30\n"].concat();
    let program = folder.file("p.nc", text);
    umi(&["nc", "rewrite", &program, "-o", "-", "--transform", &same]).exits(0);
    let with = umi(&["nc", "check", &program, "--transform", &same]).exits(2);
    assert_eq!(with.out, umi(&["nc", "check", &program]).exits(2).out);
    assert!(
        with.out.contains("G68 changes the coordinates"),
        "{}",
        with.out
    );
}

/// `nc diff` interprets what the rewriter carries: turns of an arc, boring, a main program that
/// begins again.
#[test]
fn diff_sees_what_is_carried() {
    let folder = Folder::new();
    let transform = folder.file("t.json", LEAN);
    let out = folder.path("out.nc");
    for (text, control, wrong) in [
        (
            "G3 X0. Y0. I5. J0. Z28. P3 F9\nM2\n",
            "linuxcnc",
            ("G3 X0. Y0. I5. J0. Z28. P3", "G3 X0. Y0. I5. J0. Z28. P2"),
        ),
        (
            "G98 G89 X5. Y5. Z-5. R2. P1 F9\nX9.\nG80\nM2\n",
            "linuxcnc",
            ("X9.", "X9.2"),
        ),
        (
            "G98 G85 X5. Y5. Z-5. R2. F9\nX9.\nG80\nG0 Z30.\nM99\n",
            "fanuc",
            ("X9.", "X9.2"),
        ),
    ] {
        let nominal = [BEGIN, text].concat();
        let program = folder.file("p.nc", &nominal);
        let other = folder.file("q.nc", nominal.replace(wrong.0, wrong.1));
        let args = ["--transform", &transform, "--dialect", control, "--force"];
        umi(&[&["nc", "rewrite", &program, "-o", &out], &args[..]].concat()).exits(0);
        let diff = |first: &str| {
            let args = ["--transform", &transform, "--control", control, "--json"];
            let found = umi(&[&["nc", "diff", first, &out], &args[..]].concat()).json();
            let way_mm = found["largest_way"]["deviation_mm"].as_f64();
            (found["complete"] == true, way_mm.unwrap_or(f64::INFINITY))
        };
        let (is_complete, way_mm) = diff(&program);
        assert!(is_complete && way_mm < 0.0105, "{text}: {way_mm} mm");
        let (is_complete, way_mm) = diff(&other);
        assert!(!is_complete || way_mm > 0.1, "{text}: {way_mm} mm");
    }
}

/// Where one axis leans too much, the option for those that lean a little is not offered.
#[test]
fn an_option_that_does_not_help_is_not_offered() {
    let folder = Folder::new();
    let out = folder.path("out.nc");
    let transform = folder.file("t.json", ASKEW);
    let program = "G21 G90 G17 G54\nG0 X0. Y0. Z30.\nG91 G28 Z0.\nG90 G0 X5. Y5.\nM30\n";
    let program = folder.file("p.nc", program);
    let args = [
        "nc",
        "rewrite",
        &program,
        "-o",
        &out,
        "--transform",
        &transform,
    ];
    let refused = umi(&args).exits(2);
    assert!(!refused.err.contains("--allow-rapids"), "{}", refused.err);
    assert!(refused.err.contains("name X, Y and Z"), "{}", refused.err);
}
